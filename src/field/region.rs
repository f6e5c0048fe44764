//! Parts of a surface, by the reason why inside and outside are unclear there.

use prosopon_geometry::Aabb;

/// Most regions listed of one kind.
const MAX_LISTED: usize = 50;

/// Why inside and outside are unclear in a part of a surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum RegionKind {
    /// The rim of a hole or sheet, along which the triangles of the two sides do not cancel.
    Open,
    /// Triangles that face opposite to their surroundings, or whose normals point into the solid.
    Inverted,
    /// Triangles next to which the magnitude of the winding number is within 0.2 of one half.
    Ambiguous,
    /// Triangles with the inside on both sides: they lie within another part of the surface.
    Buried,
    /// Triangles with the outside on both sides: a sheet that bounds nothing.
    Sheet,
    /// Triangles at the same position as another triangle.
    Copy,
    /// Triangles without area.
    NoArea,
}

prosopon_geometry::flat_names!(RegionKind { Open, Inverted, Ambiguous, Buried, Sheet, Copy, NoArea });

/// A connected part of a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Region {
    /// Number of triangles of the part, or of edges for a rim.
    pub elements: usize,
    /// Area, mm²; for a rim that of a triangle fan over it.
    pub area_mm2: f64,
    /// Box around it, LPS mm.
    pub bounds: Aabb,
}

prosopon_geometry::flat!(Region { elements, area_mm2, bounds });

/// All regions of one kind.
#[derive(Debug, Clone, PartialEq)]
pub struct RegionsOfKind {
    /// Kind of the regions.
    pub kind: RegionKind,
    /// Number of regions.
    pub count: usize,
    /// Number of triangles of all regions, or of edges for rims.
    pub elements: usize,
    /// Total area, mm².
    pub area_mm2: f64,
    /// The largest regions by area, at most 50.
    pub largest: Vec<Region>,
}

prosopon_geometry::flat!(RegionsOfKind { kind, count, elements, area_mm2, largest });

impl RegionsOfKind {
    /// Sums `regions` and keeps the largest.
    pub(super) fn new(kind: RegionKind, mut regions: Vec<Region>) -> Self {
        let count = regions.len();
        let elements = regions.iter().map(|r| r.elements).sum();
        let area_mm2 = regions.iter().map(|r| r.area_mm2).sum();
        regions.sort_by(|a, b| b.area_mm2.total_cmp(&a.area_mm2));
        regions.truncate(MAX_LISTED);
        Self { kind, count, elements, area_mm2, largest: regions }
    }
}
