use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::FieldSettingsDocument;
use prosopon_field::{RegionKind, RegionsOfKind, FieldReport, Region};

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
    /// Faults of the surface, and how they were repaired.
    pub warnings: Vec<String>,
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
            warnings: r.warnings.clone(),
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
    /// Warnings about faults and repairs of the surfaces.
    pub warnings: Vec<String>,
}
