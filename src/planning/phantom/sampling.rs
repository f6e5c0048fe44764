use prosopon_geometry::{Aabb, Implicit, Point, ScalarGrid, TriMesh, Vector, isosurface};
use rayon::prelude::*;

/// Samples the surface of an analytic solid inside `bounds` at `spacing_mm`.
/// Returns `None` when `bounds` contain no surface of the solid.
///
/// Newton steps move the vertices onto the zero set, except where that would move them by more than a tenth of the spacing
/// (edges, and the cap where `bounds` cut the solid).
#[must_use]
pub fn surface_of(solid: &dyn Implicit, bounds: &Aabb, spacing_mm: f64) -> Option<TriMesh> {
    let mut grid = ScalarGrid::covering(bounds, spacing_mm, 0.0);
    let ([nx, ny, _], origin) = (grid.dims, grid.origin);
    grid.values.par_chunks_mut(nx).enumerate().for_each(|(row, values)| {
        let (j, k) = (row % ny, row / ny);
        for (i, value) in values.iter_mut().enumerate() {
            let p = origin + Vector::new(i as f64, j as f64, k as f64) * spacing_mm;
            *value = solid.value(&p) as f32;
        }
    });
    let mesh = isosurface(&grid, 0.0)?;
    let on_surface = mesh.positions().par_iter().map(|p| project(solid, p, 0.1 * spacing_mm)).collect();
    mesh.with_positions(on_surface).ok()
}

/// The zero of `solid` near `p`, or `p` itself when the zero is farther than `reach` (mm).
fn project(solid: &dyn Implicit, p: &Point, reach: f64) -> Point {
    let mut q = *p;
    for _ in 0..3 {
        let (value, gradient) = solid.value_gradient(&q);
        let norm_sq = gradient.norm_squared();
        if norm_sq < 1e-4 {
            return *p;
        }
        q -= gradient * (value / norm_sq);
    }
    if (q - p).norm() <= reach { q } else { *p }
}
