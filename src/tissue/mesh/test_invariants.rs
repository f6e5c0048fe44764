//! Invariants of a mixed mesh, computed from its nodes and cells alone.

use std::collections::{BTreeMap, BTreeSet};

use super::{Attachment, MixedMesh, Tissue, boundary_triangles};
use prosopon_geometry::{Aabb, Point, Vector};

/// What the cells of a mesh amount to, recomputed without the functions that build and report it.
#[derive(Debug, Clone)]
pub(super) struct Measured {
    pub(super) volume: f64,
    pub(super) smallest_volume: f64,
    pub(super) tetrahedra_volume: f64,
    pub(super) muscle_volume: f64,
    /// Smallest and largest dihedral angle of a tetrahedron, degrees.
    pub(super) dihedral_deg: (f64, f64),
    pub(super) scaled_jacobian: f64,
    /// Cells that share triangles or sides form this many groups.
    pub(super) components: usize,
    /// Edges with more than two outer triangles.
    pub(super) crowded_outer_edges: usize,
    /// Share of the boundary's edges that have more than two triangles.
    pub(super) crowded_share: f64,
    /// Nodes inside a cell that does not have them as a corner.
    pub(super) overlaps: usize,
}

/// Checks all that holds for a mesh whatever its domain, and measures the rest.
pub(super) fn measure(name: &str, mesh: &MixedMesh) -> Measured {
    every_node_is_used(name, mesh);
    let components = faces_match(name, mesh);
    let crowded_share = boundary_is_closed(name, mesh);
    labels_agree(name, mesh);
    let corners = |nodes: &[u32]| nodes.iter().map(|&i| mesh.positions[i as usize]).collect::<Vec<_>>();
    let tetrahedra: Vec<f64> = mesh.tetrahedra.iter().map(|t| enclosed(&corners(t), &TETRAHEDRON)).collect();
    let prisms: Vec<f64> = mesh.prisms.iter().map(|p| prism_volume(&corners(p))).collect();
    let muscle = tetrahedra.iter().zip(&mesh.tetrahedron_tissue).filter(|(_, t)| **t == Tissue::Muscle);
    let mut dihedral_deg = (180.0f64, 0.0f64);
    for t in &mesh.tetrahedra {
        for angle in dihedral_angles(&corners(t)) {
            dihedral_deg = (dihedral_deg.0.min(angle), dihedral_deg.1.max(angle));
        }
    }
    let mut outer: BTreeMap<[u32; 2], usize> = BTreeMap::new();
    for &[a, b, c, ..] in &mesh.prisms {
        for [i, j] in [[a, b], [b, c], [c, a]] {
            *outer.entry([i.min(j), i.max(j)]).or_default() += 1;
        }
    }
    Measured {
        volume: tetrahedra.iter().chain(&prisms).sum(),
        smallest_volume: tetrahedra.iter().chain(&prisms).copied().fold(f64::INFINITY, f64::min),
        tetrahedra_volume: tetrahedra.iter().sum(),
        muscle_volume: muscle.map(|(v, _)| v).sum(),
        dihedral_deg,
        scaled_jacobian: mesh.prisms.iter().map(|p| scaled_jacobian(&corners(p))).fold(1.0, f64::min),
        components,
        crowded_outer_edges: outer.values().filter(|n| **n > 2).count(),
        crowded_share,
        overlaps: overlaps(mesh),
    }
}

/// Faces of a tetrahedron of positive volume, counter-clockwise seen from outside.
const TETRAHEDRON: [[usize; 3]; 4] = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
/// Triangles of a prism (outer, inner) and its sides, counter-clockwise seen from outside.
const ENDS: [[usize; 3]; 2] = [[0, 1, 2], [3, 5, 4]];
const SIDES: [[usize; 4]; 3] = [[0, 3, 4, 1], [1, 4, 5, 2], [2, 5, 3, 0]];

/// Volume that flat triangles enclose, mm³ (divergence theorem).
fn enclosed(p: &[Point], triangles: &[[usize; 3]]) -> f64 {
    let cone = |[a, b, c]: &[usize; 3]| (p[*a] - p[0]).cross(&(p[*b] - p[0])).dot(&(p[*c] - p[0])) / 6.0;
    triangles.iter().map(cone).sum()
}

