use super::baseline::{Octree, Resolution, SampledSettings, Tolerance, UniformField};
use super::build::{FieldReport, FieldSettings};
use super::distance_field::DistanceField;
use super::error::{FieldError, within, within_coordinates};
use super::exact::{ExactDistance, is_inside};
use super::regions::unclear_regions;
use nalgebra::Matrix3;
use prosopon_geometry::control::{Cancelled, Control};
use prosopon_geometry::{Aabb, Flat, Implicit, Point, TriMesh, Vector, Warning};

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

    /// Name of the method in files and on the command line.
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
    /// Method to build the field with.
    pub method: Method,
    /// Spacing, band and margin, mm.
    pub field: FieldSettings,
    /// Number of cells along the edge of the bounding cube; replaces the spacing when given.
    pub resolution: Option<u32>,
    /// Tolerance of the octrees (`frisken` and `hybrid`); the other methods ignore it.
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
    /// These settings with cells `times` larger.
    #[must_use]
    pub fn coarser(&self, times: f64) -> Self {
        Self {
            field: FieldSettings { spacing_mm: times * self.field.spacing_mm, ..self.field },
            // A grid has at least 8 cells.
            resolution: self.resolution.map(|n| ((f64::from(n) / times).ceil() as u32).max(8)),
            ..*self
        }
    }

    /// These settings in the form that the published methods take.
    #[must_use]
    pub fn sampled(&self) -> SampledSettings {
        SampledSettings {
            resolution: self.resolution.map_or(Resolution::SpacingMm(self.field.spacing_mm), Resolution::Cells),
            tolerance: self.tolerance,
            band_mm: self.field.band_mm,
            margin_mm: self.field.margin_mm,
        }
    }

    /// These settings in the form that the adaptive method takes for `surface`.
    ///
    /// A resolution of n cells becomes a spacing of 1/n of the bounding cube's edge.
    ///
    /// # Errors
    /// [`FieldError::Setting`] for a setting or coordinate out of range.
    pub fn adaptive(&self, surface: &TriMesh) -> Result<FieldSettings, FieldError> {
        self.check(surface)?;
        let bounds = surface.bounds().grown(self.field.margin_mm);
        let edge = (bounds.max - bounds.min).max();
        let spacing_mm = self.resolution.map_or(self.field.spacing_mm, |n| edge / f64::from(n.max(1)));
        Ok(FieldSettings { spacing_mm, ..self.field })
    }

    /// Refuses settings out of range, and coordinates with which they cannot be used.
    fn check(&self, surface: &TriMesh) -> Result<(), FieldError> {
        self.field.check_extent()?;
        match self.resolution {
            Some(n) => within("resolution", f64::from(n), 8.0..=2048.0, "8 to 2048 cells")?,
            None => within("spacing_mm", self.field.spacing_mm, 0.01..=50.0, "0.01 to 50 mm")?,
        }
        within_coordinates(&surface.bounds())?;
        Ok(())
    }
}

/// A value below this share of the spacing may have the wrong sign: the field's error can exceed it.
const CHECKED_SHARE: f64 = 0.75;

/// Result of [`SignedField::distance_with_checked_sign`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CheckedDistance {
    /// Signed distance, mm; negative inside.
    pub distance: f64,
    /// Gradient of the field, dimensionless.
    pub gradient: Vector,
    /// Closest point of the surface, LPS mm.
    pub closest: Point,
    /// Index of the triangle that holds the closest point.
    pub triangle: usize,
}

/// A signed distance field built by any of the methods, in the frame of its surface.
///
/// To query a moved bone segment, apply the inverse of its motion to the point; the field is not built again.
#[derive(Debug, Clone)]
pub enum SignedField {
    /// Dense grid.
    Uniform(UniformField),
    /// Octree, built top down or bottom up.
    Octree(Octree),
    /// Bricks of quadratic B-splines.
    Adaptive(DistanceField),
}

/// Of the methods only [`Method::Adaptive`] can be read again; the others are baselines for comparisons.
impl Flat for SignedField {
    fn write(&self, to: &mut Vec<u8>) {
        match self {
            Self::Adaptive(field) => {
                true.write(to);
                field.write(to);
            }
            Self::Uniform(_) | Self::Octree(_) => false.write(to),
        }
    }

    fn read(from: &mut &[u8]) -> Option<Self> {
        if bool::read(from)? { DistanceField::read(from).map(Self::Adaptive) } else { None }
    }
}

