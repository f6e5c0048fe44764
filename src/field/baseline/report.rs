use super::octree::Octree;
use crate::defects::Defects;
use prosopon_geometry::TriMesh;

/// What a field built by a published method is like.
#[derive(Debug, Clone, PartialEq)]
pub struct SampledReport {
    /// Edge of the finest cell, mm.
    pub spacing_mm: f64,
    /// Finest cells along the edge of the bounding cube.
    pub resolution: usize,
    /// Tolerance of the octree, mm.
    pub tolerance_mm: Option<f64>,
    /// Cells of the grid, or leaves of the octree.
    pub cells: usize,
    /// Bricks of 8³ finest cells that the field holds in detail.
    pub bricks: usize,
    /// Stored distances.
    pub samples: usize,
    /// Memory of the field, bytes.
    pub bytes: usize,
    /// What is wrong with the surface and what follows.
    pub warnings: Vec<String>,
}

impl SampledReport {
    pub(super) fn of(octree: &Octree, tolerance_mm: f32, mut warnings: Vec<String>) -> Self {
        let half_step = octree.half_step_mm();
        if half_step > tolerance_mm {
            warnings.push(format!(
                "the tolerance of {tolerance_mm:.1e} mm is below the precision of the stored values, {half_step:.1e} mm"
            ));
        }
        Self {
            spacing_mm: octree.cube().spacing,
            resolution: octree.cube().cells,
            tolerance_mm: Some(f64::from(tolerance_mm)),
            cells: octree.leaves(),
            bricks: octree.n_bricks(),
            samples: octree.samples(),
            bytes: octree.bytes(),
            warnings,
        }
    }
}

/// As [`warnings`], for `surface`.
pub(super) fn defects(surface: &TriMesh) -> Vec<String> {
    warnings(&Defects::of(surface))
}

/// One sentence for each kind of defect that makes pseudonormals doubtful.
pub(super) fn warnings(d: &Defects) -> Vec<String> {
    let mut warnings = Vec::new();
    if !d.rim.is_empty() {
        warnings.push(format!(
            "the surface is open or not consistently oriented along {} edges: the sign by pseudonormals can be wrong where they are nearest",
            d.rim.len()
        ));
    }
    if d.duplicates + d.cancelled > 0 {
        warnings.push(format!(
            "{} triangles share their place with another one: the sign there depends on which is found first",
            d.duplicates + d.cancelled
        ));
    }
    if d.without_area > 0 {
        warnings.push(format!("{} triangles have no area: kept as edges or points in the distance", d.without_area));
    }
    warnings
}