/// Volume of a prism with bilinear sides: the mean over both diagonals of each side.
fn prism_volume(p: &[Point]) -> f64 {
    let split = |first: bool| {
        let halves = |[a, b, c, d]: [usize; 4]| if first { [[a, b, c], [a, c, d]] } else { [[a, b, d], [b, c, d]] };
        let all: Vec<[usize; 3]> = ENDS.into_iter().chain(SIDES.into_iter().flat_map(halves)).collect();
        enclosed(p, &all)
    };
    0.5 * (split(true) + split(false))
}

/// The six dihedral angles in degrees, from the outward normals of the faces.
fn dihedral_angles(p: &[Point]) -> Vec<f64> {
    let normals = TETRAHEDRON.map(|[a, b, c]| (p[b] - p[a]).cross(&(p[c] - p[a])));
    let pairs = [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]];
    pairs.map(|[i, j]| 180.0 - normals[i].angle(&normals[j]).to_degrees()).to_vec()
}

/// Smallest determinant of unit edges at the six corners, relative to that of a right prism on a regular triangle.
fn scaled_jacobian(p: &[Point]) -> f64 {
    let at = |corner: usize| {
        let (base, i) = (corner / 3 * 3, corner % 3);
        let edges = [p[base + (i + 1) % 3] - p[corner], p[base + (i + 2) % 3] - p[corner], p[i] - p[i + 3]];
        nalgebra::Matrix3::from_columns(&edges.map(|e| e.normalize())).determinant() / 60f64.to_radians().sin()
    };
    (0..6).map(at).fold(1.0, f64::min)
}

fn every_node_is_used(name: &str, mesh: &MixedMesh) {
    let n = mesh.positions.len();
    assert_eq!((mesh.attachment.len(), mesh.tetrahedron_tissue.len()), (n, mesh.tetrahedra.len()), "{name}");
    assert!(mesh.positions.iter().all(|p| p.iter().all(|x| x.is_finite())), "{name}");
    let cells = || mesh.tetrahedra.iter().map(|t| &t[..]).chain(mesh.prisms.iter().map(|p| &p[..]));
    let used: BTreeSet<u32> = cells().flatten().copied().collect();
    assert!(used.iter().copied().eq(0..n as u32), "{name}: {} of {n} nodes are used", used.len());
    for cell in cells() {
        assert_eq!(cell.iter().collect::<BTreeSet<_>>().len(), cell.len(), "{name}: a cell uses a node twice");
    }
}

/// Node numbers in the order of `face`, starting with the smallest.
fn from_smallest<const N: usize>(mut face: [u32; N]) -> [u32; N] {
    let at = (0..N).min_by_key(|&i| face[i]).unwrap_or(0);
    face.rotate_left(at);
    face
}

