//! From mesh and settings to equations.

use super::assembly::{Assembly, Law, Part};
use super::contact::{Contact, contact_nodes};
use super::dofs::Dofs;
use super::element::{self, C1Surface, ElementBlock, MeshCell};
use super::error::SolveError;
use super::linear_solve::LinearSolver;
use super::material::{Material, Materials};
use super::newton::{Equations, Limits};
use super::settings::{Boundary, ContactBody, Locking, Model, SkinElement, SolveSettings};
use crate::control::Control;
use crate::geometry::Vector;
use crate::mesh::{Attachment, MixedMesh, Tissue};

/// Contact stiffness in units of the tissue's confined modulus over its mean thickness: a layer compressed by a third of its
/// thickness sinks some 0.01 of the thickness into bone before the multipliers take over.
const CONTACT_STIFFNESS: f64 = 30.0;
/// Reaction force below which the residual is compared with this, in units of shear modulus times element size squared.
const FORCE_FLOOR: f64 = 1e-3;

const TISSUES: [Tissue; 4] = [Tissue::Skin, Tissue::Muscle, Tissue::Fat, Tissue::Mucosa];

/// Sets up the equations; also the outer surface when the skin is made of C1 prisms, and warnings.
pub(super) fn equations<'a>(
    mesh: &MixedMesh,
    bodies: Vec<ContactBody<'a>>,
    boundary: &Boundary,
    settings: &SolveSettings,
    control: &Control,
) -> Result<(Equations<'a>, Option<C1Surface>, Vec<String>), SolveError> {
    settings.check()?;
    check_mesh(mesh)?;
    check_boundary(mesh, boundary)?;
    check_bodies(&bodies)?;
    let (blocks, surface) = element_blocks(mesh, settings)?;
    let mut warnings = surface.as_ref().map(C1Surface::warnings).unwrap_or_default();
    warnings.extend(settings.stability_warnings(mesh));
    warnings.extend(settings.locking_warning(mesh));
    control.check()?;
    control.report(0.2);
    let smoothed = match settings.locking {
        Locking::None => None,
        Locking::Smoothed => Some(smoothed_parts(mesh, &blocks, settings)?),
    };
    let coupled: Vec<&ElementBlock> = match &smoothed {
        Some(parts) => parts.iter().map(|p| &p.block).collect(),
        None => blocks.iter().collect(),
    };
    // Contact changes at every iteration; eliminated last, it leaves most of a factor as it is.
    let last = if bodies.is_empty() || settings.model == Model::MassTensor { Vec::new() } else { contact_nodes(mesh) };
    let dofs = Dofs::new(mesh, boundary, surface.as_ref(), &coupled, &last)?;
    if dofs.n_unknown() == 0 {
        return Err(problem("no node is free to move: all are fixed or tied to bone".to_owned()));
    }
    control.check()?;
    control.report(0.5);
    let scale = Scale::new(mesh, &blocks, &settings.materials);
    let whole = laws(settings, |m| m)?;
    let elements = blocks.into_iter().map(|block| Part { block, laws: whole.clone() }).collect();
    let assembly = match smoothed {
        Some(parts) => Assembly::new(parts, Some(elements), &dofs)?,
        None => Assembly::new(elements, None, &dofs)?,
    };
    control.check()?;
    control.report(0.7);
    let solver = match settings.model {
        Model::MassTensor => LinearSolver::relaxation(control.clock()),
        Model::Linear | Model::Nonlinear | Model::Mixed => {
            LinearSolver::new(assembly.pattern(), dofs.first_last(), control.clock())?
        }
    };
    control.report(0.9);
    let stiffness = settings.contact_stiffness_factor * CONTACT_STIFFNESS * scale.modulus / scale.thickness_mm;
    let (contact, overlap) = Contact::new(mesh, bodies, stiffness);
    let limits = Limits {
        relative_residual: settings.relative_residual,
        max_iterations: settings.max_iterations,
        penetration_tolerance_mm: settings.penetration_tolerance_mm,
        force_floor_n: FORCE_FLOOR * scale.shear * scale.element_size_mm.powi(2),
        element_size_mm: scale.element_size_mm,
        energy_noise_mj: 1e-13 * scale.shear * scale.volume,
        linear: settings.model.is_linear(),
    };
    let loads =
        if boundary.loads_n.iter().any(|f| *f != Vector::zeros()) { boundary.loads_n.clone() } else { Vec::new() };
    let equations = Equations::new(dofs, assembly, contact, solver, loads, limits, control.clock());
    warnings.extend(overlap);
    control.report(1.0);
    Ok((equations, surface, warnings))
}

