use rayon::prelude::*;

use super::MixedMesh;
use super::adjacency::Rows;
use prosopon_geometry::{Aabb, Point, TriMesh};

/// Position of each skin vertex in the outer triangles of the prisms.
#[derive(Debug, Clone, PartialEq)]
pub struct Embedding {
    /// Prism index and barycentric coordinates in its outer triangle, per skin vertex.
    /// `None` for vertices outside the mesh.
    pub anchors: Vec<Option<(u32, [f64; 3])>>,
}

prosopon_geometry::flat!(Embedding { anchors });

/// Finds the closest point of the prisms' outer triangles for every vertex of `skin`.
/// Vertices farther than `reach_mm` have no anchor. Of equally near triangles the first prism is used.
#[must_use]
pub fn embed(skin: &TriMesh, mesh: &MixedMesh, reach_mm: f64) -> Embedding {
    let triangles: Vec<[Point; 3]> =
        mesh.prisms.iter().map(|p| [p[0], p[1], p[2]].map(|i| mesh.positions[i as usize])).collect();
    embed_points(skin.positions(), &triangles, reach_mm)
}

/// As [`embed`], for any points and the outer triangles of the prisms in their order.
pub(super) fn embed_points(points: &[Point], triangles: &[[Point; 3]], reach_mm: f64) -> Embedding {
    let Some(bins) = Bins::of(triangles, reach_mm) else {
        return Embedding { anchors: vec![None; points.len()] };
    };
    let anchor = |p: &Point| -> Option<(u32, [f64; 3])> {
        let mut best: Option<(f64, u32, [f64; 3])> = None;
        for &t in bins.at(p)? {
            let (q, weights) = closest_on_triangle(p, &triangles[t as usize]);
            let distance = (q - p).norm();
            if distance <= reach_mm && best.is_none_or(|(d, _, _)| distance < d) {
                best = Some((distance, t, weights));
            }
        }
        best.map(|(_, t, weights)| (t, weights))
    };
    Embedding { anchors: points.par_iter().map(anchor).collect() }
}

/// Triangles sorted into cubes.
/// Each cube lists, in ascending order, all triangles whose box, enlarged by the reach, meets it.
struct Bins {
    bounds: Aabb,
    size: [usize; 3],
    step: f64,
    rows: Rows,
}

impl Bins {
    fn of(triangles: &[[Point; 3]], reach: f64) -> Option<Self> {
        if !(reach >= 0.0 && reach.is_finite()) {
            return None;
        }
        let bounds = Aabb::of(triangles.iter().flatten())?.grown(reach);
        let extent = bounds.max - bounds.min;
        // Cubes have about the size of an enlarged triangle, but there are at most a few million of them.
        let mean = triangles.iter().map(|[a, b, _]| (b - a).norm()).sum::<f64>() / triangles.len() as f64;
        let least = extent.max().max(1e-9) / 128.0;
        let step = (mean + reach).max(least);
        let size = [0, 1, 2].map(|a| (extent[a] / step) as usize + 1);
        let mut pairs = Vec::new();
        for (t, corners) in triangles.iter().enumerate() {
            let Some(b) = Aabb::of(corners) else { continue };
            let b = b.grown(reach);
            let low = [0, 1, 2].map(|a| ((b.min[a] - bounds.min[a]) / step).max(0.0) as usize);
            let high = [0, 1, 2].map(|a| (((b.max[a] - bounds.min[a]) / step) as usize).min(size[a] - 1));
            for k in low[2]..=high[2] {
                for j in low[1]..=high[1] {
                    for i in low[0]..=high[0] {
                        pairs.push(((i + size[0] * (j + size[1] * k)) as u32, t as u32));
                    }
                }
            }
        }
        let rows = Rows::of(size[0] * size[1] * size[2], pairs.iter().copied());
        Some(Self { bounds, size, step, rows })
    }

    fn at(&self, p: &Point) -> Option<&[u32]> {
        if !self.bounds.contains(p) {
            return None;
        }
        let c = [0, 1, 2].map(|a| (((p[a] - self.bounds.min[a]) / self.step) as usize).min(self.size[a] - 1));
        Some(self.rows.row(c[0] + self.size[0] * (c[1] + self.size[1] * c[2])))
    }
}

/// Closest point of a triangle and its barycentric coordinates (all in 0 to 1, sum 1).
///
/// # Source
/// C. Ericson, Real-Time Collision Detection, 2005, section 5.1.5.
pub(super) fn closest_on_triangle(p: &Point, [a, b, c]: &[Point; 3]) -> (Point, [f64; 3]) {
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d1, d2) = (ab.dot(&ap), ac.dot(&ap));
    let on = |weights: [f64; 3]| {
        (Point::from(a.coords * weights[0] + b.coords * weights[1] + c.coords * weights[2]), weights)
    };
    if d1 <= 0.0 && d2 <= 0.0 {
        return on([1.0, 0.0, 0.0]);
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(&bp), ac.dot(&bp));
    if d3 >= 0.0 && d4 <= d3 {
        return on([0.0, 1.0, 0.0]);
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        let v = d1 / (d1 - d3);
        return on([1.0 - v, v, 0.0]);
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(&cp), ac.dot(&cp));
    if d6 >= 0.0 && d5 <= d6 {
        return on([0.0, 0.0, 1.0]);
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        let w = d2 / (d2 - d6);
        return on([1.0 - w, 0.0, w]);
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 >= d3 && d5 >= d6 {
        let w = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        return on([0.0, 1.0 - w, w]);
    }
    let sum = va + vb + vc;
    on([va / sum, vb / sum, vc / sum])
}