impl SignedField {
    /// Builds the field of `surface` without measuring its error.
    ///
    /// Returns the field, its number of bricks, and warnings about defects of the surface.
    ///
    /// # Errors
    /// [`FieldError`] for settings out of range, too much memory, or cancellation.
    pub fn build_only(
        surface: &TriMesh,
        settings: &MethodSettings,
        control: &Control,
    ) -> Result<(Self, usize, Vec<Warning>), FieldError> {
        settings.check(surface)?;
        let sampled = settings.sampled();
        Ok(match settings.method {
            Method::Uniform => {
                let (field, report) = UniformField::build(surface, &sampled, control)?;
                (Self::Uniform(field), report.bricks, report.warnings)
            }
            Method::Frisken => {
                let (field, report) = Octree::frisken(surface, &sampled, control)?;
                (Self::Octree(field), report.bricks, report.warnings)
            }
            Method::Hybrid => {
                let (field, report) = Octree::hybrid(surface, &sampled, control)?;
                (Self::Octree(field), report.bricks, report.warnings)
            }
            Method::Adaptive => {
                let exact = ExactDistance::new(surface);
                let settings = settings.adaptive(surface)?;
                let (field, warnings) = DistanceField::build_unmeasured(&exact, surface, &settings, control)?;
                let bricks = field.n_bricks();
                (Self::Adaptive(field), bricks, warnings)
            }
        })
    }

    /// Builds the field of `surface`, measures its error at a fixed set of sample points and finds unclear regions.
    ///
    /// # Errors
    /// As [`SignedField::build_only`].
    pub fn build(
        surface: &TriMesh,
        settings: &MethodSettings,
        control: &Control,
    ) -> Result<(Self, FieldReport), FieldError> {
        let (field, report, exact) = Self::build_measured(surface, settings, control)?;
        let regions = unclear_regions(surface, &exact, control)?;
        Ok((field, FieldReport { regions, ..report }))
    }

    /// [`SignedField::build`] for an isosurface, on which no region can be unclear: they are not searched.
    ///
    /// # Errors
    /// As [`SignedField::build_only`].
    pub fn build_of_isosurface(
        surface: &TriMesh,
        settings: &MethodSettings,
        control: &Control,
    ) -> Result<(Self, FieldReport), FieldError> {
        Self::build_measured(surface, settings, control).map(|(field, report, _)| (field, report))
    }

    fn build_measured(
        surface: &TriMesh,
        settings: &MethodSettings,
        control: &Control,
    ) -> Result<(Self, FieldReport, ExactDistance), FieldError> {
        settings.check(surface)?;
        let exact = ExactDistance::new(surface);
        if settings.method == Method::Adaptive {
            let (field, report) = DistanceField::build_from(&exact, surface, &settings.adaptive(surface)?, control)?;
            return Ok((Self::Adaptive(field), report, exact));
        }
        let (field, bricks, warnings) = Self::build_only(surface, settings, &control.stage(0.0, 0.7))?;
        let report = FieldReport::measured(&field, &exact, surface, settings.field.band_mm, &control.stage(0.7, 1.0))?;
        let report = FieldReport { bricks, bytes: field.bytes(), warnings, ..report };
        Ok((field, report, exact))
    }

    /// As [`DistanceField::surface_bound`]; `None` for the published methods.
    ///
    /// # Errors
    /// [`Cancelled`].
    pub fn surface_bound(
        &self,
        surface: &TriMesh,
        exact: &ExactDistance,
        control: &Control,
    ) -> Result<Option<f64>, Cancelled> {
        match self {
            Self::Adaptive(field) => field.surface_bound(surface, exact, control),
            Self::Uniform(_) | Self::Octree(_) => Ok(None),
        }
    }

    /// Value (mm), gradient (dimensionless) and Hessian (1/mm) at `p` (LPS mm).
    #[must_use]
    pub fn value_gradient_hessian(&self, p: &Point) -> (f64, Vector, Matrix3<f64>) {
        if let Self::Adaptive(field) = self {
            return field.value_gradient_hessian(p);
        }
        let (value, gradient) = self.value_gradient(p);
        (value, gradient, self.hessian(p))
    }

    /// Memory that the field takes, bytes.
    #[must_use]
    pub fn bytes(&self) -> usize {
        match self {
            Self::Uniform(f) => f.bytes(),
            Self::Octree(f) => f.bytes(),
            Self::Adaptive(f) => f.bytes(),
        }
    }

    /// The box in which the field is sampled, LPS mm.
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

    /// Distance with a checked sign, gradient and closest point at `p`, LPS mm.
    ///
    /// `exact` was made from the field's surface. An adaptive field's distance has the sign of the winding number everywhere.
    /// Where the value is below three quarters of the spacing, its error could turn the sign: there the winding number decides,
    /// and where the two signs differ the exact distance replaces the value. Values of the published methods are not corrected.
    /// The gradient is always the field's.
    #[must_use]
    pub fn distance_with_checked_sign(&self, exact: &ExactDistance, p: &Point) -> CheckedDistance {
        let (value, gradient) = self.value_gradient(p);
        let (closest, triangle, distance) = exact.closest(p);
        let mut checked = CheckedDistance { distance: value, gradient, closest, triangle };
        if matches!(self, Self::Adaptive(_)) && value.abs() < CHECKED_SHARE * self.spacing_mm() {
            let inside = is_inside(exact.winding_number(p));
            if inside != (value < 0.0) {
                checked.distance = if inside { -distance } else { distance };
            }
        }
        checked
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
