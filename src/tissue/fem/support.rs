use nalgebra::SMatrix;

use super::axes::{ALL_AXES, axes_in};
use super::error::SolveError;
use super::settings::Boundary;
use crate::mesh::{Attachment, MixedMesh};
use prosopon_geometry::{Point, Vector};

/// Checks that every connected part of a mesh is held against all six rigid motions.
///
/// Tied and fixed nodes hold a part, and so do nodes on a foundation or held along axes. Gliding alone does not hold one.
///
/// # Errors
/// [`SolveError::Problem`] with the position of a part that can move freely, or for a mesh without elements.
pub fn check_support(mesh: &MixedMesh, boundary: &Boundary) -> Result<(), SolveError> {
    let on_foundation = |node: usize| boundary.foundation_n_mm.get(node).is_some_and(|stiffness| *stiffness > 0.0);
    let mut parent: Vec<u32> = (0..mesh.positions.len() as u32).collect();
    let mut used = vec![false; mesh.positions.len()];
    for cell in mesh.tetrahedra.iter().map(|cell| &cell[..]).chain(mesh.prisms.iter().map(|cell| &cell[..])) {
        for &node in cell {
            used[node as usize] = true;
            let (a, b) = (root(&mut parent, cell[0]), root(&mut parent, node));
            parent[a.max(b) as usize] = a.min(b);
        }
    }
    let mut parts: Vec<(u32, u32)> =
        (0..mesh.positions.len() as u32).filter(|&n| used[n as usize]).map(|n| (root(&mut parent, n), n)).collect();
    parts.sort_unstable();
    if parts.is_empty() {
        return Err(SolveError::Problem { detail: "the mesh has no elements".into() });
    }
    let axes_of = |node: usize| match mesh.attachment[node] {
        Attachment::Tied(_) | Attachment::Fixed => ALL_AXES,
        Attachment::Free | Attachment::Sliding if on_foundation(node) => ALL_AXES,
        Attachment::Free | Attachment::Sliding | Attachment::Gliding(_) => {
            boundary.held_axes.get(node).copied().unwrap_or(0)
        }
    };
    for part in parts.chunk_by(|a, b| a.0 == b.0) {
        let held: Vec<(Point, u8)> = part
            .iter()
            .map(|&(_, node)| (mesh.positions[node as usize], axes_of(node as usize)))
            .filter(|(_, axes)| *axes != 0)
            .collect();
        if !holds_a_body(&held) {
            let p = mesh.positions[part[0].1 as usize];
            let detail = format!(
                "the part of {} nodes near ({:.1}, {:.1}, {:.1}) mm can move freely: {} of its nodes are tied, fixed or held \
                 along an axis, and they do not hold it against all six rigid motions (three fixed nodes that are not on one line \
                 would)",
                part.len(),
                p.x,
                p.y,
                p.z,
                held.len()
            );
            return Err(SolveError::Problem { detail });
        }
    }
    Ok(())
}

fn root(parent: &mut [u32], mut node: u32) -> u32 {
    while parent[node as usize] != node {
        parent[node as usize] = parent[parent[node as usize] as usize];
        node = parent[node as usize];
    }
    node
}

/// Whether points held along axes hold a rigid body: no rigid motion leaves all of them in place.
fn holds_a_body(held: &[(Point, u8)]) -> bool {
    let n = held.len().max(1) as f64;
    let centre = held.iter().map(|(p, _)| p.coords).sum::<Vector>() / n;
    let size = held.iter().map(|(p, _)| (p.coords - centre).norm()).fold(0.0, f64::max);
    if size == 0.0 {
        return false;
    }
    // A rigid motion v + w x r, with w in units of 1/size, moves the point along axis a by [e_a, r x e_a] . [v, w].
    let mut gram = SMatrix::<f64, 6, 6>::zeros();
    for (p, axes) in held {
        let r = (p.coords - centre) / size;
        for axis in axes_in(*axes) {
            let e = Vector::ith(axis, 1.0);
            let turn = r.cross(&e);
            let row = SMatrix::<f64, 6, 1>::from_column_slice(&[e.x, e.y, e.z, turn.x, turn.y, turn.z]);
            gram += row * row.transpose();
        }
    }
    let eigenvalues = gram.symmetric_eigenvalues();
    eigenvalues.min() > 1e-12 * eigenvalues.max()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_body_is_held_when_no_rigid_motion_is_left() {
        let at = |i: f64| Point::new(i, 2.0 * i, 100.0);
        let line: Vec<_> = (0..4).map(|i| (at(f64::from(i)), ALL_AXES)).collect();
        assert!(!holds_a_body(&line), "it can turn about the line");
        assert!(!holds_a_body(&[]) && !holds_a_body(&line[..1]));
        assert!(holds_a_body(&[line[0], line[1], (Point::origin(), ALL_AXES)]));
        // Three planes of symmetry hold a body, two leave it to slide along their line.
        let corner: Vec<(Point, u8)> = (0..8u8)
            .map(|i| [f64::from(i & 1), f64::from(i >> 1 & 1), f64::from(i >> 2 & 1)])
            .map(|x| (Point::from(x), (0..3).filter(|&a| x[a] == 0.0).fold(0, |bits, a| bits | 1 << a)))
            .filter(|(_, axes)| *axes != 0)
            .collect();
        assert!(holds_a_body(&corner));
        let two: Vec<(Point, u8)> = corner.iter().map(|(p, axes)| (*p, axes & 3)).filter(|(_, a)| *a != 0).collect();
        assert!(!holds_a_body(&two));
    }
}
