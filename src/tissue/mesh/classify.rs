use super::adjacency::{BoundaryFace, boundary, sorted};
use super::domain::{InnerTissue, Side};
use super::prisms::PrismLayer;
use super::stuffing::TetMesh;
use super::tuning::{FAT_BELOW_HU, MUSCLE_SHARE};
use super::{Attachment, MixedMesh, Tissue};
use prosopon_geometry::{Aabb, Implicit, Point};

/// Parts from which a mesh is assembled.
pub(super) struct Shape<'a, 'd> {
    pub(super) inner: &'a InnerTissue<'d>,
    pub(super) mesh: &'a TetMesh,
    pub(super) layer: &'a PrismLayer,
    pub(super) sides: &'a [Option<Side>],
    /// Boundary faces after stuffing (sorted nodes, ascending).
    /// Faces that appeared later were exposed above bone or air.
    pub(super) stuffed_faces: &'a [[u32; 3]],
}

/// Numbers the nodes in use (inner nodes in their order, then outer nodes) and labels faces, nodes and tissue.
pub(super) fn assemble(shape: &Shape<'_, '_>) -> MixedMesh {
    let Shape { inner, mesh, layer, .. } = *shape;
    let n = mesh.positions.len();
    let mut used = vec![false; n];
    let mut has_outer = vec![false; n];
    for &node in mesh.tetrahedra.iter().flatten() {
        used[node as usize] = true;
    }
    for &node in layer.faces.iter().flatten() {
        used[node as usize] = true;
        has_outer[node as usize] = true;
    }
    let mut positions = Vec::new();
    let mut number = vec![u32::MAX; n];
    for node in (0..n).filter(|&i| used[i]) {
        number[node] = positions.len() as u32;
        positions.push(mesh.positions[node]);
    }
    let mut outer = vec![u32::MAX; n];
    for node in (0..n).filter(|&i| has_outer[i]) {
        outer[node] = positions.len() as u32;
        positions.push(layer.outer_nodes[node].map_or(mesh.positions[node], |foot| foot.point));
    }
    let renumber = |nodes: [u32; 3]| nodes.map(|i| number[i as usize]);
    let labels = Labels::of(shape);

    let mut attachment = vec![Attachment::Free; positions.len()];
    let mut bone_faces = Vec::new();
    let mut depth_cut_nodes = Vec::new();
    for (face, side) in &labels.faces {
        let face = renumber(*face);
        match side {
            Side::Bone => {
                bone_faces.push(face);
                for &node in &face {
                    if attachment[node as usize] == Attachment::Free {
                        attachment[node as usize] = Attachment::Sliding;
                    }
                }
            }
            Side::Region | Side::Depth => face.iter().for_each(|&i| attachment[i as usize] = Attachment::Fixed),
            Side::Skin | Side::Air | Side::Neck => {}
        }
        if *side == Side::Depth {
            depth_cut_nodes.extend(face);
        }
    }
    for &[a, b] in &labels.cut_edges {
        for node in [number[a as usize], number[b as usize], outer[a as usize], outer[b as usize]] {
            attachment[node as usize] = Attachment::Fixed;
        }
    }
    depth_cut_nodes.sort_unstable();
    depth_cut_nodes.dedup();
    let tetrahedra: Vec<[u32; 4]> = mesh.tetrahedra.iter().map(|t| t.map(|i| number[i as usize])).collect();
    let prisms = layer.faces.iter().map(|f| {
        let ([a, b, c], [d, e, g]) = (f.map(|i| outer[i as usize]), renumber(*f));
        [a, b, c, d, e, g]
    });
    MixedMesh {
        tetrahedron_tissue: tetrahedra.iter().map(|t| tissue_at(inner, t.map(|i| positions[i as usize]))).collect(),
        prisms: prisms.collect(),
        prism_tissue: Vec::new(),
        tetrahedra,
        positions,
        bone_faces,
        attachment,
        depth_cut_nodes,
        facing: Vec::new(),
    }
}

/// Boundary faces (outward) with the surface they lie on, and edges below the prisms' sides on the region's cut.
struct Labels {
    faces: Vec<([u32; 3], Side)>,
    cut_edges: Vec<[u32; 2]>,
}

