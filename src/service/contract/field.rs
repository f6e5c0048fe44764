use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::check::Check;
use super::fault::Fault;
use super::warning::Findings;
use prosopon_field::{
    EnvelopeSettings, FieldReport, FieldSettings, Method, MethodSettings, Region, RegionKind, RegionsOfKind, Tolerance,
};
use prosopon_planning::simulate::FieldsSettings;

/// Method of building a distance field.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum FieldMethod {
    /// Bricks of quadratic splines near the surface, coarse bricks elsewhere; smooth, as contact needs it.
    #[default]
    Adaptive,
    /// Octree, merged from the finest cells up (Wang 2009).
    Hybrid,
    /// Octree, divided from the root down (Frisken 2000).
    Frisken,
    /// Dense grid (Fuhrmann 2003).
    Uniform,
}

impl From<FieldMethod> for Method {
    fn from(method: FieldMethod) -> Self {
        match method {
            FieldMethod::Adaptive => Self::Adaptive,
            FieldMethod::Hybrid => Self::Hybrid,
            FieldMethod::Frisken => Self::Frisken,
            FieldMethod::Uniform => Self::Uniform,
        }
    }
}

/// Settings of the distance fields; absent members take their defaults.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct FieldSettingsDocument {
    /// Method of building the field; `adaptive` by default.
    pub method: FieldMethod,
    /// Finest grid spacing, mm, 0.1 to 10; 0.8 by default.
    pub spacing_mm: f64,
    /// Number of finest cells along the edge of the cube around each surface, 8 to 1024; replaces `spacing_mm` when given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub resolution: Option<u32>,
    /// Tolerance of the methods `hybrid` and `frisken`, mm, 1e-5 to 5; 1e-5 of the cube's edge when absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tolerance_mm: Option<f64>,
    /// Half-width of the band around the surface that has full accuracy, mm, 0.5 to 100; 5 by default.
    pub band_mm: f64,
    /// Distance that the grid extends beyond the surface, mm, 0 to 200; 10 by default.
    pub margin_mm: f64,
    /// Grid spacing of the bone envelope, mm, 0.2 to 10; 1 by default.
    pub envelope_spacing_mm: f64,
    /// Closing radius of the bone envelope, mm: openings narrower than twice this radius are closed.
    ///
    /// At least twice `envelope_spacing_mm`, at most 20; 2 by default.
    pub envelope_closing_mm: f64,
}

impl FieldSettingsDocument {
    /// The settings, checked.
    ///
    /// # Errors
    /// A fault that lists every value that is not allowed.
    pub fn checked(self) -> Result<Self, Fault> {
        let mut check = Check::default();
        // A closing radius below the grid's resolution would leave holes in the envelope.
        let least = 2.0 * self.envelope_spacing_mm;
        for (name, value, min, max) in [
            ("envelope_spacing_mm", self.envelope_spacing_mm, 0.2, 10.0),
            ("spacing_mm", self.spacing_mm, 0.1, 10.0),
            ("band_mm", self.band_mm, 0.5, 100.0),
            ("margin_mm", self.margin_mm, 0.0, 200.0),
            ("envelope_closing_mm", self.envelope_closing_mm, least, 20.0),
        ] {
            check.number(&format!("/{name}"), value, min, max);
        }
        if let Some(cells) = self.resolution {
            check.number("/resolution", f64::from(cells), 8.0, 1024.0);
        }
        if let Some(tolerance) = self.tolerance_mm {
            check.number("/tolerance_mm", tolerance, 1e-5, 5.0);
        }
        check.finish()?;
        Ok(self)
    }
}

impl Default for FieldSettingsDocument {
    fn default() -> Self {
        let (field, envelope) = (FieldSettings::default(), EnvelopeSettings::default());
        Self {
            method: FieldMethod::Adaptive,
            spacing_mm: field.spacing_mm,
            resolution: None,
            tolerance_mm: None,
            band_mm: field.band_mm,
            margin_mm: field.margin_mm,
            envelope_spacing_mm: envelope.spacing_mm,
            envelope_closing_mm: envelope.closing_mm,
        }
    }
}

impl From<&FieldSettingsDocument> for FieldsSettings {
    fn from(d: &FieldSettingsDocument) -> Self {
        Self {
            field: MethodSettings {
                method: d.method.into(),
                field: FieldSettings { spacing_mm: d.spacing_mm, band_mm: d.band_mm, margin_mm: d.margin_mm },
                resolution: d.resolution,
                tolerance: d.tolerance_mm.map_or(MethodSettings::default().tolerance, Tolerance::Mm),
            },
            envelope: EnvelopeSettings {
                spacing_mm: d.envelope_spacing_mm,
                closing_mm: d.envelope_closing_mm,
                ..EnvelopeSettings::default()
            },
        }
    }
}

/// A solid with a distance field.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Solid {
    /// The volume enclosed by the skin.
    #[default]
    Skin,
    /// The outer envelope of bone.
    Bone,
}

