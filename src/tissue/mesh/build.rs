use std::collections::BTreeSet;

use rayon::prelude::*;

use super::adjacency::{BoundaryFace, boundary, sorted};
use super::classify::{Shape, assemble};
use super::domain::{Domain, InnerTissue, MeshSettings, Side};
use super::left_out::{LeftOut, LeftOutPrisms};
use super::parts::keep_large_parts;
use super::pockets::{Pockets, leave_out_pockets};
use super::press::press;
use super::prisms::PrismLayer;
use super::quality::smallest_sine;
use super::refine::{Refinement, SurfaceFace};
use super::refined_lattice::RefinedLattice;
use super::refinement_marks::mark_refinement;
use super::report::{MeshReport, report};
use super::slit::{Opened, OpenedSkin, Opening, Slit, close, drop_folded_when_closed};
use super::smooth::Relaxation;
use super::stuffing::{TetMesh, lattice_over, refine, stuff};
use super::tuning::{EDGE_SHARES, FACING_SKIN_COSINE, FLATTEST_CLOSED_SINE, PASSES, SMOOTHING_ROUNDS};
use super::{MeshError, MixedMesh};
use prosopon_geometry::control::{Cancelled, Control};
use prosopon_geometry::{Implicit, Warning};

/// Meshes the tissue by isosurface stuffing and adds a layer of prisms under the skin.
///
/// Inner boundary nodes that face bone start as [`Attachment::Sliding`](super::Attachment::Sliding), nodes on cuts of the
/// region as [`Attachment::Fixed`](super::Attachment::Fixed), and all others as [`Attachment::Free`](super::Attachment::Free).
///
/// When elements stay inverted, slightly shorter lattice edges are tried, and the report contains the warning
/// `mesh-edge-shortened`.
///
/// # Errors
/// [`MeshError`] for a setting out of range, no tissue, too many elements, elements that stay inverted, and cancellation.
/// A returned mesh has no inverted element.
///
/// # Source
/// Labelle and Shewchuk, Isosurface stuffing, SIGGRAPH 2007.
pub fn build(
    domain: &Domain<'_>,
    settings: &MeshSettings,
    control: &Control,
) -> Result<(MixedMesh, MeshReport), MeshError> {
    build_parted(domain, None, settings, control)
}

/// As [`build`], with the lips parted along `slit`.
///
/// Prisms stand on both red margins back to the teeth; [`MixedMesh::facing`] holds them. The two sides coincide at rest, with
/// different nodes. The edge of each lip is rounded, so that closed lips have a groove about a millimetre deep between them.
///
/// The report's volume and distance from the skin are those of the tissue opened by a few millimetres, as it is meshed.
///
/// # Errors
/// As [`build`].
pub fn build_parted(
    domain: &Domain<'_>,
    slit: Option<&Slit>,
    settings: &MeshSettings,
    control: &Control,
) -> Result<(MixedMesh, MeshReport), MeshError> {
    settings.check()?;
    let mut first = None;
    for share in EDGE_SHARES {
        let tried = MeshSettings { edge_mm: share * settings.edge_mm, ..*settings };
        match build_once(domain, slit, &tried, control) {
            Err(error @ MeshError::Inverted { .. }) => {
                first.get_or_insert(error);
            }
            Ok((mesh, mut report)) => {
                if let Some(error) = &first {
                    report.warnings.push(Warning::check(
                        "mesh-edge-shortened",
                        format!(
                            "the mesh has edges of {:.2} mm instead of {} mm, because with the requested edges {error}",
                            tried.edge_mm, settings.edge_mm
                        ),
                    ));
                }
                return Ok((mesh, report));
            }
            // Shorter edges may give too many elements.
            Err(MeshError::TooLarge { .. }) if first.is_some() => break,
            Err(error) => return Err(error),
        }
    }
    Err(first.unwrap_or(MeshError::NoTissue))
}

