use super::accuracy::{Accuracy, sample_points};
use super::baseline::{Octree, Resolution, SampledReport, SampledSettings, Tolerance, UniformField};
use super::build::{FieldReport, FieldSettings};
use super::distance_field::DistanceField;
use super::error::FieldError;
use super::exact::ExactDistance;
use crate::control::Control;
use crate::geometry::{Aabb, Implicit, Point, TriMesh, Vector};
use nalgebra::Matrix3;

/// Sites of the sample in a report.
const SITES: usize = 2000;

/// How a distance field is built.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Method {
    /// Dense grid (Fuhrmann 2003).
    Uniform,
    /// Octree from the top down (Frisken 2000).
    Frisken,
    /// Octree from the bottom up (Wang 2009).
    Hybrid,
    /// Bricks of quadratic B-splines.
    #[default]
    Adaptive,
}

impl Method {
    /// All methods.
    pub const ALL: [Self; 4] = [Self::Uniform, Self::Frisken, Self::Hybrid, Self::Adaptive];

    /// Its name in files and on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Uniform => "uniform",
            Self::Frisken => "frisken",
            Self::Hybrid => "hybrid",
            Self::Adaptive => "adaptive",
        }
    }
}

/// Settings of [`SignedField::build`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MethodSettings {
    /// Method.
    pub method: Method,
    /// Spacing, band and margin.
    pub field: FieldSettings,
    /// Cells along the edge of the bounding cube; instead of the spacing when given.
    pub resolution: Option<u32>,
    /// Of `frisken` and `hybrid`.
    pub tolerance: Tolerance,
}

impl Default for MethodSettings {
    fn default() -> Self {
        Self {
            method: Method::default(),
            field: FieldSettings::default(),
            resolution: None,
            tolerance: SampledSettings::default().tolerance,
        }
    }
}

impl MethodSettings {
    /// The settings of the published methods.
    #[must_use]
    pub fn sampled(&self) -> SampledSettings {
        SampledSettings {
            resolution: self.resolution.map_or(Resolution::SpacingMm(self.field.spacing_mm), Resolution::Cells),
            tolerance: self.tolerance,
            band_mm: self.field.band_mm,
            margin_mm: self.field.margin_mm,
        }
    }

    /// The settings of the adaptive method for `surface`: a resolution means a spacing of that share of the bounding cube.
    #[must_use]
    pub fn adaptive(&self, surface: &TriMesh) -> FieldSettings {
        let bounds = surface.bounds().grown(self.field.margin_mm);
        let edge = (bounds.max - bounds.min).max();
        let spacing_mm = self.resolution.map_or(self.field.spacing_mm, |n| edge / f64::from(n.max(1)));
        FieldSettings { spacing_mm, ..self.field }
    }
}

/// A signed distance field built by any of the methods, in the frame of its surface.
///
/// A moved bone segment is queried at the point taken back by its motion; nothing is built again.
#[derive(Debug, Clone)]
pub enum SignedField {
    /// Dense grid.
    Uniform(UniformField),
    /// Octree, built either way.
    Octree(Octree),
    /// Bricks of quadratic B-splines.
    Adaptive(DistanceField),
}

impl SignedField {
    /// Builds the field of `surface`, without measuring its error where the method does not do that itself.
    ///
    /// # Errors
    /// [`FieldError`] for settings out of range, too much memory, or cancellation.
    pub fn build_only(
        surface: &TriMesh,
        settings: &MethodSettings,
        control: &Control,
    ) -> Result<(Self, MethodReport), FieldError> {
        let sampled = settings.sampled();
        Ok(match settings.method {
            Method::Uniform => {
                let (field, report) = UniformField::build(surface, &sampled, control)?;
                (Self::Uniform(field), MethodReport::Sampled(report))
            }
            Method::Frisken => {
                let (field, report) = Octree::frisken(surface, &sampled, control)?;
                (Self::Octree(field), MethodReport::Sampled(report))
            }
            Method::Hybrid => {
                let (field, report) = Octree::hybrid(surface, &sampled, control)?;
                (Self::Octree(field), MethodReport::Sampled(report))
            }
            Method::Adaptive => {
                let (field, report) = DistanceField::build(surface, &settings.adaptive(surface), control)?;
                (Self::Adaptive(field), MethodReport::Adaptive(report))
            }
        })
    }

    /// Builds the field of `surface` and measures its error at a fixed sample of points.
    ///
    /// # Errors
    /// As [`SignedField::build_only`].
    pub fn build(
        surface: &TriMesh,
        settings: &MethodSettings,
        control: &Control,
    ) -> Result<(Self, FieldReport), FieldError> {
        let (field, report) = Self::build_only(surface, settings, &control.part(0.0, 0.9))?;
        let report = match report {
            MethodReport::Adaptive(report) => report,
            MethodReport::Sampled(report) => {
                let exact = ExactDistance::new(surface);
                let points = sample_points(surface, &exact, settings.field.band_mm, SITES, control)?;
                let accuracy = Accuracy::measure(&field, &exact, &points, control)?;
                field_report(report, &accuracy)
            }
        };
        control.report(1.0);
        Ok((field, report))
    }

    /// Memory of the field, bytes.
    #[must_use]
    pub fn bytes(&self) -> usize {
        match self {
            Self::Uniform(f) => f.bytes(),
            Self::Octree(f) => f.bytes(),
            Self::Adaptive(f) => f.bytes(),
        }
    }

    /// The box within which the field is sampled, LPS mm.
    #[must_use]
    pub fn domain(&self) -> Aabb {
        match self {
            Self::Uniform(f) => f.domain(),
            Self::Octree(f) => f.domain(),
            Self::Adaptive(f) => f.domain(),
        }
    }

    /// Edge of the finest cell, mm.
    #[must_use]
    pub fn spacing_mm(&self) -> f64 {
        match self {
            Self::Uniform(f) => f.spacing_mm(),
            Self::Octree(f) => f.spacing_mm(),
            Self::Adaptive(f) => f.spacing_mm(),
        }
    }

    fn inner(&self) -> &dyn Implicit {
        match self {
            Self::Uniform(f) => f,
            Self::Octree(f) => f,
            Self::Adaptive(f) => f,
        }
    }
}

impl Implicit for SignedField {
    fn value(&self, p: &Point) -> f64 {
        self.inner().value(p)
    }

    fn value_gradient(&self, p: &Point) -> (f64, Vector) {
        self.inner().value_gradient(p)
    }

    fn hessian(&self, p: &Point) -> Matrix3<f64> {
        self.inner().hessian(p)
    }
}

/// What a field is like, in the terms of its method.
#[derive(Debug, Clone, PartialEq)]
pub enum MethodReport {
    /// Of a published method.
    Sampled(SampledReport),
    /// Of the adaptive method.
    Adaptive(FieldReport),
}

impl MethodReport {
    /// What is wrong with the surface and what follows.
    #[must_use]
    pub fn warnings(&self) -> &[String] {
        match self {
            Self::Sampled(r) => &r.warnings,
            Self::Adaptive(r) => &r.warnings,
        }
    }
}

fn field_report(sampled: SampledReport, accuracy: &Accuracy) -> FieldReport {
    FieldReport {
        bricks: sampled.bricks,
        bytes: sampled.bytes,
        max_error_mm: accuracy.max_error_mm,
        rms_error_mm: accuracy.rms_error_mm,
        checked_points: accuracy.points,
        warnings: sampled.warnings,
    }
}
