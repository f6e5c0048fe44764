//! Patches: small groups of elements that do not overlap and share one mean strain, a locking-free formulation.
//!
//! A patch has one volume constraint, about as many as there are nodes, so that nearly incompressible tissue does not lock
//! (mean dilatation over patches: de Souza Neto, Andrade Pires and Owen, Int J Numer Methods Eng 62 (2005) 353). Most of the
//! isochoric energy is taken at the mean strain as well, which lets tetrahedra bend; the rest stays with the elements' own
//! strains and gives stiffness to the modes that a mean does not see (the idea of Puso and Solberg, Int J Numer Methods Eng 67
//! (2006) 841, there for averages around nodes). Unlike domains around nodes and edges, patches couple few nodes beyond those
//! that share an element, which keeps the factor of the stiffness matrix small.

use super::block::ElementBlock;
use super::smoothing::{Share, domains};
use crate::fem::tuning::{PATCH_MOST, PATCH_SIZE};

/// Elements at the mean strain of patches.
///
/// A patch is a group of linear tetrahedra of one tissue connected through faces; any other element is a patch of its own.
/// Which tetrahedra share a patch depends on their order in the blocks.
#[must_use]
pub fn patches(blocks: &[&ElementBlock]) -> Vec<ElementBlock> {
    let mut elements = Vec::new();
    for (index, block) in blocks.iter().enumerate() {
        for (element, nodes) in block.nodes.chunks_exact(block.n_functions).enumerate() {
            elements.push(Member { block: index as u32, element: element as u32, corners: nodes.try_into().ok() });
        }
    }
    let tissue = |m: &Member| blocks[m.block as usize].tissue[m.element as usize];
    let owner = groups(&elements, &neighbours(&elements, |a, b| tissue(a) == tissue(b)));
    let share = |(m, group): (&Member, &u32)| Share {
        key: (*group, *group),
        tissue: tissue(m),
        block: m.block,
        element: m.element,
        part: 1.0,
    };
    domains(blocks, elements.iter().zip(&owner).map(share).collect(), "patch")
}

/// An element that belongs to a patch.
struct Member {
    block: u32,
    element: u32,
    /// Nodes of a linear tetrahedron; `None` for other elements.
    corners: Option<[u32; 4]>,
}

impl Member {
    /// Sorted nodes of each face.
    fn faces(&self) -> impl Iterator<Item = [u32; 3]> {
        self.corners.into_iter().flat_map(|[a, b, c, d]| [[a, b, c], [a, b, d], [a, c, d], [b, c, d]]).map(
            |mut face| {
                face.sort_unstable();
                face
            },
        )
    }
}

/// Neighbours of each element across a face, ascending, among those for which `alike` returns true.
fn neighbours(elements: &[Member], alike: impl Fn(&Member, &Member) -> bool) -> Vec<Vec<u32>> {
    let mut faces: Vec<([u32; 3], u32)> = Vec::with_capacity(4 * elements.len());
    for (index, element) in elements.iter().enumerate() {
        faces.extend(element.faces().map(|face| (face, index as u32)));
    }
    faces.sort_unstable();
    let mut out = vec![Vec::new(); elements.len()];
    for pair in faces.windows(2).filter(|pair| pair[0].0 == pair[1].0) {
        let [a, b] = [pair[0].1, pair[1].1];
        if alike(&elements[a as usize], &elements[b as usize]) {
            out[a as usize].push(b);
            out[b as usize].push(a);
        }
    }
    out.iter_mut().for_each(|list| list.sort_unstable());
    out
}