fn element_blocks(
    mesh: &MixedMesh,
    settings: &SolveSettings,
) -> Result<(Vec<ElementBlock>, Option<C1Surface>), SolveError> {
    let mut blocks = vec![element::tetrahedra(mesh)?];
    let mut surface = None;
    match settings.skin_element {
        SkinElement::Tetrahedron => blocks.push(element::prisms_as_tetrahedra(mesh)?),
        SkinElement::Wedge => blocks.push(element::wedges(mesh)?),
        SkinElement::C1Prism => {
            let c1 = C1Surface::new(mesh);
            blocks.push(element::c1_prisms(mesh, &c1)?);
            blocks.push(element::plain_prisms(mesh, &c1)?);
            surface = Some(c1);
        }
    }
    blocks.retain(|b| b.n_elements() > 0);
    Ok((blocks, surface))
}

/// Parts whose energies add up to that of the elements, taken at averaged strains.
fn smoothed_parts(
    mesh: &MixedMesh,
    blocks: &[ElementBlock],
    settings: &SolveSettings,
) -> Result<Vec<Part>, SolveError> {
    let isochoric = laws(settings, Material::isochoric_part)?;
    let volumetric = laws(settings, Material::volumetric_part)?;
    let (tetrahedra, others): (Vec<&ElementBlock>, Vec<&ElementBlock>) =
        blocks.iter().partition(|b| b.n_functions == 4);
    let corners = |cell: MeshCell, nodes: &[u32]| match cell {
        MeshCell::Prism(prism) if nodes.len() > 4 => mesh.prisms[prism as usize].to_vec(),
        MeshCell::Prism(_) | MeshCell::Tetrahedron(_) => nodes.to_vec(),
    };
    let all: Vec<&ElementBlock> = blocks.iter().collect();
    let mut parts: Vec<Part> = Vec::new();
    parts.extend(element::edge_domains(&tetrahedra).into_iter().map(|block| Part { block, laws: isochoric.clone() }));
    parts.extend(others.into_iter().map(|block| Part { block: block.clone(), laws: isochoric.clone() }));
    parts
        .extend(element::node_domains(&all, corners).into_iter().map(|block| Part { block, laws: volumetric.clone() }));
    Ok(parts)
}

/// Laws by tissue, for the part of each material that `part` takes.
fn laws(settings: &SolveSettings, part: impl Fn(Material) -> Material) -> Result<[Law; 4], SolveError> {
    let law = |tissue: Tissue| {
        let material = part(*settings.materials.of(tissue));
        if settings.model.is_linear() {
            Law::small_strain(&material).map_err(|e| SolveError::Problem { detail: e.to_string() })
        } else {
            Ok(Law::Hyperelastic(material))
        }
    };
    let [a, b, c, d] = TISSUES;
    Ok([law(a)?, law(b)?, law(c)?, law(d)?])
}

/// Sizes that tolerances and contact stiffness are measured by.
struct Scale {
    /// mm³.
    volume: f64,
    /// Volume mean of the shear modulus, MPa.
    shear: f64,
    /// Volume mean of the confined modulus K + 4/3 mu, MPa.
    modulus: f64,
    /// Edge of a regular tetrahedron of the mean element volume, mm.
    element_size_mm: f64,
    /// Volume over the area of bone faces, mm.
    thickness_mm: f64,
}

