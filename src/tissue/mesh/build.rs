use std::collections::BTreeSet;

use rayon::prelude::*;

use super::adjacency::{BoundaryFace, boundary, sorted};
use super::classify::{Shape, assemble};
use super::domain::{Domain, InnerTissue, MeshSettings, Side};
use super::grading::grade;
use super::parts::keep_large_parts;
use super::pockets::leave_out_pockets;
use super::prisms::Layer;
use super::refine::{Refinement, SurfaceFace};
use super::report::{MeshReport, report};
use super::smooth::Relaxation;
use super::stuffing::{TetMesh, halve, lattice_over, stuff};
use super::thin::press;
use super::{MeshError, MixedMesh};
use prosopon_geometry::control::Control;

/// Smallest cosine between a boundary face's normal and the skin's at which the face counts as facing the skin.
const LEAST_COSINE: f64 = 0.3;

/// Number of passes of edge splitting, smoothing and prism repair under curved skin.
const PASSES: usize = 4;

/// Meshes the tissue by isosurface stuffing and adds a layer of prisms under the skin.
///
/// Inner boundary nodes that face bone start as [`Attachment::Sliding`](super::Attachment::Sliding), nodes on cuts of the
/// region as [`Attachment::Fixed`](super::Attachment::Fixed), and all others as [`Attachment::Free`](super::Attachment::Free).
///
/// When elements stay inverted, slightly shorter lattice edges are tried, and the report contains a warning.
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
    settings.check()?;
    let mut first = None;
    for share in EDGE_SHARES {
        let tried = MeshSettings { edge_mm: share * settings.edge_mm, ..*settings };
        match build_once(domain, &tried, control) {
            Err(error @ MeshError::Inverted { .. }) => {
                first.get_or_insert(error);
            }
            Ok((mesh, mut report)) => {
                if let Some(error) = &first {
                    report.warnings.push(format!(
                        "the mesh has edges of {1:.2} mm instead of {0} mm, because with the requested edges {error}",
                        settings.edge_mm, tried.edge_mm
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

/// Edge lengths tried in turn, as shares of the requested one.
const EDGE_SHARES: [f64; 4] = [1.0, 0.97, 0.93, 0.88];

fn build_once(
    domain: &Domain<'_>,
    settings: &MeshSettings,
    control: &Control,
) -> Result<(MixedMesh, MeshReport), MeshError> {
    let plain = InnerTissue::new(domain, settings);
    let mut warnings = Vec::new();
    let lattice = lattice_over(&plain, settings.edge_mm)?;
    let grading = grade(&plain, &lattice, control)?;
    let inner = plain.with_thickness(grading.thickness.as_ref());
    let lattice = halve(lattice, grading.halved, settings.edge_mm)?;
    let mut mesh = stuff(&inner, &lattice, &control.stage(0.0, 0.3))?;
    let faces = boundary(&mesh.tetrahedra);
    let mut sides = boundary_sides(&inner, &mesh, &faces);
    let mut surface = surface_faces(&inner, &mesh, &sides, &faces);
    if !surface.iter().any(|f| f.skin) {
        return Err(MeshError::NoTissue);
    }
    control.report(0.35);

    let pressed = press(&inner, &mut mesh, &sides, control)?;
    let faces = boundary(&mesh.tetrahedra);
    label_exposed(&inner, &mesh, &faces, &mut sides);
    for (side, dropped) in sides.iter_mut().zip(&pressed.dropped) {
        if dropped.is_some() {
            *side = *dropped;
        }
    }
    let under = under_skin(&surface, mesh.positions.len());
    let left_out = leave_out_pockets(&inner, &mut mesh, &under);
    if left_out.pockets > 0 {
        warnings.push(format!(
            "{} pockets of tissue behind narrow necks were left out ({} tetrahedra, {:.2} cm³)",
            left_out.pockets,
            left_out.tetrahedra,
            left_out.volume_mm3 / 1000.0
        ));
    }
    let faces = if left_out.tetrahedra > 0 { boundary(&mesh.tetrahedra) } else { faces };
    for &node in faces.iter().flat_map(|f| &f.nodes) {
        sides[node as usize].get_or_insert(Side::Neck);
    }
    let mut pinned = pressed.dipping;
    {
        let mut relaxation = Relaxation::new(&inner, &mut mesh, &sides, &pinned, &faces);
        relaxation.towards_neighbours(4, control)?;
        control.report(0.5);
        relaxation.improve(4, control)?;
    }
    control.report(0.6);

    for face in &mut surface {
        face.skin &= !face.nodes.iter().any(|&n| pressed.holes[n as usize]);
    }
    let skin_faces: Vec<[u32; 3]> = surface.iter().filter(|f| f.skin).map(|f| f.nodes).collect();
    let (mut layer, lost) = Layer::extrude(&inner, &mesh, &skin_faces);
    for face in &mut surface {
        face.skin &= face.nodes.iter().all(|&n| layer.feet[n as usize].is_some());
    }
    layer.mend(&inner, &mut mesh, &sides, control)?;
    layer.settle(&inner, &mesh, control)?;
    for _ in 0..PASSES {
        let mut refinement = Refinement {
            inner: &inner,
            mesh: &mut mesh,
            sides: &mut sides,
            pinned: &mut pinned,
            faces: &mut surface,
            layer: &mut layer,
            refused: BTreeSet::new(),
        };
        let halved = refinement.run(control)?;
        if halved == 0 {
            break;
        }
        layer.faces = surface.iter().filter(|f| f.skin).map(|f| f.nodes).collect();
        let faces = boundary(&mesh.tetrahedra);
        Relaxation::new(&inner, &mut mesh, &sides, &pinned, &faces).improve(4, control)?;
        layer.mend(&inner, &mut mesh, &sides, control)?;
        layer.settle(&inner, &mesh, control)?;
    }
    let mut stuffed_faces: Vec<[u32; 3]> = surface.iter().map(|f| sorted(f.nodes)).collect();
    stuffed_faces.sort_unstable();
    let n_prisms = layer.faces.len();
    let bad = lost + layer.drop_bad(&mesh);
    if bad > 0 {
        warnings
            .push(format!("{bad} of {n_prisms} prisms could not be formed under folds of the skin and were left out"));
    }
    let off = layer.drop_off_skin(&inner);
    if off > 0 {
        warnings.push(format!(
            "{off} of {n_prisms} prisms were left out at skin folds too thin for an edge of {} mm: use a shorter edge",
            settings.edge_mm
        ));
    }
    control.report(0.7);
    warnings.extend(keep_large_parts(&mut mesh, &mut layer));
    let mixed =
        assemble(&Shape { inner: &inner, mesh: &mesh, layer: &layer, sides: &sides, stuffed_faces: &stuffed_faces });
    control.check()?;
    control.report(0.8);
    let mut quality = report(&mixed, Some((domain, settings)), left_out.volume_mm3);
    if quality.inverted > 0 {
        return Err(first_inverted(&mixed, quality.inverted));
    }
    warnings.append(&mut quality.warnings);
    quality.warnings = warnings;
    control.report(1.0);
    Ok((mixed, quality))
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
            normal.dot(&gradient) > LEAST_COSINE * normal.norm() * gradient.norm()
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