/// Size and accuracy of one distance field.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct FieldQualityDocument {
    /// Number of bricks of 8³ cells at the finest spacing.
    pub bricks: usize,
    /// Memory, bytes.
    pub memory_bytes: usize,
    /// Largest difference from the exact distance at sampled points within the band, mm.
    pub max_error_mm: f64,
    /// RMS difference at the same points, mm.
    pub rms_error_mm: f64,
    /// Number of those points.
    pub checked_points: usize,
    /// Warnings and notes.
    #[serde(flatten)]
    pub findings: Findings,
    /// Regions where the surface does not determine what is inside, by kind.
    ///
    /// Empty for a closed, consistently oriented surface without self-intersections. For bone, the regions are those of the
    /// skull's surface, not of its envelope.
    #[serde(default)]
    pub regions: Vec<DoubtfulRegionsDocument>,
}

/// Kind of doubt about a region of a surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum DoubtDocument {
    /// The rim of a hole or sheet.
    Open,
    /// Triangles oriented against their surroundings, or with normals that point into the solid.
    Inverted,
    /// Triangles beside which the absolute winding number is within 0.2 of one half.
    Ambiguous,
    /// Triangles inside another part of the surface.
    Buried,
    /// Triangles with the outside on both sides.
    Sheet,
    /// Triangles with the same corners as another one.
    Copy,
    /// Triangles without area.
    NoArea,
}

/// All regions of a surface with one kind of doubt.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct DoubtfulRegionsDocument {
    /// Kind of doubt.
    pub doubt: DoubtDocument,
    /// Number of connected regions.
    pub count: usize,
    /// Number of triangles of all regions; for `open`, number of edges.
    pub elements: usize,
    /// Area of all regions, mm²; for `open`, the area of a fan over each rim.
    pub area_mm2: f64,
    /// The regions of largest area, at most 50.
    pub largest: Vec<RegionDocument>,
}

/// A connected region of a surface.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct RegionDocument {
    /// Number of triangles; for `open`, number of edges.
    pub elements: usize,
    /// Area, mm².
    pub area_mm2: f64,
    /// Smallest coordinates of the box around it, LPS mm.
    pub min_mm: [f64; 3],
    /// Largest coordinates of the box around it, LPS mm.
    pub max_mm: [f64; 3],
}

impl From<&RegionsOfKind> for DoubtfulRegionsDocument {
    fn from(r: &RegionsOfKind) -> Self {
        let doubt = match r.kind {
            RegionKind::Open => DoubtDocument::Open,
            RegionKind::Inverted => DoubtDocument::Inverted,
            RegionKind::Ambiguous => DoubtDocument::Ambiguous,
            RegionKind::Buried => DoubtDocument::Buried,
            RegionKind::Sheet => DoubtDocument::Sheet,
            RegionKind::Copy => DoubtDocument::Copy,
            RegionKind::NoArea => DoubtDocument::NoArea,
        };
        let largest = r.largest.iter().map(RegionDocument::from).collect();
        Self { doubt, count: r.count, elements: r.elements, area_mm2: r.area_mm2, largest }
    }
}

impl From<&Region> for RegionDocument {
    fn from(r: &Region) -> Self {
        let [min_mm, max_mm] = [r.bounds.min, r.bounds.max].map(|p| p.coords.into());
        Self { elements: r.elements, area_mm2: r.area_mm2, min_mm, max_mm }
    }
}

impl From<&FieldReport> for FieldQualityDocument {
    fn from(r: &FieldReport) -> Self {
        Self {
            bricks: r.bricks,
            memory_bytes: r.bytes,
            max_error_mm: r.max_error_mm,
            rms_error_mm: r.rms_error_mm,
            checked_points: r.checked_points,
            findings: r.warnings.iter().cloned().collect(),
            regions: r.regions.iter().map(DoubtfulRegionsDocument::from).collect(),
        }
    }
}

/// Report of the distance fields of a session.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct FieldDocument {
    /// Settings that the fields were built with.
    pub settings: FieldSettingsDocument,
    /// Field of the skin.
    pub skin: FieldQualityDocument,
    /// Field of the bone's outer envelope.
    pub bone: FieldQualityDocument,
    /// Warnings and notes.
    #[serde(flatten)]
    pub findings: Findings,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_method_reaches_the_builders_and_older_records_are_read() {
        let of = |json| FieldsSettings::from(&serde_json::from_value::<FieldSettingsDocument>(json).unwrap()).field;
        let mut record = serde_json::to_value(FieldSettingsDocument::default()).unwrap();
        assert_eq!(of(record.clone()), MethodSettings::default());
        record["method"] = "hybrid".into();
        record["resolution"] = 128.into();
        record["tolerance_mm"] = 0.02.into();
        let hybrid = of(record);
        assert_eq!(
            (hybrid.method, hybrid.resolution, hybrid.tolerance),
            (Method::Hybrid, Some(128), Tolerance::Mm(0.02))
        );
    }
}
