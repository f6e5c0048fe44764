//! Smoothed elements: strain averaged over the elements around edges and nodes, a locking-free formulation.
//!
//! A linear tetrahedron is too stiff in bending, and it locks near incompressibility. Smoothed elements take the isochoric energy
//! at the mean deformation gradient of the tetrahedra around each edge, and the volumetric energy at that of the elements around
//! each node (Liu and Nguyen-Thoi, *Smoothed Finite Element Methods*, 2010, "selective ES/NS-FEM-T4"; Onishi and Amaya, Int J
//! Numer Methods Eng 2014). Means are linear in the nodal values, so a smoothing domain is an element like any other, with more
//! nodes. Averages never cross from one tissue to another, so that jumps of the strain between tissues remain.

use super::block::{ElementBlock, MeshCell};
use crate::mesh::Tissue;
use prosopon_geometry::Vector;

/// Numbers of functions to which smoothed blocks are padded.
pub const SMOOTHED_WIDTHS: [usize; 8] = [4, 6, 8, 12, 16, 24, 32, 48];

/// Edges of a tetrahedron.
const EDGES: [(usize, usize); 6] = [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)];

/// Share of an element in a smoothing domain or a patch.
#[derive(Debug, Clone, Copy)]
pub(super) struct Share {
    /// The two ends of an edge, or a node or a patch twice.
    pub(super) key: (u32, u32),
    pub(super) tissue: Tissue,
    pub(super) block: u32,
    pub(super) element: u32,
    /// Share of the element's volume.
    pub(super) part: f64,
}

/// Smoothing domains around edges: each gets a sixth of every linear tetrahedron at the edge.
#[must_use]
pub fn edge_domains(tetrahedra: &[&ElementBlock]) -> Vec<ElementBlock> {
    let mut shares = Vec::new();
    for (index, block) in tetrahedra.iter().enumerate() {
        for (element, nodes) in block.nodes.chunks_exact(block.n_functions).enumerate() {
            for (i, j) in EDGES {
                let key = (nodes[i].min(nodes[j]), nodes[i].max(nodes[j]));
                let tissue = block.tissue[element];
                shares.push(Share { key, tissue, block: index as u32, element: element as u32, part: 1.0 / 6.0 });
            }
        }
    }
    domains(tetrahedra, shares, "edge domain")
}

/// Smoothing domains around nodes: each gets an equal share of every element at the node.
///
/// `corners` returns the mesh nodes of an element, from its cell and its generalised nodes.
#[must_use]
pub fn node_domains(blocks: &[&ElementBlock], corners: impl Fn(MeshCell, &[u32]) -> Vec<u32>) -> Vec<ElementBlock> {
    let mut shares = Vec::new();
    for (index, block) in blocks.iter().enumerate() {
        for (element, nodes) in block.nodes.chunks_exact(block.n_functions).enumerate() {
            let corners = corners(block.cells[element], nodes);
            let part = 1.0 / corners.len() as f64;
            for node in corners {
                let tissue = block.tissue[element];
                shares.push(Share { key: (node, node), tissue, block: index as u32, element: element as u32, part });
            }
        }
    }
    domains(blocks, shares, "node domain")
}

/// Mean gradients of the elements with the same key and tissue.
pub(super) fn domains(blocks: &[&ElementBlock], mut shares: Vec<Share>, kind: &'static str) -> Vec<ElementBlock> {
    shares.sort_unstable_by_key(|s| (s.key, s.tissue, s.block, s.element));
    let mut out: Vec<ElementBlock> = SMOOTHED_WIDTHS.iter().map(|&n| ElementBlock::empty(kind, n, 1, 0)).collect();
    for same in shares.chunk_by(|a, b| (a.key, a.tissue) == (b.key, b.tissue)) {
        push_domain(blocks, same, &mut out);
    }
    out.retain(|b| b.n_elements() > 0);
    out
}