impl Labels {
    fn of(shape: &Shape<'_, '_>) -> Self {
        let Shape { inner, mesh, layer, .. } = *shape;
        let mut covered: Vec<[u32; 3]> = layer.faces.iter().map(|f| sorted(*f)).collect();
        covered.sort_unstable();
        let bounding = boundary(&mesh.tetrahedra);
        let mut faces = Vec::new();
        for BoundaryFace { nodes, .. } in &bounding {
            if covered.binary_search(&sorted(*nodes)).is_err() {
                faces.push((*nodes, face_side(shape, *nodes)));
            }
        }
        // Prisms without a tetrahedron below stand on bone or air; their inner triangle faces inwards.
        let mut below: Vec<[u32; 3]> = bounding.iter().map(|f| sorted(f.nodes)).collect();
        below.sort_unstable();
        for face in &layer.faces {
            if below.binary_search(&sorted(*face)).is_err() {
                let inwards = [face[0], face[2], face[1]];
                faces.push((inwards, inner.obstacle(&centre(mesh, *face)).1));
            }
        }
        let mut edges: Vec<[u32; 2]> =
            layer.faces.iter().flat_map(|f| [0, 1, 2].map(|i| sorted([f[i], f[(i + 1) % 3]]))).collect();
        edges.sort_unstable();
        let near_cut = |node: u32| inner.domain.region.value_gradient(&mesh.positions[node as usize]).0 > -inner.edge;
        let cut_edges = edges
            .chunk_by(|a, b| a == b)
            .filter(|same| same.len() == 1 && same[0].iter().all(|&i| near_cut(i)))
            .map(|same| same[0])
            .collect();
        Self { faces, cut_edges }
    }
}

fn centre(mesh: &TetMesh, nodes: [u32; 3]) -> Point {
    Point::from(nodes.iter().map(|&i| mesh.positions[i as usize].coords).sum::<prosopon_geometry::Vector>() / 3.0)
}

/// Surface on which an uncovered boundary face lies: cuts first, then the nearer of bone and air. It is the skin side where a
/// prism was left out.
fn face_side(shape: &Shape<'_, '_>, nodes: [u32; 3]) -> Side {
    let has = |side: Side| nodes.iter().any(|&i| shape.sides[i as usize] == Some(side));
    if let Some(side) = [Side::Region, Side::Depth, Side::Neck].into_iter().find(|s| has(*s)) {
        return side;
    }
    let all_skin = nodes.iter().all(|&i| shape.sides[i as usize] == Some(Side::Skin));
    if all_skin && shape.stuffed_faces.binary_search(&sorted(nodes)).is_ok() {
        return Side::Skin;
    }
    shape.inner.obstacle(&centre(shape.mesh, nodes)).1
}

/// Tissue from the CT's mean over the tetrahedron.
/// Where the CT has no value, tissue is muscle near the bone and fat above it.
pub(super) fn tissue_at(inner: &InnerTissue<'_>, corners: [Point; 4]) -> Tissue {
    let p = corners.iter().fold(Point::origin(), |s, c| s + c.coords * 0.25);
    if let Some(hu) = inner.domain.soft_tissue {
        let places = corners.iter().map(|c| p + 0.5 * (c - p)).chain([p]);
        let known: Vec<f64> = places.map(|q| hu.sample(&q)).filter(|v| v.is_finite()).collect();
        if !known.is_empty() {
            let mean = known.iter().sum::<f64>() / known.len() as f64;
            return if mean < FAT_BELOW_HU { Tissue::Fat } else { Tissue::Muscle };
        }
    }
    let to_skin = -inner.domain.skin.value(&p);
    let to_bone = inner.domain.bone.value(&p).max(0.0);
    if to_bone < MUSCLE_SHARE * (to_skin + to_bone) { Tissue::Muscle } else { Tissue::Fat }
}

/// Ties nodes that slide on bone to the nearest segment whose solid lies within `tie_gap_mm`.
/// Nodes inside one of the boxes `sliding` remain sliding. The segments' solids must be at rest, like the mesh. Of equally near
/// segments the first one is used.
pub fn tie(mesh: &mut MixedMesh, segments: &[(u32, &dyn Implicit)], tie_gap_mm: f64, sliding: &[Aabb]) {
    for (attachment, p) in mesh.attachment.iter_mut().zip(&mesh.positions) {
        if *attachment != Attachment::Sliding || sliding.iter().any(|b| b.contains(p)) {
            continue;
        }
        let mut nearest: Option<(f64, u32)> = None;
        for (segment, solid) in segments {
            let gap = solid.value(p);
            if gap <= tie_gap_mm && nearest.is_none_or(|(least, _)| gap < least) {
                nearest = Some((gap, *segment));
            }
        }
        if let Some((_, segment)) = nearest {
            *attachment = Attachment::Tied(segment);
        }
    }
}
