use rayon::prelude::*;

use super::adjacency::sorted;
use super::domain::{Domain, MeshSettings};
use super::quality::{dihedral_range, scaled_jacobian, tetrahedron_volume, wedge_determinants, wedge_volume};
use super::{MixedMesh, Tissue, volume};
use prosopon_geometry::{Implicit, Point, Vector, Warning};

/// Quality measures of a mesh.
#[derive(Debug, Clone, PartialEq)]
pub struct MeshReport {
    /// Number of tetrahedra.
    pub tetrahedra: usize,
    /// Number of prisms.
    pub prisms: usize,
    /// Number of nodes.
    pub nodes: usize,
    /// Number of inverted elements (0 in a mesh that [`build`](super::build) returns).
    pub inverted: usize,
    /// Smallest dihedral angle of a tetrahedron, degrees.
    pub min_dihedral_deg: f64,
    /// Largest dihedral angle of a tetrahedron, degrees.
    pub max_dihedral_deg: f64,
    /// Smallest scaled Jacobian of a prism, 0 to 1.
    pub min_scaled_jacobian: f64,
    /// Relative difference between the volumes of the mesh and the implicit domain.
    /// The omitted pockets are not part of the domain's volume.
    pub volume_error: f64,
    /// Largest distance of a prism's outer vertex or outer barycentre from the skin, mm.
    pub max_skin_distance_mm: f64,
    /// Boundary edges of the outer surface shared by more than two boundary faces.
    pub nonmanifold_edges: usize,
    /// Share of muscle in the volume of the tetrahedra, 0 to 1; the rest is fat.
    pub muscle_share: f64,
    /// Number of tetrahedra of cartilage; [`build`](super::build) places none.
    pub cartilage: usize,
    /// Whether a CT distinguished fat from muscle; otherwise the depth did.
    pub tissue_from_ct: bool,
    /// Deviations from the requested mesh.
    /// Codes: `mesh-pockets`, `mesh-prisms-left-out`, `mesh-loose-parts`, `mesh-edge-shortened`.
    pub warnings: Vec<Warning>,
}

prosopon_geometry::flat!(MeshReport {
    tetrahedra,
    prisms,
    nodes,
    inverted,
    min_dihedral_deg,
    max_dihedral_deg,
    min_scaled_jacobian,
    volume_error,
    max_skin_distance_mm,
    nonmanifold_edges,
    muscle_share,
    cartilage,
    tissue_from_ct,
    warnings,
});

