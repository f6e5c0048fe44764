//! Parts of the mesh that hang together by faces.

use super::adjacency::{groups, shared_faces, sorted};
use super::prisms::Layer;
use super::stuffing::TetMesh;

/// A part with prisms but fewer elements than this share of the largest part goes too: it would float.
const CRUMB: f64 = 0.01;

/// Keeps the parts that carry prisms and are no crumbs; returns what went.
pub(super) fn keep_large_parts(mesh: &mut TetMesh, layer: &mut Layer) -> Vec<String> {
    let (n_tets, n_prisms) = (mesh.tetrahedra.len(), layer.faces.len());
    let (mut pairs, _) = shared_faces(&mesh.tetrahedra);
    // Prisms join through their side faces (edges of the triangles) and to the tetrahedron below.
    let mut edges: Vec<([u32; 2], u32)> = Vec::new();
    let mut triangles: Vec<([u32; 3], u32)> = Vec::new();
    for (f, face) in layer.faces.iter().enumerate() {
        let element = (n_tets + f) as u32;
        for i in 0..3 {
            edges.push((sorted([face[i], face[(i + 1) % 3]]), element));
        }
        triangles.push((sorted(*face), element));
    }
    edges.sort_unstable();
    triangles.sort_unstable();
    pairs.extend(edges.windows(2).filter(|w| w[0].0 == w[1].0).map(|w| [w[0].1, w[1].1]));
    for face in super::adjacency::boundary(&mesh.tetrahedra) {
        if let Ok(at) = triangles.binary_search_by_key(&sorted(face.nodes), |t| t.0) {
            pairs.push([face.tetrahedron, triangles[at].1]);
        }
    }
    let part = groups(n_tets + n_prisms, pairs.into_iter());
    let n_parts = part.iter().max().map_or(0, |p| *p as usize + 1);
    let mut sizes = vec![0usize; n_parts];
    let mut carries = vec![false; n_parts];
    for (element, &p) in part.iter().enumerate() {
        sizes[p as usize] += 1;
        carries[p as usize] |= element >= n_tets;
    }
    let largest = (0..n_parts).filter(|&p| carries[p]).map(|p| sizes[p]).max().unwrap_or(0);
    let keep = |element: usize| {
        let p = part[element] as usize;
        carries[p] && sizes[p] as f64 >= CRUMB * largest as f64
    };
    let mut index = 0;
    mesh.tetrahedra.retain(|_| {
        index += 1;
        keep(index - 1)
    });
    layer.faces.retain(|_| {
        index += 1;
        keep(index - 1)
    });
    let gone: Vec<usize> =
        (0..n_parts).filter(|&p| !carries[p] || (sizes[p] as f64) < CRUMB * largest as f64).collect();
    if gone.is_empty() {
        return Vec::new();
    }
    let elements: usize = gone.iter().map(|&p| sizes[p]).sum();
    vec![format!("{} parts that do not hang together with the skin were dropped ({elements} elements)", gone.len())]
}
