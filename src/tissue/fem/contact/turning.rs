//! Second derivative of the distance from a point to a triangle whose nodes move.

use nalgebra::{Matrix3, Vector2};
use prosopon_geometry::Vector;

/// Second derivative of the signed distance `g = n · (x - c)` from a point `x` to the nearest point `c` of a face, an edge or a
/// corner, times a force.
///
/// With tangents `t_a` of the feature, their duals `t^a` and metric `m^ab`, the weights `w` of the gap's gradient `w n`, and the
/// derivatives `D_a` of the feature's linear functions, the block of nodes `i` and `j` is
///
/// `-(D_ai w_j n t^aᵀ + w_i D_aj t^a nᵀ) - g m^ab D_ai D_bj n nᵀ + w_i w_j Q / g`,
///
/// where `Q` projects on the directions at right angles to the normal and to the tangents (an edge has one, a corner two, a face
/// none). The first two terms turn the normal with the face (Wriggers, Computational Contact Mechanics, 2nd ed., eq. 4.33 without
/// curvature), the third moves the nearest point.
pub(super) struct Turning {
    nodes: [u32; 3],
    normal: Vector,
    /// Dual tangents, zero beyond the dimension of the feature.
    duals: [Vector; 2],
    /// Metric of the dual tangents.
    metric: [[f64; 2]; 2],
    /// Derivatives by the two coordinates, by node.
    derivatives: [[f64; 2]; 3],
    /// Gap, mm.
    gap: f64,
    /// `Q / g` within its limits, 1/mm.
    across: Matrix3<f64>,
    /// Pressure times area, N.
    force: f64,
}

impl Turning {
    /// `x` gives the positions of the feature's `nodes`. `stiffest` limits the term of an edge or corner, 1/mm: it grows with
    /// `1 / g` and would be indefinite for an open gap.
    pub(super) fn new(
        (nodes, n_nodes): ([u32; 3], usize),
        x: impl Fn(u32) -> Vector,
        normal: Vector,
        (gap, force): (f64, f64),
        stiffest: f64,
    ) -> Self {
        let corner = nodes.map(&x);
        let tangents = [corner[1] - corner[0], corner[2] - corner[0]];
        let across = |free: Matrix3<f64>| free * if gap < 0.0 { (1.0 / gap).max(-stiffest) } else { 0.0 };
        let beside = Matrix3::identity() - normal * normal.transpose();
        let mut turning = Self {
            nodes,
            normal,
            duals: [Vector::zeros(); 2],
            metric: [[0.0; 2]; 2],
            derivatives: [[0.0; 2]; 3],
            gap,
            across: Matrix3::zeros(),
            force,
        };
        match n_nodes {
            3 => {
                let [a, b] = tangents;
                let (aa, ab, bb) = (a.dot(&a), a.dot(&b), b.dot(&b));
                let det = (aa * bb - ab * ab).max(f64::MIN_POSITIVE);
                turning.metric = [[bb / det, -ab / det], [-ab / det, aa / det]];
                turning.duals = turning.metric.map(|[p, q]| a * p + b * q);
                turning.derivatives = [[-1.0, -1.0], [1.0, 0.0], [0.0, 1.0]];
            }
            2 => {
                let length_sq = tangents[0].norm_squared().max(f64::MIN_POSITIVE);
                turning.metric[0][0] = 1.0 / length_sq;
                turning.duals[0] = tangents[0] / length_sq;
                turning.derivatives = [[-1.0, 0.0], [1.0, 0.0], [0.0, 0.0]];
                turning.across = across(beside - tangents[0] * tangents[0].transpose() / length_sq);
            }
            _ => turning.across = across(beside),
        }
        turning
    }

    /// Block of two nodes with these weights.
    pub(super) fn block(&self, (a, wa): (u32, f64), (b, wb): (u32, f64)) -> Matrix3<f64> {
        let of = |node: u32| {
            let place = self.nodes.iter().position(|n| *n == node);
            place.map_or(Vector2::zeros(), |place| Vector2::from(self.derivatives[place]))
        };
        let (da, db) = (of(a), of(b));
        let along = |d: &Vector2<f64>| self.duals[0] * d.x + self.duals[1] * d.y;
        let metric = |p: usize, q: usize| self.metric[p][q] * da[p] * db[q];
        let stretch = metric(0, 0) + metric(0, 1) + metric(1, 0) + metric(1, 1);
        let n = &self.normal;
        let turned = n * along(&da).transpose() * wb + along(&db) * n.transpose() * wa;
        (self.across * (wa * wb) - turned - n * n.transpose() * (self.gap * stretch)) * self.force
    }
}