/// The mesh while it is built: tetrahedra, what their boundary nodes lie on, and the stuffed tissue's boundary.
struct Draft<'a, 'd> {
    inner: &'a InnerTissue<'d>,
    mesh: TetMesh,
    /// Surface of each boundary node; `None` inside.
    sides: Vec<Option<Side>>,
    /// Whether a node must stay in place.
    pinned: Vec<bool>,
    surface: Vec<SurfaceFace>,
}

fn build_once(
    domain: &Domain<'_>,
    slit: Option<&Slit>,
    settings: &MeshSettings,
    control: &Control,
) -> Result<(MixedMesh, MeshReport), MeshError> {
    let Some(slit) = slit else { return fill(domain, None, settings, control) };
    let opening = Opening::new(slit, settings.edge_mm);
    let open = |solid| Opened { solid, opening: &opening };
    let (skin, bone, air) = (OpenedSkin(open(domain.skin)), open(domain.bone), domain.air.map(open));
    let air = air.as_ref().map(|air| air as &dyn Implicit);
    let opened = Domain { skin: &skin, bone: &bone, air, ..*domain };
    let (mut mesh, mut quality) = fill(&opened, Some(&skin), settings, control)?;
    close(&mut mesh, &opening, &InnerTissue::new(domain, settings), control)?;
    let at_rest = report(&mesh, None, 0.0);
    if at_rest.inverted > 0 {
        return Err(first_inverted(&mesh, at_rest.inverted));
    }
    let corners = |t: &[u32; 4]| t.map(|n| mesh.positions[n as usize]);
    let flat: Vec<_> = mesh.tetrahedra.iter().filter(|t| smallest_sine(&corners(t)) < FLATTEST_CLOSED_SINE).collect();
    if let Some(first) = flat.first() {
        let centre = nalgebra::center(&corners(first)[0], &corners(first)[2]);
        return Err(MeshError::Inverted { count: flat.len(), x: centre.x, y: centre.y, z: centre.z });
    }
    quality.min_dihedral_deg = at_rest.min_dihedral_deg;
    quality.max_dihedral_deg = at_rest.max_dihedral_deg;
    quality.min_scaled_jacobian = at_rest.min_scaled_jacobian;
    quality.muscle_share = at_rest.muscle_share;
    Ok((mesh, quality))
}

/// Meshes a domain, whose skin is `opened` if given.
fn fill(
    domain: &Domain<'_>,
    opened: Option<&OpenedSkin<'_>>,
    settings: &MeshSettings,
    control: &Control,
) -> Result<(MixedMesh, MeshReport), MeshError> {
    let plain = InnerTissue::new(domain, settings).with_slit(opened);
    let lattice = lattice_over(&plain, settings.edge_mm)?;
    let marks = mark_refinement(&plain, &lattice, control)?;
    let inner = plain.with_thickness(marks.thickness.as_ref());
    let lattice = refine(lattice, marks.refined, settings.edge_mm)?;
    let mut draft = Draft::stuff(&inner, &lattice, &control.stage(0.0, 0.3))?;
    control.report(0.35);

    let (faces, holes) = draft.press(control)?;
    let (faces, pockets) = draft.leave_out_pockets(faces);
    draft.smooth(&faces, control)?;
    control.report(0.6);

    let (mut layer, lost) = draft.extrude(&holes);
    draft.follow_skin(&mut layer, control)?;
    let prisms = drop_bad_prisms(&draft, &mut layer, opened.map(|skin| skin.0.opening), lost);
    control.report(0.7);

    let loose = keep_large_parts(&mut draft.mesh, &mut layer);
    let mixed = draft.assemble(&layer);
    control.check()?;
    control.report(0.8);

    let mut quality = report(&mixed, Some((domain, settings)), pockets.volume_mm3);
    if quality.inverted > 0 {
        return Err(first_inverted(&mixed, quality.inverted));
    }
    quality.warnings = LeftOut { pockets, prisms, loose }.warnings(&mixed, settings.edge_mm);
    control.report(1.0);
    Ok((mixed, quality))
}