/// Every face belongs to one or two cells, two see it from opposite sides, and outer triangles belong to one.
/// Returns the number of groups of cells that share faces.
fn faces_match(name: &str, mesh: &MixedMesh) -> usize {
    let mut triangles: BTreeMap<[u32; 3], Vec<([u32; 3], usize)>> = BTreeMap::new();
    let mut quads: BTreeMap<[u32; 4], Vec<([u32; 4], usize)>> = BTreeMap::new();
    let n_tets = mesh.tetrahedra.len();
    let sorted = |mut t: [u32; 3]| {
        t.sort_unstable();
        t
    };
    for (cell, t) in mesh.tetrahedra.iter().enumerate() {
        for face in TETRAHEDRON.map(|f| f.map(|i| t[i])) {
            triangles.entry(sorted(face)).or_default().push((face, cell));
        }
    }
    for (prism, p) in mesh.prisms.iter().enumerate() {
        for face in ENDS.map(|f| f.map(|i| p[i])) {
            triangles.entry(sorted(face)).or_default().push((face, n_tets + prism));
        }
        for face in SIDES.map(|f| f.map(|i| p[i])) {
            let mut key = face;
            key.sort_unstable();
            quads.entry(key).or_default().push((face, n_tets + prism));
        }
        let outer = sorted([p[0], p[1], p[2]]);
        assert!(triangles[&outer].len() == 1, "{name}: an outer triangle is inside the mesh");
    }
    let mut joined: Vec<(usize, usize)> = Vec::new();
    for cells in triangles.values().filter(|cells| cells.len() > 1) {
        let [(a, first), (b, second)] = cells[..] else { panic!("{name}: {cells:?} share a triangle") };
        assert_eq!(from_smallest(a), from_smallest([b[0], b[2], b[1]]), "{name}: cells overlap at a triangle");
        joined.push((first, second));
    }
    for cells in quads.values().filter(|cells| cells.len() > 1) {
        let [(a, first), (b, second)] = cells[..] else { panic!("{name}: {cells:?} share a side") };
        assert_eq!(from_smallest(a), from_smallest([b[0], b[3], b[2], b[1]]), "{name}: prisms overlap at a side");
        joined.push((first, second));
    }
    // Two tetrahedra that cover a prism's side by two triangles would not deform like its bilinear surface.
    for (quad, _) in quads.iter().filter(|(_, cells)| cells.len() == 1) {
        let covers = (0..4).filter(|left_out| {
            let half: Vec<u32> = (0..4).filter(|i| i != left_out).map(|i| quad[i]).collect();
            triangles.contains_key(&[half[0], half[1], half[2]])
        });
        assert!(covers.count() < 2, "{name}: tetrahedra cover the side {quad:?} of a prism");
    }
    n_groups(n_tets + mesh.prisms.len(), &joined)
}

fn n_groups(n: usize, joined: &[(usize, usize)]) -> usize {
    let mut next: Vec<Vec<usize>> = vec![Vec::new(); n];
    for &(a, b) in joined {
        next[a].push(b);
        next[b].push(a);
    }
    let mut seen = vec![false; n];
    let mut count = 0;
    for start in 0..n {
        if seen[start] {
            continue;
        }
        count += 1;
        seen[start] = true;
        let mut stack = vec![start];
        while let Some(cell) = stack.pop() {
            for &other in &next[cell] {
                if !seen[other] {
                    seen[other] = true;
                    stack.push(other);
                }
            }
        }
    }
    count
}

/// Every boundary edge is used as often in one direction as in the other; returns the share of edges used more than once.
fn boundary_is_closed(name: &str, mesh: &MixedMesh) -> f64 {
    let mut edges: BTreeMap<[u32; 2], (usize, usize)> = BTreeMap::new();
    for [a, b, c] in boundary_triangles(mesh) {
        for [i, j] in [[a, b], [b, c], [c, a]] {
            let count = edges.entry([i.min(j), i.max(j)]).or_default();
            if i < j { count.0 += 1 } else { count.1 += 1 }
        }
    }
    for (edge, (forth, back)) in &edges {
        assert_eq!(forth, back, "{name}: the boundary is open at {edge:?}");
    }
    edges.values().filter(|(forth, _)| *forth > 1).count() as f64 / edges.len() as f64
}

/// Nodes sorted into cubes.
struct Bins<'a> {
    mesh: &'a MixedMesh,
    nodes: BTreeMap<[i32; 3], Vec<u32>>,
}

impl<'a> Bins<'a> {
    fn of(mesh: &'a MixedMesh) -> Self {
        let mut nodes: BTreeMap<[i32; 3], Vec<u32>> = BTreeMap::new();
        for (i, p) in mesh.positions.iter().enumerate() {
            nodes.entry(Self::bin(p)).or_default().push(i as u32);
        }
        Self { mesh, nodes }
    }

    fn bin(p: &Point) -> [i32; 3] {
        const CELL: f64 = 4.0;
        [0, 1, 2].map(|a| (p[a] / CELL).floor() as i32)
    }

    /// The nodes in the box of some points, grown by `margin`.
    fn near(&self, corners: &[Point], margin: f64) -> Vec<u32> {
        let Some(bounds) = Aabb::of(corners).map(|b| b.grown(margin)) else { return Vec::new() };
        let (low, high) = (Self::bin(&bounds.min), Self::bin(&bounds.max));
        let mut found = Vec::new();
        for k in low[2]..=high[2] {
            for j in low[1]..=high[1] {
                let nodes = (low[0]..=high[0]).filter_map(|i| self.nodes.get(&[i, j, k])).flatten();
                found.extend(nodes.filter(|n| bounds.contains(&self.mesh.positions[**n as usize])));
            }
        }
        found
    }
}