impl Scale {
    fn new(mesh: &MixedMesh, blocks: &[ElementBlock], materials: &Materials) -> Self {
        let (mut volume, mut shear, mut modulus, mut elements) = (0.0, 0.0, 0.0, 0.0);
        for block in blocks {
            for (weights, tissue) in block.weights.chunks_exact(block.n_points).zip(&block.tissue) {
                let v: f64 = weights.iter().sum();
                let material: &Material = materials.of(*tissue);
                volume += v;
                shear += v * material.shear_modulus();
                modulus += v * (material.bulk + 4.0 / 3.0 * material.shear_modulus());
                elements += 1.0;
            }
        }
        let area: f64 = (mesh.bone_faces.iter())
            .map(|face| {
                let [a, b, c] = face.map(|n| mesh.positions[n as usize]);
                0.5 * (b - a).cross(&(c - a)).norm()
            })
            .sum();
        let element_size_mm = (6.0 * 2.0f64.sqrt() * volume / elements).cbrt();
        let thickness_mm = if area > 0.0 { volume / area } else { element_size_mm };
        Self { volume, shear: shear / volume, modulus: modulus / volume, element_size_mm, thickness_mm }
    }
}

fn problem(detail: String) -> SolveError {
    SolveError::Problem { detail }
}

fn check_mesh(mesh: &MixedMesh) -> Result<(), SolveError> {
    let n = mesh.positions.len();
    if mesh.attachment.len() != n {
        return Err(problem(format!("{} attachments for {n} nodes", mesh.attachment.len())));
    }
    if mesh.tetrahedron_tissue.len() != mesh.tetrahedra.len() {
        let (tissues, tetrahedra) = (mesh.tetrahedron_tissue.len(), mesh.tetrahedra.len());
        return Err(problem(format!("{tissues} tissues for {tetrahedra} tetrahedra")));
    }
    if let Some(node) = mesh.positions.iter().position(|p| !p.iter().all(|c| c.is_finite())) {
        return Err(problem(format!("node {node} has a coordinate that is not finite")));
    }
    let named = (mesh.tetrahedra.iter().flatten())
        .chain(mesh.prisms.iter().flatten())
        .chain(mesh.bone_faces.iter().flatten())
        .max();
    match named {
        Some(&node) if node as usize >= n => Err(problem(format!("node {node} is named, but there are only {n}"))),
        _ => Ok(()),
    }
}

fn check_boundary(mesh: &MixedMesh, boundary: &Boundary) -> Result<(), SolveError> {
    let n = mesh.positions.len();
    let (held, loads) = (boundary.held_axes.len(), boundary.loads_n.len());
    if held != 0 && held != n {
        return Err(problem(format!("{held} sets of held axes for {n} nodes")));
    }
    if loads != 0 && loads != n {
        return Err(problem(format!("{loads} loads for {n} nodes")));
    }
    if let Some(node) = boundary.held_axes.iter().position(|axes| *axes > 7) {
        return Err(problem(format!("node {node} has held axes {}, allowed are 0 to 7", boundary.held_axes[node])));
    }
    match boundary.loads_n.iter().position(|f| !f.iter().all(|c| c.is_finite())) {
        Some(node) => Err(problem(format!("the load on node {node} is not finite"))),
        None => Ok(()),
    }
}

fn check_bodies(bodies: &[ContactBody<'_>]) -> Result<(), SolveError> {
    let mut segments: Vec<u32> = bodies.iter().map(|b| b.segment).collect();
    segments.sort_unstable();
    match segments.windows(2).find(|w| w[0] == w[1]) {
        Some(w) => Err(problem(format!("segment {} is given twice", w[0]))),
        None => Ok(()),
    }
}

/// Segments that tissue is tied to, ascending.
pub(super) fn tied_segments(mesh: &MixedMesh) -> Vec<u32> {
    let mut segments: Vec<u32> = (mesh.attachment.iter())
        .filter_map(|a| match a {
            Attachment::Tied(segment) => Some(*segment),
            Attachment::Free | Attachment::Sliding | Attachment::Fixed => None,
        })
        .collect();
    segments.sort_unstable();
    segments.dedup();
    segments
}
