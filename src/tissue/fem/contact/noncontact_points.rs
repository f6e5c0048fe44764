//! Boundary points inside bone on which contact does not act: free ones, and nodes beside contact points, which lie deeper than
//! these at sharp edges. Their penetration is measured separately.

use crate::fem::tuning::{CONTACT_POINTS_PER_TASK, IGNORED_DEPTH_MM};
use std::sync::Arc;

use rayon::prelude::*;

use crate::fem::report::BonePenetration;
use crate::fem::settings::ContactBody;
use crate::mesh::{Attachment, MixedMesh, boundary_triangles};
use prosopon_geometry::{Motion, Point, Vector};

/// Boundary vertices and barycentres that bone does not hold.
#[derive(Debug)]
pub(in crate::fem) struct NoncontactPoints {
    /// Three nodes with equal weights; a vertex is listed three times.
    points: Arc<Vec<[u32; 3]>>,
    /// Depth in each body at rest, mm, by point and body.
    rest_mm: Vec<f64>,
}

fn mean(nodes: &[u32; 3], x: &[Vector]) -> Point {
    Point::from(nodes.iter().map(|n| x[*n as usize]).sum::<Vector>() / 3.0)
}

/// Boundary vertices that bone does not hold, and barycentres of boundary triangles with such a corner.
pub(in crate::fem) fn noncontact_points(mesh: &MixedMesh) -> Vec<[u32; 3]> {
    let is_open = |n: &u32| matches!(mesh.attachment[*n as usize], Attachment::Free | Attachment::Sliding);
    let faces = boundary_triangles(mesh);
    let mut vertices: Vec<u32> = faces.iter().flatten().copied().filter(is_open).collect();
    vertices.sort_unstable();
    vertices.dedup();
    let open = faces.into_iter().filter(|f| f.iter().any(is_open));
    vertices.into_iter().map(|n| [n; 3]).chain(open).collect()
}

impl NoncontactPoints {
    /// Measures the [`noncontact_points`] at rest.
    pub(in crate::fem) fn new(points: Arc<Vec<[u32; 3]>>, mesh: &MixedMesh, bodies: &[ContactBody<'_>]) -> Self {
        let rest: Vec<Vector> = mesh.positions.iter().map(|p| p.coords).collect();
        let still = vec![Motion::identity(); bodies.len()];
        let rest_mm = depths(&points, &rest, bodies, &still);
        Self { points, rest_mm }
    }

    /// The deepest point at `x`; `None` where none is deeper than at rest.
    pub(in crate::fem) fn deepest(
        &self,
        x: &[Vector],
        bodies: &[ContactBody<'_>],
        motions: &[Motion],
    ) -> Option<BonePenetration> {
        let now = depths(&self.points, x, bodies, motions);
        let mut found: Option<BonePenetration> = None;
        let mut points = 0;
        for (pair, (now, rest)) in now.iter().zip(&self.rest_mm).enumerate() {
            let depth_mm = now - rest;
            if depth_mm <= IGNORED_DEPTH_MM {
                continue;
            }
            points += 1;
            if found.is_none_or(|f| depth_mm > f.depth_mm) {
                let (point, body) = (pair / bodies.len(), pair % bodies.len());
                let segment = bodies[body].segment;
                found = Some(BonePenetration { depth_mm, segment, place: mean(&self.points[point], x), points: 0 });
            }
        }
        found.map(|bone_penetration| BonePenetration { points, ..bone_penetration })
    }
}

/// Depth of each point in each body, mm; 0 outside.
fn depths(points: &[[u32; 3]], x: &[Vector], bodies: &[ContactBody<'_>], motions: &[Motion]) -> Vec<f64> {
    let of = |nodes: &[u32; 3]| {
        let at = mean(nodes, x);
        let depth =
            move |(b, m): (&ContactBody<'_>, &Motion)| (-b.solid.value(&m.inverse_transform_point(&at))).max(0.0);
        bodies.iter().zip(motions).map(depth)
    };
    points.par_iter().with_min_len(CONTACT_POINTS_PER_TASK).flat_map_iter(of).collect()
}
