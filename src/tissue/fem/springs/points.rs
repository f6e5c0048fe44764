//! Nodes with springs, and the springs' constants at rest.

use super::smooth::Smooth;
use crate::fem::contact::Overlap;
use crate::fem::error::SolveError;
use crate::fem::settings::{Boundary, ContactBody};
use crate::fem::tuning::{SMOOTHING, TIED_SHARE};
use crate::mesh::{Attachment, MixedMesh};
use prosopon_geometry::{Implicit, Point, Vector};

/// A node with a spring.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::fem) struct SpringPoint {
    pub(in crate::fem) node: u32,
    /// Index of the body that it glides on or is drawn to; `None` for rest.
    pub(in crate::fem) body: Option<usize>,
    /// Position at rest, LPS mm.
    pub(in crate::fem) rest: Point,
    /// Stiffness of the hold, N/mm; 0 without one.
    pub(in crate::fem) hold: f64,
    /// The normal part; `None` without one.
    pub(in crate::fem) normal: Option<HeldNormal>,
}

/// Constants of the normal part of a spring.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::fem) struct HeldNormal {
    /// Share of the surface at rest, mm².
    pub(in crate::fem) area_mm2: f64,
    /// From the node to the place where the distance is evaluated, in the body's frame, mm; see [`Overlap`].
    pub(in crate::fem) shift: Vector,
    /// Radius over which the distance is averaged, mm.
    pub(in crate::fem) smooth_mm: f64,
    /// Distance there at rest, mm.
    pub(in crate::fem) rest_mm: f64,
}

/// Springs of gliding nodes and of the boundary's foundations, in the order of nodes.
///
/// `shear_mpa` and `element_size_mm` scale the holds of gliding nodes.
pub(in crate::fem) fn points(
    mesh: &MixedMesh,
    bodies: &[ContactBody<'_>],
    boundary: &Boundary,
    shear_mpa: f64,
    element_size_mm: f64,
) -> Result<Vec<SpringPoint>, SolveError> {
    let (mut area, mut inward) = (vec![0.0; mesh.positions.len()], vec![Vector::zeros(); mesh.positions.len()]);
    for face in &mesh.bone_faces {
        let [a, b, c] = face.map(|n| mesh.positions[n as usize]);
        let normal = (c - a).cross(&(b - a));
        for n in face {
            area[*n as usize] += normal.norm() / 6.0;
            inward[*n as usize] += normal;
        }
    }
    let mut found = Vec::new();
    for (node, attachment) in mesh.attachment.iter().enumerate() {
        let rest = mesh.positions[node];
        let foundation = boundary.foundation_n_mm.get(node).copied().unwrap_or(0.0);
        match attachment {
            Attachment::Gliding(segment) => {
                let body = bodies.iter().position(|b| b.segment == *segment).ok_or_else(|| SolveError::Problem {
                    detail: format!("node {node} glides on segment {segment}, which has no solid"),
                })?;
                let solid = bodies[body].solid;
                let value = solid.value(&rest);
                let overlap = Overlap::of(solid, &rest, value, &inward[node]);
                let smooth_mm = SMOOTHING * element_size_mm;
                let smooth = Smooth { solid, radius_mm: smooth_mm };
                let rest_mm = smooth.value(&(rest + overlap.shift));
                let share = boundary.tied_share.get(node).copied().unwrap_or(0.0).clamp(0.0, TIED_SHARE);
                let hold = area[node] * shear_mpa / element_size_mm * share / (1.0 - share);
                let normal = HeldNormal { area_mm2: area[node], shift: overlap.shift, smooth_mm, rest_mm };
                found.push(SpringPoint { node: node as u32, body: Some(body), rest, hold, normal: Some(normal) });
            }
            Attachment::Free | Attachment::Sliding if foundation > 0.0 => {
                found.push(SpringPoint { node: node as u32, body: None, rest, hold: foundation, normal: None });
            }
            Attachment::Free | Attachment::Sliding | Attachment::Tied(_) | Attachment::Fixed => {}
        }
    }
    Ok(found)
}
