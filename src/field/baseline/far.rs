use super::settings::EDGE;
use super::tile::Sampler;
use prosopon_geometry::{Point, Vector};

/// Marks a node or a tile without a triangle.
pub(super) const NONE: u32 = u32::MAX;

/// Signed distances at the first nodes of all tiles and one layer more: the field beyond the reach.
///
/// The tiles within reach know their nearest triangles. Sweeps spread these over the other nodes: each node takes the nearest of
/// its neighbours' triangles. Distances are never too small, and seldom more than a few per cent too large.
///
/// # Source
/// P.-E. Danielsson, Euclidean distance mapping, 1980; the same sweeps with triangles in place of pixels.
#[derive(Debug)]
pub(super) struct FarLattice {
    /// Number of nodes along an axis.
    n: usize,
    /// Signed distances, x fastest, mm.
    values: Vec<f32>,
}

impl FarLattice {
    /// `nearest` has a triangle for the first node of some of the `tiles`³ tiles, else [`NONE`].
    pub(super) fn new(sampler: &Sampler, origin: &Point, spacing: f64, tiles: usize, nearest: &[u32]) -> Self {
        let n = tiles + 1;
        let position =
            |at: [usize; 3]| origin + Vector::new(at[0] as f64, at[1] as f64, at[2] as f64) * (spacing * EDGE as f64);
        let place = |at: [usize; 3]| at[0] + n * (at[1] + n * at[2]);
        let mut found = vec![(f64::INFINITY, NONE); n * n * n];
        for (tile, &t) in nearest.iter().enumerate().filter(|(_, t)| **t != NONE) {
            let at = [tile % tiles, tile / tiles % tiles, tile / (tiles * tiles)];
            found[place(at)] = (sampler.signed(&position(at), t).abs(), t);
        }
        for direction in 0..8 {
            for step in 0..n * n * n {
                let back = [0, 1, 2].map(|a| direction >> a & 1 == 1);
                let walked = [step % n, step / n % n, step / (n * n)];
                let at = [0, 1, 2].map(|a| if back[a] { n - 1 - walked[a] } else { walked[a] });
                let mut best = found[place(at)];
                for a in 0..3 {
                    if walked[a] == 0 {
                        continue;
                    }
                    let mut from = at;
                    from[a] = if back[a] { at[a] + 1 } else { at[a] - 1 };
                    let t = found[place(from)].1;
                    if t == NONE || t == best.1 {
                        continue;
                    }
                    let distance = sampler.signed(&position(at), t).abs();
                    if distance < best.0 {
                        best = (distance, t);
                    }
                }
                found[place(at)] = best;
            }
        }
        let values = found
            .iter()
            .enumerate()
            .map(|(i, &(_, t))| {
                if t == NONE {
                    return 0.0;
                }
                sampler.signed(&position([i % n, i / n % n, i / (n * n)]), t) as f32
            })
            .collect();
        Self { n, values }
    }

    /// The same without the nodes that follow the last tile.
    pub(super) fn without_last(self) -> Self {
        let (n, m) = (self.n, self.n - 1);
        let values = (0..m * m * m).map(|i| self.values[i % m + n * (i / m % m + n * (i / (m * m)))]).collect();
        Self { n: m, values }
    }

    /// Signed distances, x fastest, mm.
    pub(super) fn values(&self) -> &[f32] {
        &self.values
    }

    /// Values at the corners of tile `at`, x fastest; beyond the last node that of the last.
    pub(super) fn around(&self, at: [usize; 3]) -> [f32; 8] {
        let mut corners = [0.0; 8];
        for (c, corner) in corners.iter_mut().enumerate() {
            let [x, y, z] = [0, 1, 2].map(|a| (at[a] + (c >> a & 1)).min(self.n - 1));
            *corner = self.values[x + self.n * (y + self.n * z)];
        }
        corners
    }
}

/// Value at a position `t` (0 to 1 along each axis) of a tile far from the surface, mm.
///
/// Where the corners differ in sign, as behind the rim of an open surface, the value jumps instead of passing through zero.
pub(super) fn far_value(corners: &[f32; 8], t: [f32; 3]) -> f32 {
    let signed = interpolated(corners, t);
    if corners.iter().all(|c| (*c < 0.0) == (corners[0] < 0.0)) {
        return signed;
    }
    interpolated(&corners.map(f32::abs), t).copysign(signed)
}

/// A sampled `value` at such a position, reduced where it exceeds `reach`, mm.
///
/// Beyond the reach a sampled value is the distance to some triangle and may be too large.
pub(super) fn within_far(value: f32, reach: f32, corners: &[f32; 8], t: [f32; 3]) -> f32 {
    if value.abs() <= reach {
        return value;
    }
    interpolated(&corners.map(f32::abs), t).clamp(reach, value.abs()).copysign(value)
}

fn interpolated(c: &[f32; 8], t: [f32; 3]) -> f32 {
    let lerp = |a: f32, b: f32, t: f32| a + (b - a) * t;
    let x = [0, 2, 4, 6].map(|i: usize| lerp(c[i], c[i + 1], t[0]));
    lerp(lerp(x[0], x[1], t[1]), lerp(x[2], x[3], t[1]), t[2])
}
