//! Bone as voxels, filled from a surface that may have defects.

use super::tuning::{MAX_VOXELS, VOXEL_MM};
use rayon::prelude::*;

use prosopon_geometry::{Point, TriMesh};

/// Voxels whose centre lies in the solid, in columns along y.
pub(super) struct Voxels {
    min: Point,
    dims: [usize; 3],
    /// By `j + ny * (i + nx * k)`.
    filled: Vec<bool>,
}

impl Voxels {
    /// Fills the solid of `mesh`.
    ///
    /// Columns along y enter and leave it where they cross the surface, counted by the orientation of the triangles, so that
    /// nested shells and doubled faces do no harm.
    pub(super) fn of(mesh: &TriMesh) -> Self {
        let bounds = mesh.bounds();
        let count = |a: usize| (((bounds.max[a] - bounds.min[a]) / VOXEL_MM).ceil() as usize + 1).min(MAX_VOXELS);
        let dims = [0, 1, 2].map(count);
        let mut crossings: Vec<Vec<(f64, i32)>> = vec![Vec::new(); dims[0] * dims[2]];
        for t in 0..mesh.triangles().len() {
            cross(mesh.corners(t), &bounds.min, dims, &mut crossings);
        }
        let mut filled = vec![false; dims[0] * dims[1] * dims[2]];
        filled.par_chunks_mut(dims[1]).zip(crossings.par_iter_mut()).for_each(|(column, at)| {
            at.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            let mut depth = 0;
            for pair in at.windows(2) {
                depth += pair[0].1;
                if depth > 0 {
                    let [from, to] = [pair[0].0, pair[1].0].map(|y| (y - bounds.min.y) / VOXEL_MM - 0.5);
                    let range = from.ceil().max(0.0) as usize..(to.floor() + 1.0).clamp(0.0, dims[1] as f64) as usize;
                    column.get_mut(range).into_iter().flatten().for_each(|v| *v = true);
                }
            }
        });
        Self { min: bounds.min, dims, filled }
    }

    /// Voxels from `min` on, filled where `is_bone` holds at their middle.
    #[cfg(test)]
    pub(super) fn filled_where(min: Point, dims: [usize; 3], is_bone: impl Fn(&Point) -> bool) -> Self {
        let middle = |n: usize| {
            let at = [n / dims[1] % dims[0], n % dims[1], n / (dims[1] * dims[0])];
            min + prosopon_geometry::Vector::from(at.map(|c| (c as f64 + 0.5) * VOXEL_MM))
        };
        Self { min, dims, filled: (0..dims.iter().product()).map(|n| is_bone(&middle(n))).collect() }
    }

    /// Whether the voxel at a place is filled.
    pub(super) fn at(&self, x: f64, y: f64, z: f64) -> bool {
        let cell = |v: f64, a: usize| {
            let c = (v - self.min[a]) / VOXEL_MM;
            (c >= 0.0 && c < self.dims[a] as f64).then_some(c as usize)
        };
        let (Some(i), Some(j), Some(k)) = (cell(x, 0), cell(y, 1), cell(z, 2)) else { return false };
        self.filled[j + self.dims[1] * (i + self.dims[0] * k)]
    }

    /// Lower and upper end along an axis.
    pub(super) fn range(&self, axis: usize) -> [f64; 2] {
        [self.min[axis], self.min[axis] + self.dims[axis] as f64 * VOXEL_MM]
    }

    /// y of the foremost filled voxel of the column at x, z.
    pub(super) fn front(&self, x: f64, z: f64) -> Option<f64> {
        let [from, to] = self.range(1);
        steps(from, to).find(|y| self.at(x, *y, z))
    }
}

/// Middles of voxels between two places.
pub(super) fn steps(from: f64, to: f64) -> impl DoubleEndedIterator<Item = f64> + Clone {
    let n = ((to - from) / VOXEL_MM).max(0.0) as u32;
    (0..n).map(move |i| from + (f64::from(i) + 0.5) * VOXEL_MM)
}

/// Adds the crossings of one triangle with the columns' middles.
fn cross([a, b, c]: [Point; 3], min: &Point, dims: [usize; 3], crossings: &mut [Vec<(f64, i32)>]) {
    let flat = |p: &Point| [(p.x - min.x) / VOXEL_MM - 0.5, (p.z - min.z) / VOXEL_MM - 0.5];
    let (p, q, r) = (flat(&a), flat(&b), flat(&c));
    let area = (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]);
    if area == 0.0 || !area.is_finite() {
        return;
    }
    let range = |axis: usize, n: usize| {
        let all = [p[axis], q[axis], r[axis]];
        let low = all.iter().copied().fold(f64::INFINITY, f64::min).ceil().max(0.0);
        let high = all.iter().copied().fold(f64::NEG_INFINITY, f64::max).floor();
        low as usize..(high + 1.0).clamp(0.0, n as f64) as usize
    };
    // x × z runs against y: a triangle whose projection turns to the left faces the front.
    let step = if area > 0.0 { 1 } else { -1 };
    for k in range(1, dims[2]) {
        for i in range(0, dims[0]) {
            // Shifted a little off the middle, so that no column runs along an edge of a surface that comes from a lattice.
            let (x, z) = (i as f64 + 1.231e-4, k as f64 + 2.177e-4);
            let side = |u: [f64; 2], v: [f64; 2]| ((v[0] - u[0]) * (z - u[1]) - (v[1] - u[1]) * (x - u[0])) / area;
            let weights = [side(q, r), side(r, p), side(p, q)];
            if weights.iter().all(|w| *w >= 0.0) {
                let y = weights[0] * a.y + weights[1] * b.y + weights[2] * c.y;
                crossings[i + dims[0] * k].push((y, step));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::phantom::surface_of;

    #[test]
    fn voxels_fill_the_solid_and_nothing_else() {
        let head = crate::phantom::head();
        let mesh = surface_of(head.skull.as_ref(), &head.bounds(), 2.0).unwrap();
        let voxels = Voxels::of(&mesh);
        let sum = voxels.filled.iter().filter(|v| **v).count() as f64;
        // Counting middles is right on average: half a per cent covers thousands of columns with two ends each.
        assert!((sum / mesh.volume() - 1.0).abs() < 5e-3, "{sum} {}", mesh.volume());
        assert!(voxels.at(0.0, -82.0, -33.0) && !voxels.at(0.0, -90.0, -33.0));
    }
}
