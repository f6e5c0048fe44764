//! Exact test of which grid edges a triangulated cut crosses.

use rayon::prelude::*;
use robust::{Coord, Coord3D, orient2d, orient3d};

use super::lattice::{Crossing, strides};
use prosopon_geometry::control::{Cancelled, Control};
use prosopon_geometry::{Point, ScalarGrid, TriMesh, Vector};

/// Grid edges that `mesh` crosses and that have an end in bone; `cut` is the index of the cut.
///
/// Exact for the given coordinates (Shewchuk's adaptive predicates): a closed loop of grid edges around an inner edge of the
/// sheet cannot slip through it. A node in a triangle's plane counts as on the side on which z, else y, else x is larger.
pub(super) fn crossings(
    grid: &ScalarGrid,
    mesh: &TriMesh,
    cut: usize,
    control: &Control,
) -> Result<Vec<Crossing>, Cancelled> {
    let n = mesh.triangles().len();
    let parts: Vec<Vec<Crossing>> = (0..n)
        .into_par_iter()
        .map(|t| {
            control.check()?;
            let mut found = Vec::new();
            if let Some(triangle) = Triangle::new(mesh, t) {
                for axis in 0..3 {
                    triangle.cross_lines(grid, axis, cut, &mut found);
                }
            }
            Ok(found)
        })
        .collect::<Result<_, Cancelled>>()?;
    let mut all = parts.concat();
    // Where several triangles cross the same grid edge, the nearest plane is kept.
    all.sort_by(|a, b| {
        let near = |c: &Crossing| c.distance[0] + c.distance[1];
        (a.node, a.axis).cmp(&(b.node, b.axis)).then(near(a).total_cmp(&near(b)))
    });
    all.dedup_by_key(|c| (c.node, c.axis));
    Ok(all)
}

struct Triangle {
    corners: [Point; 3],
    normal: Vector,
    /// Whether the normal points to smaller z, else y, else x; it decides the side of a node in the plane.
    flipped: bool,
}

impl Triangle {
    fn new(mesh: &TriMesh, index: usize) -> Option<Self> {
        let corners = mesh.corners(index);
        let normal = mesh.scaled_normal(index).try_normalize(1e-12)?;
        let leading = [normal.z, normal.y, normal.x].into_iter().find(|c| *c != 0.0)?;
        Some(Self { corners, normal, flipped: leading < 0.0 })
    }

    /// Whether `p` counts as on the side of larger coordinates.
    fn above(&self, p: &Point) -> bool {
        let coord = |p: &Point| Coord3D { x: p.x, y: p.y, z: p.z };
        let [a, b, c] = &self.corners;
        // Negative where p is on the side of the normal.
        let sign = orient3d(coord(a), coord(b), coord(c), coord(p));
        if self.flipped { sign >= 0.0 } else { sign <= 0.0 }
    }

    /// Whether the grid line through `p` along the axis left out of `[u, v]` meets the closed triangle.
    fn covers(&self, p: &Point, [u, v]: [usize; 2]) -> bool {
        let coord = |p: &Point| Coord { x: p[u], y: p[v] };
        let [a, b, c] = &self.corners;
        let turn = |from: &Point, to: &Point| orient2d(coord(from), coord(to), coord(p));
        let turns = [turn(a, b), turn(b, c), turn(c, a)];
        turns.iter().all(|t| *t >= 0.0) || turns.iter().all(|t| *t <= 0.0)
    }

    fn cross_lines(&self, grid: &ScalarGrid, axis: usize, cut: usize, found: &mut Vec<Crossing>) {
        let sides = [(axis + 1) % 3, (axis + 2) % 3];
        let span = |a: usize, margin: f64| -> Option<(usize, usize)> {
            let to_grid = |x: f64| (x - grid.origin[a]) / grid.spacing;
            let values = self.corners.map(|p| to_grid(p[a]));
            let low = values.iter().copied().fold(f64::INFINITY, f64::min).floor() - margin;
            let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max).ceil() + margin;
            let last = (grid.dims[a] - 1) as f64;
            (high >= 0.0 && low <= last).then(|| (low.max(0.0) as usize, high.min(last) as usize))
        };
        let (Some(u), Some(v), Some(along)) = (span(sides[0], 0.0), span(sides[1], 0.0), span(axis, 1.0)) else {
            return;
        };
        let step = strides(grid)[axis];
        for at_v in v.0..=v.1 {
            for at_u in u.0..=u.1 {
                let position = |k: usize| {
                    let mut at = [0; 3];
                    (at[axis], at[sides[0]], at[sides[1]]) = (k, at_u, at_v);
                    (grid.index(at[0], at[1], at[2]), grid.position(at[0], at[1], at[2]))
                };
                if !self.covers(&position(along.0).1, sides) {
                    continue;
                }
                let (mut low, mut high) = along;
                let below = self.above(&position(low).1);
                if below == self.above(&position(high).1) {
                    continue;
                }
                while high - low > 1 {
                    let middle = usize::midpoint(low, high);
                    if self.above(&position(middle).1) == below { low = middle } else { high = middle }
                }
                let ((node, p), (next, q)) = (position(low), position(high));
                debug_assert_eq!(next, node + step);
                let inside = [grid.values[node] < 0.0, grid.values[next] < 0.0];
                if inside == [false; 2] {
                    continue;
                }
                let distance = |p: &Point| self.normal.dot(&(p - self.corners[0])).abs() as f32;
                found.push(Crossing {
                    node,
                    axis,
                    cut,
                    distance: [distance(&p), distance(&q)],
                    positive: below != self.flipped,
                    in_bone: inside == [true; 2],
                });
            }
        }
    }
}