/// Appends the domain of some shares; a domain with too many nodes is divided in two.
fn push_domain(blocks: &[&ElementBlock], shares: &[Share], out: &mut [ElementBlock]) {
    let mut terms: Vec<(u32, Vector)> = Vec::new();
    let mut volume = 0.0;
    for share in shares {
        let (block, element) = (blocks[share.block as usize], share.element as usize);
        let (n, q) = (block.n_functions, block.n_points);
        let nodes = &block.nodes[element * n..(element + 1) * n];
        for point in element * q..(element + 1) * q {
            let weight = share.part * block.weights[point];
            volume += weight;
            let gradients = &block.gradients[point * n..(point + 1) * n];
            terms.extend(nodes.iter().zip(gradients).map(|(node, g)| (*node, g * weight)));
        }
    }
    // A stable sort keeps the sums in the order of the elements.
    terms.sort_by_key(|(node, _)| *node);
    let sums: Vec<(u32, Vector)> = terms
        .chunk_by(|a, b| a.0 == b.0)
        .map(|same| (same[0].0, same.iter().map(|(_, g)| g).sum::<Vector>() / volume))
        .collect();
    let Some(block) = out.iter_mut().find(|b| b.n_functions >= sums.len()) else {
        let (first, second) = shares.split_at(shares.len() / 2);
        if !first.is_empty() {
            push_domain(blocks, first, out);
            push_domain(blocks, second, out);
        }
        return;
    };
    let padding = block.n_functions - sums.len();
    block.nodes.extend(sums.iter().map(|(node, _)| *node));
    block.nodes.extend(std::iter::repeat_n(sums[0].0, padding));
    block.gradients.extend(sums.iter().map(|(_, g)| *g));
    block.gradients.extend(std::iter::repeat_n(Vector::zeros(), padding));
    block.weights.push(volume);
    block.tissue.push(shares[0].tissue);
    let first = &shares[0];
    block.cells.push(blocks[first.block as usize].cells[first.element as usize]);
}

#[cfg(test)]
mod tests {
    use super::super::linear::{tetrahedra, wedges};
    use super::super::sample_meshes::{height_field, prism};
    use super::*;
    use nalgebra::Matrix3;

    /// Domains add up to the volume and reproduce a linear field exactly; the edges of a tetrahedron give six domains.
    #[test]
    fn domains_keep_the_volume_and_linear_fields() {
        let mut mesh = prism(2.0, 3.0, 1.5, [0, 1, 2, 3, 4, 5]);
        mesh.tetrahedra = vec![[3, 4, 5, 1], [3, 5, 0, 1], [2, 1, 0, 5]];
        mesh.tetrahedron_tissue = vec![Tissue::Fat, Tissue::Fat, Tissue::Muscle];
        let a = Matrix3::new(1.2, 0.3, -0.1, 0.2, 0.9, 0.4, 0.0, -0.3, 1.1);
        let tetrahedra = tetrahedra(&mesh).unwrap();
        let edges = edge_domains(&[&tetrahedra]);
        let nodes = node_domains(&[&tetrahedra], |_, nodes| nodes.to_vec());
        // Nine edges of the two fat tetrahedra, six of the muscle; five and four nodes.
        for (blocks, count) in [(&edges, 9 + 6), (&nodes, 5 + 4)] {
            assert_eq!(blocks.iter().map(ElementBlock::n_elements).sum::<usize>(), count);
            let volume: f64 = blocks.iter().flat_map(|b| &b.weights).sum();
            assert!((volume - 4.5).abs() < 1e-14);
            for block in blocks {
                let n = block.n_functions;
                for (nodes, gradients) in block.nodes.chunks(n).zip(block.gradients.chunks(n)) {
                    let f: Matrix3<f64> = nodes
                        .iter()
                        .zip(gradients)
                        .map(|(node, g)| a * mesh.positions[*node as usize].coords * g.transpose())
                        .sum();
                    assert!((f - a).norm() < 1e-14);
                }
            }
        }
    }

    /// A node with more neighbours than the widest block holds gets several domains.
    #[test]
    fn crowded_nodes_get_several_domains() {
        let mesh = height_field(2, 1.0, |_, _| 0.0);
        let wedges = wedges(&mesh).unwrap();
        let block = ElementBlock { tissue: wedges.tissue.clone(), ..wedges };
        let everything = node_domains(&[&block], |_, _| vec![0]);
        assert!(everything.iter().all(|b| SMOOTHED_WIDTHS.contains(&b.n_functions)));
        let volume: f64 = everything.iter().flat_map(|b| &b.weights).sum();
        assert!((volume - block.weights.iter().sum::<f64>()).abs() < 1e-12);
        let wide = height_field(6, 1.0, |_, _| 0.0);
        let wedges = super::super::linear::wedges(&wide).unwrap();
        let several = node_domains(&[&wedges], |_, _| vec![0]);
        assert!(several.iter().map(ElementBlock::n_elements).sum::<usize>() > 1);
        let volume: f64 = several.iter().flat_map(|b| &b.weights).sum();
        assert!((volume - wedges.weights.iter().sum::<f64>()).abs() < 1e-12);
    }
}