/// Measures the quality of a mixed mesh.
///
/// The errors of volume and skin distance need the domain and the mesh's settings in `filled`; without them they are 0. The
/// domain's volume is that of the tissue connected with the skin layer less `left_out_mm3` (mm³), the volume of the pockets
/// that were omitted on purpose.
#[must_use]
pub fn report(mesh: &MixedMesh, filled: Option<(&Domain<'_>, &MeshSettings)>, left_out_mm3: f64) -> MeshReport {
    let mut out = MeshReport {
        tetrahedra: mesh.tetrahedra.len(),
        prisms: mesh.prisms.len(),
        nodes: mesh.positions.len(),
        inverted: 0,
        min_dihedral_deg: 180.0,
        max_dihedral_deg: 0.0,
        min_scaled_jacobian: 1.0,
        volume_error: 0.0,
        max_skin_distance_mm: 0.0,
        nonmanifold_edges: nonmanifold_edges(mesh),
        muscle_share: 0.0,
        cartilage: mesh.tetrahedron_tissue.iter().filter(|t| **t == Tissue::Cartilage).count(),
        tissue_from_ct: filled.is_some_and(|(domain, _)| domain.soft_tissue.is_some()),
        warnings: Vec::new(),
    };
    let (mut filled_volume, mut muscle) = (0.0, 0.0);
    for t in 0..mesh.tetrahedra.len() {
        let p = tetrahedron(mesh, t);
        let (least, most) = dihedral_range(&p);
        out.min_dihedral_deg = out.min_dihedral_deg.min(least);
        out.max_dihedral_deg = out.max_dihedral_deg.max(most);
        out.inverted += usize::from(tetrahedron_inverted(&p));
        filled_volume += tetrahedron_volume(&p);
        if mesh.tetrahedron_tissue.get(t) == Some(&Tissue::Muscle) {
            muscle += tetrahedron_volume(&p);
        }
    }
    out.muscle_share = if filled_volume > 0.0 { muscle / filled_volume } else { 0.0 };
    for w in 0..mesh.prisms.len() {
        let p = prism(mesh, w);
        out.min_scaled_jacobian = out.min_scaled_jacobian.min(scaled_jacobian(&p));
        out.inverted += usize::from(prism_inverted(&p));
        filled_volume += wedge_volume(&p);
    }
    if let Some((domain, settings)) = filled {
        let expected = volume::of_tissue(domain, settings) - left_out_mm3;
        out.volume_error = if expected > 0.0 { filled_volume / expected - 1.0 } else { 0.0 };
        out.max_skin_distance_mm = skin_distance(mesh, domain.skin);
    }
    out
}

/// Volume of all elements, mm³.
pub(super) fn volume_mm3(mesh: &MixedMesh) -> f64 {
    let tetrahedra = (0..mesh.tetrahedra.len()).map(|t| tetrahedron_volume(&tetrahedron(mesh, t)));
    tetrahedra.chain((0..mesh.prisms.len()).map(|w| wedge_volume(&prism(mesh, w)))).sum()
}

fn tetrahedron(mesh: &MixedMesh, t: usize) -> [Point; 4] {
    mesh.tetrahedra[t].map(|i| mesh.positions[i as usize])
}

fn prism(mesh: &MixedMesh, w: usize) -> [Point; 6] {
    mesh.prisms[w].map(|i| mesh.positions[i as usize])
}

#[expect(clippy::neg_cmp_op_on_partial_ord, reason = "NaN counts as inverted")]
fn tetrahedron_inverted(p: &[Point; 4]) -> bool {
    !(tetrahedron_volume(p) > 0.0)
}

fn prism_inverted(p: &[Point; 6]) -> bool {
    !(scaled_jacobian(p) > 0.0 && wedge_determinants(p).iter().all(|d| *d > 0.0))
}

/// Centre of the first inverted element; the origin when there is none.
pub(super) fn first_inverted_centre(mesh: &MixedMesh) -> Point {
    let mean = |p: &[Point]| Point::from(p.iter().map(|q| q.coords).sum::<Vector>() / p.len() as f64);
    let tetrahedra = (0..mesh.tetrahedra.len()).map(|t| tetrahedron(mesh, t));
    if let Some(p) = tetrahedra.filter(tetrahedron_inverted).map(|p| mean(&p)).next() {
        return p;
    }
    let prisms = (0..mesh.prisms.len()).map(|w| prism(mesh, w));
    prisms.filter(prism_inverted).map(|p| mean(&p)).next().unwrap_or_else(Point::origin)
}

fn nonmanifold_edges(mesh: &MixedMesh) -> usize {
    let mut edges: Vec<[u32; 2]> =
        mesh.prisms.iter().flat_map(|p| [[p[0], p[1]], [p[1], p[2]], [p[2], p[0]]]).map(sorted).collect();
    edges.sort_unstable();
    edges.chunk_by(|a, b| a == b).filter(|same| same.len() > 2).count()
}

/// Largest distance of an outer vertex or outer barycentre from the skin, mm.
fn skin_distance(mesh: &MixedMesh, skin: &dyn Implicit) -> f64 {
    let distances: Vec<f64> = mesh
        .prisms
        .par_iter()
        .map(|p| {
            let [a, b, c] = [p[0], p[1], p[2]].map(|i| mesh.positions[i as usize]);
            let barycentre = Point::from((a.coords + b.coords + c.coords) / 3.0);
            [a, b, c, barycentre].iter().map(|q| skin.value(q).abs()).fold(0.0, f64::max)
        })
        .collect();
    distances.into_iter().fold(0.0, f64::max)
}