/// No node lies in a boundary triangle, or on its edge, that does not have it as a corner.
pub(super) fn no_node_hangs(name: &str, mesh: &MixedMesh) {
    const NEAR: f64 = 1e-7;
    let bins = Bins::of(mesh);
    for triangle in boundary_triangles(mesh) {
        let p = triangle.map(|i| mesh.positions[i as usize]);
        for node in bins.near(&p, NEAR) {
            let q = &mesh.positions[node as usize];
            let weights = weights_in(q, &p);
            let off = q.coords - p[0].coords * weights.x - p[1].coords * weights.y - p[2].coords * weights.z;
            let hangs = !triangle.contains(&node) && off.norm() < NEAR && weights.min() > -1e-9;
            assert!(!hangs, "{name}: node {node} at {q} hangs in the triangle {triangle:?}");
        }
    }
}

/// The number of nodes inside a cell that does not have them as a corner.
fn overlaps(mesh: &MixedMesh) -> usize {
    let bins = Bins::of(mesh);
    let mut inside: BTreeSet<u32> = BTreeSet::new();
    let split = |&[a, b, c, d, e, f]: &[u32; 6]| [[d, e, f, a], [e, f, a, b], [f, a, b, c]];
    let prisms = mesh.prisms.iter().flat_map(|p| split(p).map(|t| (t, &p[..])));
    for (t, cell) in mesh.tetrahedra.iter().map(|t| (*t, &t[..])).chain(prisms) {
        let p = t.map(|i| mesh.positions[i as usize]);
        let whole = enclosed(&p, &TETRAHEDRON);
        for node in bins.near(&p, 0.0).into_iter().filter(|n| !cell.contains(n)) {
            let share = |corner: usize| {
                let mut part = p;
                part[corner] = mesh.positions[node as usize];
                enclosed(&part, &TETRAHEDRON) / whole
            };
            if (0..4).all(|corner| share(corner) > 1e-3) {
                inside.insert(node);
            }
        }
    }
    inside.len()
}

/// Barycentric coordinates of the projection of `q` onto the plane of a triangle.
fn weights_in(q: &Point, [a, b, c]: &[Point; 3]) -> Vector {
    let normal = (b - a).cross(&(c - a));
    let share = |from: &Point, to: &Point| (from - q).cross(&(to - q)).dot(&normal) / normal.norm_squared();
    Vector::new(share(b, c), share(c, a), share(a, b))
}

/// Bone faces are boundary triangles, sliding nodes lie on them, and nodes at the depth limit are fixed.
fn labels_agree(name: &str, mesh: &MixedMesh) {
    let boundary: BTreeSet<[u32; 3]> = boundary_triangles(mesh).into_iter().map(from_smallest).collect();
    let at_bone: BTreeSet<u32> = mesh.bone_faces.iter().flatten().copied().collect();
    let outer: BTreeSet<u32> = mesh.prisms.iter().flat_map(|p| [p[0], p[1], p[2]]).collect();
    for face in &mesh.bone_faces {
        assert!(boundary.contains(&from_smallest(*face)), "{name}: {face:?} faces bone inside the mesh");
    }
    for (node, attachment) in mesh.attachment.iter().enumerate() {
        let node = node as u32;
        match attachment {
            Attachment::Sliding => assert!(at_bone.contains(&node) && !outer.contains(&node), "{name}: node {node}"),
            Attachment::Free => assert!(!at_bone.contains(&node), "{name}: node {node} at bone is free"),
            Attachment::Fixed => {}
            Attachment::Tied(_) | Attachment::Gliding(_) => {
                panic!("{name}: node {node} is tied to a segment before there are any")
            }
        }
    }
    assert!(mesh.depth_cut_nodes.is_sorted_by(|a, b| a < b), "{name}");
    assert!(mesh.depth_cut_nodes.iter().all(|&n| mesh.attachment[n as usize] == Attachment::Fixed), "{name}");
}