impl<'a, 'd> Draft<'a, 'd> {
    /// Fills the lattice and finds the faces below the skin.
    fn stuff(inner: &'a InnerTissue<'d>, lattice: &RefinedLattice, control: &Control) -> Result<Self, MeshError> {
        let mesh = stuff(inner, lattice, control)?;
        let faces = boundary(&mesh.tetrahedra);
        let sides = boundary_sides(inner, &mesh, &faces);
        let surface = surface_faces(inner, &mesh, &sides, &faces);
        if !surface.iter().any(|f| f.skin) {
            return Err(MeshError::NoTissue);
        }
        Ok(Self { inner, mesh, sides, pinned: Vec::new(), surface })
    }

    /// Presses thin tissue onto bone and air; returns the boundary and the nodes at holes of the skin layer.
    fn press(&mut self, control: &Control) -> Result<(Vec<BoundaryFace>, Vec<bool>), Cancelled> {
        let pressed = press(self.inner, &mut self.mesh, &self.sides, control)?;
        let faces = boundary(&self.mesh.tetrahedra);
        label_exposed(self.inner, &self.mesh, &faces, &mut self.sides);
        for (side, dropped) in self.sides.iter_mut().zip(&pressed.dropped) {
            if dropped.is_some() {
                *side = *dropped;
            }
        }
        self.pinned = pressed.dipping;
        Ok((faces, pressed.holes))
    }

    /// Removes pockets and labels the nodes of their necks; returns the boundary that remains.
    fn leave_out_pockets(&mut self, faces: Vec<BoundaryFace>) -> (Vec<BoundaryFace>, Pockets) {
        let under = under_skin(&self.surface, self.mesh.positions.len());
        let left_out = leave_out_pockets(self.inner, &mut self.mesh, &under);
        let faces = if left_out.tetrahedra > 0 { boundary(&self.mesh.tetrahedra) } else { faces };
        for &node in faces.iter().flat_map(|f| &f.nodes) {
            self.sides[node as usize].get_or_insert(Side::Neck);
        }
        (faces, left_out)
    }

    fn smooth(&mut self, faces: &[BoundaryFace], control: &Control) -> Result<(), Cancelled> {
        let mut relaxation = Relaxation::new(self.inner, &mut self.mesh, &self.sides, &self.pinned, faces);
        relaxation.towards_neighbours(SMOOTHING_ROUNDS, control)?;
        control.report(0.5);
        relaxation.improve(SMOOTHING_ROUNDS, control)
    }

    /// Sets prisms on the faces below the skin, except at holes.
    /// Returns their layer and the number of faces without an outer node.
    fn extrude(&mut self, holes: &[bool]) -> (PrismLayer, usize) {
        for face in &mut self.surface {
            face.skin &= !face.nodes.iter().any(|&n| holes[n as usize]);
        }
        let (layer, lost) = PrismLayer::extrude(self.inner, &self.mesh, &self.skin_faces());
        for face in &mut self.surface {
            face.skin &= face.nodes.iter().all(|&n| layer.outer_nodes[n as usize].is_some());
        }
        (layer, lost)
    }

    fn skin_faces(&self) -> Vec<[u32; 3]> {
        self.surface.iter().filter(|f| f.skin).map(|f| f.nodes).collect()
    }

    /// Repairs the prisms and splits edges until the outer triangles follow the skin.
    fn follow_skin(&mut self, layer: &mut PrismLayer, control: &Control) -> Result<(), MeshError> {
        layer.repair(self.inner, &mut self.mesh, &self.sides, control)?;
        layer.fit_outer_nodes(self.inner, &self.mesh, control)?;
        for _ in 0..PASSES {
            let mut refinement = Refinement {
                inner: self.inner,
                mesh: &mut self.mesh,
                sides: &mut self.sides,
                pinned: &mut self.pinned,
                faces: &mut self.surface,
                layer,
                refused: BTreeSet::new(),
            };
            if refinement.run(control)? == 0 {
                break;
            }
            layer.faces = self.skin_faces();
            let faces = boundary(&self.mesh.tetrahedra);
            Relaxation::new(self.inner, &mut self.mesh, &self.sides, &self.pinned, &faces)
                .improve(SMOOTHING_ROUNDS, control)?;
            layer.repair(self.inner, &mut self.mesh, &self.sides, control)?;
            layer.fit_outer_nodes(self.inner, &self.mesh, control)?;
        }
        Ok(())
    }

