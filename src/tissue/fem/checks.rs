//! Checks of mesh, boundary conditions and bodies.

use super::error::SolveError;
use super::settings::{Boundary, ContactBody};
use crate::mesh::MixedMesh;

pub(super) fn problem(detail: String) -> SolveError {
    SolveError::Problem { detail }
}

pub(super) fn check_mesh(mesh: &MixedMesh) -> Result<(), SolveError> {
    let n = mesh.positions.len();
    if mesh.attachment.len() != n {
        return Err(problem(format!("the mesh has {} attachments for {n} nodes", mesh.attachment.len())));
    }
    if mesh.tetrahedron_tissue.len() != mesh.tetrahedra.len() {
        let (tissues, tetrahedra) = (mesh.tetrahedron_tissue.len(), mesh.tetrahedra.len());
        return Err(problem(format!("the mesh has {tissues} tissues for {tetrahedra} tetrahedra")));
    }
    if let Some(node) = mesh.positions.iter().position(|p| !p.iter().all(|c| c.is_finite())) {
        return Err(problem(format!("node {node} has a coordinate that is not finite")));
    }
    let named = (mesh.tetrahedra.iter().flatten())
        .chain(mesh.prisms.iter().flatten())
        .chain(mesh.bone_faces.iter().flatten())
        .chain(mesh.facing.iter().flat_map(|f| &f.sides).flatten().flatten())
        .max();
    match named {
        Some(&node) if node as usize >= n => Err(problem(format!("a cell has node {node}, the mesh has only {n}"))),
        _ => Ok(()),
    }
}

pub(super) fn check_boundary(mesh: &MixedMesh, boundary: &Boundary) -> Result<(), SolveError> {
    let n = mesh.positions.len();
    let (held, loads) = (boundary.held_axes.len(), boundary.loads_n.len());
    if held != 0 && held != n {
        return Err(problem(format!("held axes are given for {held} nodes, the mesh has {n}")));
    }
    if loads != 0 && loads != n {
        return Err(problem(format!("loads are given for {loads} nodes, the mesh has {n}")));
    }
    for (what, values) in [("shares of hold", &boundary.tied_share), ("foundations", &boundary.foundation_n_mm)] {
        if !values.is_empty() && values.len() != n {
            return Err(problem(format!("{what} are given for {} nodes, the mesh has {n}", values.len())));
        }
        if let Some(node) = values.iter().position(|v| !(v.is_finite() && *v >= 0.0)) {
            return Err(problem(format!("{what}: node {node} has {}, allowed is 0 or more", values[node])));
        }
    }
    let prescribed = boundary.prescribed_mm.len();
    if prescribed != 0 && prescribed != n {
        return Err(problem(format!("prescribed displacements are given for {prescribed} nodes, the mesh has {n}")));
    }
    let is_held = |node: usize, axis: usize| boundary.held_axes.get(node).is_some_and(|axes| axes >> axis & 1 == 1);
    for (node, u) in boundary.prescribed_mm.iter().enumerate() {
        if let Some(axis) = (0..3).find(|axis| !u[*axis].is_finite() || (u[*axis] != 0.0 && !is_held(node, *axis))) {
            let name = ["x", "y", "z"][axis];
            return Err(problem(format!(
                "node {node} has a prescribed displacement of {} mm along {name}; it must be finite, and the node held along \
                 that axis",
                u[axis]
            )));
        }
    }
    if let Some(node) = boundary.held_axes.iter().position(|axes| *axes > 7) {
        return Err(problem(format!("node {node} has held axes {}, allowed are 0 to 7", boundary.held_axes[node])));
    }
    match boundary.loads_n.iter().position(|f| !f.iter().all(|c| c.is_finite())) {
        Some(node) => Err(problem(format!("the load on node {node} is not finite"))),
        None => Ok(()),
    }
}

pub(super) fn check_bodies(bodies: &[ContactBody<'_>]) -> Result<(), SolveError> {
    let mut segments: Vec<u32> = bodies.iter().map(|b| b.segment).collect();
    segments.sort_unstable();
    match segments.windows(2).find(|w| w[0] == w[1]) {
        Some(w) => Err(problem(format!("segment {} is given twice", w[0]))),
        None => Ok(()),
    }
}