/// The group of each element.
///
/// A group grows by the neighbour that brings the fewest new nodes. What is left over in small groups joins its smallest
/// neighbour.
fn groups(elements: &[Member], neighbours: &[Vec<u32>]) -> Vec<u32> {
    const NONE: u32 = u32::MAX;
    let mut owner = vec![NONE; elements.len()];
    let mut members: Vec<Vec<u32>> = Vec::new();
    let mut nodes: Vec<u32> = Vec::new();
    for seed in 0..elements.len() as u32 {
        if owner[seed as usize] != NONE {
            continue;
        }
        nodes.clear();
        let mut group = Vec::with_capacity(PATCH_SIZE);
        let mut next = Some(seed);
        while let Some(element) = next {
            owner[element as usize] = members.len() as u32;
            group.push(element);
            nodes.extend(elements[element as usize].corners.iter().flatten());
            let free = group.iter().flat_map(|e| &neighbours[*e as usize]).filter(|e| owner[**e as usize] == NONE);
            let new = |e: &u32| elements[*e as usize].corners.iter().flatten().filter(|n| !nodes.contains(n)).count();
            next = if group.len() < PATCH_SIZE { free.copied().min_by_key(|e| (new(e), *e)) } else { None };
        }
        members.push(group);
    }
    for own in 0..members.len() {
        let small = members[own].len();
        if small == 0 || small > PATCH_SIZE / 2 {
            continue;
        }
        let around = members[own].iter().flat_map(|e| &neighbours[*e as usize]).map(|e| owner[*e as usize]);
        let others = around.filter(|g| *g as usize != own).map(|g| (members[g as usize].len(), g));
        if let Some((_, into)) = others.filter(|(other, _)| other + small <= PATCH_MOST).min() {
            let moved = std::mem::take(&mut members[own]);
            moved.iter().for_each(|e| owner[*e as usize] = into);
            members[into as usize].extend(moved);
        }
    }
    owner
}

#[cfg(test)]
mod tests {
    use super::super::linear::{tetrahedra, wedges};
    use super::super::sample_meshes::height_field;
    use super::*;
    use crate::fem::tests::blocks::Slab;
    use crate::mesh::Tissue;
    use nalgebra::Matrix3;

    /// Patches hold every element once, never mix tissues, and reproduce a linear field exactly.
    #[test]
    fn patches_keep_the_volume_and_linear_fields() {
        let mut mesh = Slab { cells: [6; 3], origin: [0.0; 3], size: [3.0, 2.0, 1.0], skin: 0.0 }.mesh();
        for (cell, tissue) in mesh.tetrahedron_tissue.iter_mut().enumerate() {
            *tissue = if cell % 216 < 100 { Tissue::Fat } else { Tissue::Muscle };
        }
        let block = tetrahedra(&mesh).unwrap();
        let all = patches(&[&block]);
        let n: usize = all.iter().map(ElementBlock::n_elements).sum();
        let cells = mesh.tetrahedra.len();
        assert!(n > cells / PATCH_MOST && n < cells / 6, "{n} patches of {cells} tetrahedra");
        let volume = |tissue: Tissue, blocks: &[ElementBlock]| -> f64 {
            let all = blocks.iter().flat_map(|b| b.weights.iter().zip(&b.tissue));
            all.filter(|(_, t)| **t == tissue).map(|(w, _)| w).sum()
        };
        let own = [block.clone()];
        for tissue in [Tissue::Fat, Tissue::Muscle] {
            assert!((volume(tissue, &all) - volume(tissue, &own)).abs() < 1e-12);
        }
        let a = Matrix3::new(1.2, 0.3, -0.1, 0.2, 0.9, 0.4, 0.0, -0.3, 1.1);
        for block in &all {
            let n = block.n_functions;
            for (nodes, gradients) in block.nodes.chunks(n).zip(block.gradients.chunks(n)) {
                let place = |node: &u32| a * mesh.positions[*node as usize].coords;
                let f: Matrix3<f64> = nodes.iter().zip(gradients).map(|(node, g)| place(node) * g.transpose()).sum();
                assert!((f - a).norm() < 1e-13);
            }
        }
    }

    /// A prism is a patch of its own.
    #[test]
    fn prisms_keep_their_own_mean() {
        let mesh = height_field(6, 1.0, |_, _| 0.0);
        let block = wedges(&mesh).unwrap();
        let all = patches(&[&block]);
        let n: usize = all.iter().map(ElementBlock::n_elements).sum();
        assert_eq!(n, mesh.prisms.len());
        let volume: f64 = all.iter().flat_map(|b| &b.weights).sum();
        assert!((volume - block.weights.iter().sum::<f64>()).abs() < 1e-12);
    }
}
