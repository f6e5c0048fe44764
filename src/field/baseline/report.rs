use super::octree::Octree;
use crate::defects::Defects;
use prosopon_geometry::{TriMesh, Warning};

/// Size and warnings of a field built by a published method.
#[derive(Debug, Clone, PartialEq)]
pub struct SampledReport {
    /// Edge of the finest cell, mm.
    pub spacing_mm: f64,
    /// Number of finest cells along the edge of the bounding cube.
    pub resolution: usize,
    /// Tolerance of the octree, mm; `None` for a dense grid.
    pub tolerance_mm: Option<f64>,
    /// Number of cells of the grid, or of leaves of the octree.
    pub cells: usize,
    /// Number of bricks of 8³ finest cells that are stored in detail.
    pub bricks: usize,
    /// Number of stored distances.
    pub samples: usize,
    /// Memory that the field takes, bytes.
    pub bytes: usize,
    /// Defects of the surface and their consequences.
    pub warnings: Vec<Warning>,
}

impl SampledReport {
    pub(super) fn of(octree: &Octree, tolerance_mm: f32, mut warnings: Vec<Warning>) -> Self {
        let half_step = octree.half_step_mm();
        if half_step > tolerance_mm {
            let found = format!(
                "the tolerance of {tolerance_mm:.1e} mm is finer than the stored values, which round by {half_step:.1e} mm"
            );
            warnings.push(Warning::check("tolerance-below-rounding", found).act("Use a larger tolerance."));
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
pub(super) fn defects(surface: &TriMesh) -> Vec<Warning> {
    warnings(&Defects::of(surface))
}

/// One warning for each kind of defect that makes pseudonormals unreliable.
pub(super) fn warnings(d: &Defects) -> Vec<Warning> {
    let mut warnings = Vec::new();
    if !d.rim.is_empty() {
        let found = format!(
            "the surface is open or inconsistently oriented along {} edges; the sign can be wrong where one of them is nearest",
            d.rim.len()
        );
        warnings
            .push(Warning::check("sign-at-open-edges", found).act("Use the adaptive method, or close the surface."));
    }
    if d.duplicates + d.cancelled > 0 {
        let found = format!(
            "{} triangles lie at the same position as another; the sign there depends on which is found first",
            d.duplicates + d.cancelled
        );
        warnings.push(Warning::check("sign-at-duplicates", found).act("Remove the duplicates."));
    }
    warnings.extend(d.no_area_warning());
    warnings
}