    fn assemble(&self, layer: &PrismLayer) -> MixedMesh {
        let mut stuffed_faces: Vec<[u32; 3]> = self.surface.iter().map(|f| sorted(f.nodes)).collect();
        stuffed_faces.sort_unstable();
        let Self { inner, mesh, sides, .. } = self;
        assemble(&Shape { inner, mesh, layer, sides, stuffed_faces: &stuffed_faces })
    }
}

/// Leaves out the prisms that are badly shaped or off the skin.
///
/// `lost` is the number of faces that got no prism because an outer node was missing; they count as folded.
fn drop_bad_prisms(
    draft: &Draft<'_, '_>,
    layer: &mut PrismLayer,
    opening: Option<&Opening<'_>>,
    lost: usize,
) -> LeftOutPrisms {
    let of = lost + layer.faces.len();
    let mut folded = lost + layer.drop_bad(&draft.mesh);
    folded += opening.map_or(0, |opening| drop_folded_when_closed(layer, &draft.mesh, opening));
    LeftOutPrisms { folded, off_skin: layer.drop_off_skin(draft.inner), of }
}

/// Surface on which each boundary node lies.
fn boundary_sides(inner: &InnerTissue<'_>, mesh: &TetMesh, faces: &[BoundaryFace]) -> Vec<Option<Side>> {
    let mut on_boundary = vec![false; mesh.positions.len()];
    for &node in faces.iter().flat_map(|f| &f.nodes) {
        on_boundary[node as usize] = true;
    }
    mesh.positions.par_iter().zip(&on_boundary).map(|(p, on)| on.then(|| inner.value_side(p).1)).collect()
}

/// Boundary faces of the stuffed tissue.
/// A face lies below the skin when all its nodes are on the skin side and it faces the skin.
fn surface_faces(
    inner: &InnerTissue<'_>,
    mesh: &TetMesh,
    sides: &[Option<Side>],
    faces: &[BoundaryFace],
) -> Vec<SurfaceFace> {
    let on_skin_side = |face: &BoundaryFace| {
        let [a, b, c] = face.nodes.map(|n| mesh.positions[n as usize]);
        face.nodes.iter().all(|&n| sides[n as usize] == Some(Side::Skin)) && {
            let normal = (b - a).cross(&(c - a));
            let gradient = inner.domain.skin.value_gradient(&nalgebra::center(&a, &nalgebra::center(&b, &c))).1;
            normal.dot(&gradient) > FACING_SKIN_COSINE * normal.norm() * gradient.norm()
        }
    };
    faces.par_iter().map(|f| SurfaceFace { nodes: f.nodes, skin: on_skin_side(f) }).collect()
}

fn under_skin(surface: &[SurfaceFace], n_nodes: usize) -> Vec<bool> {
    let mut under = vec![false; n_nodes];
    surface.iter().filter(|f| f.skin).flat_map(|f| f.nodes).for_each(|i| under[i as usize] = true);
    under
}

/// Assigns nodes that pressing exposed to the nearer of bone and air.
fn label_exposed(inner: &InnerTissue<'_>, mesh: &TetMesh, faces: &[BoundaryFace], sides: &mut [Option<Side>]) {
    for &node in faces.iter().flat_map(|f| &f.nodes) {
        let side = &mut sides[node as usize];
        if side.is_none() {
            *side = Some(inner.obstacle(&mesh.positions[node as usize]).1);
        }
    }
}

fn first_inverted(mesh: &MixedMesh, count: usize) -> MeshError {
    let centre = super::report::first_inverted_centre(mesh);
    MeshError::Inverted { count, x: centre.x, y: centre.y, z: centre.z }
}
