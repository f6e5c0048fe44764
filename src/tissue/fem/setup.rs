//! Setup of the equations from mesh and settings.

use super::assembly::{Assembly, Curvature, Law, Part};
use super::checks::{check_bodies, check_boundary, check_mesh, problem};
use super::contact::{Contact, NoncontactPoints, contact_nodes, facing_nodes, noncontact_points};
use super::dofs::Dofs;
use super::element::{self, C1Surface, ElementBlock, MeshCell};
use super::equations::Equations;
use super::error::SolveError;
use super::factor::{Factor, Symbolic};
use super::linear_solve::LinearSolver;
use super::material::{Material, Materials};
use super::memory;
use super::problem::{Limits, Problem};
use super::report::PhaseTimes;
use super::settings::{Boundary, ContactBody, Locking, Model, SkinElement, SolveSettings};
use super::springs::{self, Bend, SpringPoint, SpringStiffness, Springs};
use super::state::PathState;
use super::tuning::{
    CONTACT_STIFFNESS, ENERGY_NOISE, FACING_STIFFNESS, FORCE_FLOOR, PATCH_BULK, PATCH_SHARE, SPRING_STIFFNESS,
};
use crate::mesh::{Attachment, MixedMesh, Tissue};
use prosopon_geometry::control::Control;
use prosopon_geometry::{Aabb, Motion, Vector, Warning};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Times and factorisations of a preparation.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct PreparationWork {
    pub(super) times: PhaseTimes,
    pub(super) factorisations: usize,
}

/// Elements of a mesh before they are assembled.
struct Elements {
    blocks: Vec<ElementBlock>,
    surface: Option<C1Surface>,
    /// Smoothed elements or patches, when they carry the energy.
    smoothed: Option<Vec<Part>>,
}

/// Everything in the equations of a mesh that does not depend on the motion of its bones.
///
/// It holds elements, unknowns, elimination order, sparsity pattern, symbolic factorisation, and stiffness and factor at rest.
/// Any number of solvers may start from one ([`Solver::over`](super::Solver::over)); each gives the same bits as a solver with
/// its own preparation.
#[derive(Debug)]
pub struct Prepared {
    pub(super) surface: Option<Arc<C1Surface>>,
    pub(super) settings: SolveSettings,
    pub(super) warnings: Vec<Warning>,
    work: PreparationWork,
    /// Whether a solver has reported the work of the preparation.
    reported: AtomicBool,
    dofs: Dofs,
    assembly: Assembly,
    factor: Option<(Arc<Symbolic>, Arc<Factor<f32>>)>,
    /// Stiffness of the elements at rest.
    rest: Arc<Vec<f64>>,
    loads: Vec<Vector>,
    springs: Arc<Vec<SpringPoint>>,
    /// Stiffness of the springs at rest.
    springs_at_rest: Vec<SpringStiffness>,
    /// Boundary points on which contact does not act.
    noncontact: Arc<Vec<[u32; 3]>>,
    /// MPa/mm.
    contact_stiffness: f64,
    /// Stiffness of contact between tissues relative to that with bone.
    facing_factor: f64,
    limits: Limits,
    /// Numbers of nodes, tetrahedra and prisms.
    size: [usize; 3],
    /// Estimated memory of this and of a solver over it, MB, without a factor of the solver's own.
    estimate_mb: f64,
    /// Memory of one factor, MB.
    factor_mb: f64,
}

impl Prepared {
    /// Prepares for a mesh; `bodies` are those that solvers over it will have, in the same order.
    ///
    /// # Errors
    /// [`SolveError`] when elements are inverted at rest or the problem is inconsistent (for example when nothing is held).
    pub fn new(
        mesh: &MixedMesh,
        bodies: &[ContactBody<'_>],
        boundary: &Boundary,
        settings: SolveSettings,
        control: &Control,
    ) -> Result<Self, SolveError> {
        let clock = control.clock();
        let begin = clock();
        settings.check()?;
        check_mesh(mesh)?;
        check_boundary(mesh, boundary)?;
        let elements = Elements::new(mesh, &settings, control)?;
        let warnings = warnings_at_rest(mesh, &settings, &elements);
        let coupled = elements.coupled();
        let elements_take = memory::of_elements(&coupled);
        memory::check("the elements", elements_take, control)?;
        // Contact changes in every iteration. Its nodes are eliminated last, so that most of the factor stays valid.
        check_bodies(bodies)?;
        let touching = !bodies.is_empty();
        let relaxes = settings.model == Model::MassTensor;
        let guarded = if touching { contact_nodes(mesh) } else { Vec::new() };
        let noncontact = if touching { noncontact_points(mesh) } else { Vec::new() };
        let last = if relaxes { Vec::new() } else { last_nodes(mesh, guarded) };
        let dofs = Dofs::new(mesh, boundary, elements.surface.as_ref(), &coupled, &last)?;
        if dofs.n_unknown() == 0 {
            return Err(problem("no node is free to move: all are fixed or tied to bone".to_owned()));
        }
        control.check()?;
        control.report(0.4);
        let scale = Scale::new(mesh, &elements.blocks, &settings.materials);
        let Elements { blocks, surface, smoothed } = elements;
        let assembly = assembly(blocks, smoothed, &settings, &dofs)?;
        control.check()?;
        control.report(0.5);
        let points = springs::points(mesh, bodies, boundary, scale.shear, scale.element_size_mm)?;
        let contact_stiffness =
            settings.contact_stiffness_factor * CONTACT_STIFFNESS * scale.modulus / scale.thickness_mm;
        let points = Arc::new(points);
        let still = vec![Motion::identity(); bodies.len()];
        let at_rest = Springs::new(Arc::clone(&points), bodies.to_vec(), SPRING_STIFFNESS * contact_stiffness)?;
        let springs_at_rest = at_rest.stiffness_at(dofs.rest(), &still);
        let has_loads = boundary.loads_n.iter().any(|f| *f != Vector::zeros());
        let mut prepared = Self {
            surface: surface.map(Arc::new),
            warnings,
            work: PreparationWork::default(),
            reported: AtomicBool::new(false),
            dofs,
            assembly,
            factor: None,
            rest: Arc::default(),
            loads: if has_loads { boundary.loads_n.clone() } else { Vec::new() },
            springs: points,
            springs_at_rest,
            noncontact: Arc::new(noncontact),
            contact_stiffness,
            facing_factor: FACING_STIFFNESS / CONTACT_STIFFNESS * scale.thickness_mm / scale.element_size_mm,
            limits: limits(&settings, &scale),
            size: size(mesh),
            estimate_mb: 0.0,
            factor_mb: 0.0,
            settings,
        };
        prepared.work.times.setup_s = clock() - begin;
        prepared.estimate_mb = 1e-6 * (elements_take + memory::of_matrix(prepared.assembly.pattern()));
        memory::check("elements and matrix", 1e6 * prepared.estimate_mb, control)?;
        if !relaxes {
            prepared.factorise(control)?;
        }
        control.report(1.0);
        Ok(prepared)
    }

    /// Computes stiffness and factor at rest. A factor that fails stays without values: the solver tries again and reports the
    /// failure.
    fn factorise(&mut self, control: &Control) -> Result<(), SolveError> {
        let clock = control.clock();
        let begin = clock();
        let symbolic = Arc::new(Symbolic::new(self.assembly.pattern(), self.dofs.first_last())?);
        self.factor_mb = 1e-6 * memory::of_factor(&symbolic);
        self.estimate_mb += self.factor_mb + 1e-6 * memory::of_corner(&symbolic);
        // The factor at rest is kept for later paths; a nonlinear path mostly needs a second one.
        let factors_mb = self.estimated_mb(!self.limits.linear);
        memory::check("elements, matrix and factor", 1e6 * factors_mb, control)?;
        let mut factor = Factor::new(Arc::clone(&symbolic))?;
        control.check()?;
        control.report(0.6);
        let analysed = clock();
        let mut values = vec![0.0; self.assembly.pattern().n_values()];
        let mut forces = vec![Vector::zeros(); self.dofs.n_nodes()];
        let rest = self.dofs.rest().to_vec();
        let mut buffers = self.assembly.buffers();
        let stiffness = self.assembly.tangent(&mut buffers, &rest, Curvature::Exact, &mut forces, &mut values);
        drop(buffers);
        self.assembly.pattern().hold(self.dofs.partly_held(), &mut values);
        control.check()?;
        control.report(0.7);
        let assembled = clock();
        if stiffness.is_ok() {
            self.work.factorisations = 1;
            self.rest = Arc::new(values.clone());
            let points = &self.springs;
            let springs = Bend::Limited(self.springs_at_rest.clone());
            springs::add_blocks(&self.dofs, self.assembly.pattern(), points, springs, &mut values);
            // A matrix that is not positive definite at rest is reported by the first solve.
            let _ = factor.factorise(&values);
        }
        self.factor = Some((symbolic, Arc::new(factor)));
        self.work.times.setup_s += analysed - begin;
        self.work.times.tangent_s = assembled - analysed;
        self.work.times.factor_s = clock() - assembled;
        Ok(())
    }

    /// Estimated memory of this and of a solver over it, MB, computed from counts before allocation.
    ///
    /// `own_factor` adds a factor of the solver's own to the one at rest.
    #[must_use]
    pub fn estimated_mb(&self, own_factor: bool) -> f64 {
        self.estimate_mb + if own_factor { self.factor_mb } else { 0.0 }
    }

    /// Work of the preparation for the first caller; zeros for later ones.
    pub(super) fn unreported_work(&self) -> PreparationWork {
        if self.reported.swap(true, Ordering::Relaxed) { PreparationWork::default() } else { self.work }
    }

    /// The points of `mesh` on which contact does not act, with their depths in `bodies` at rest.
    pub(super) fn noncontact(&self, mesh: &MixedMesh, bodies: &[ContactBody<'_>]) -> NoncontactPoints {
        NoncontactPoints::new(Arc::clone(&self.noncontact), mesh, bodies)
    }

    /// Sets up the equations, with warnings about them.
    pub(super) fn equations<'a>(
        &self,
        mesh: &MixedMesh,
        bodies: Vec<ContactBody<'a>>,
        control: &Control,
    ) -> Result<(Equations<'a>, Vec<Warning>), SolveError> {
        check_bodies(&bodies)?;
        if size(mesh) != self.size {
            return Err(problem("the mesh differs in size from the prepared one".to_owned()));
        }
        let solver = match &self.factor {
            Some((symbolic, factor)) => LinearSolver::new(Arc::clone(symbolic), Arc::clone(factor), control),
            None => LinearSolver::relaxation(control),
        };
        let (mut contact, overlap) = Contact::new(mesh, bodies, self.contact_stiffness);
        let facing_overlap = if mesh.facing.is_empty() { None } else { contact.add_facing(mesh, self.facing_factor) };
        let (dofs, assembly, rest) = (self.dofs.clone(), self.assembly.clone(), Arc::clone(&self.rest));
        let stiffness = SPRING_STIFFNESS * self.contact_stiffness;
        let springs = Springs::new(Arc::clone(&self.springs), contact.bodies().to_vec(), stiffness)?;
        let points = Arc::clone(&self.springs);
        let problem = Problem::new(dofs, assembly, rest, self.loads.clone(), points, self.limits, control.clock());
        let equations = Equations::new(problem, PathState::new(contact, springs), solver);
        let mut warnings = self.warnings.clone();
        warnings.extend(overlap);
        warnings.extend(facing_overlap);
        Ok((equations, warnings))
    }
}

impl Elements {
    fn new(mesh: &MixedMesh, settings: &SolveSettings, control: &Control) -> Result<Self, SolveError> {
        let (blocks, surface) = element_blocks(mesh, settings)?;
        control.check()?;
        control.report(0.2);
        let smoothed = match settings.locking {
            Locking::None => None,
            Locking::Smoothed => Some(smoothed_parts(mesh, &blocks, settings)?),
            Locking::Patched => Some(patched_parts(&blocks, settings)?),
        };
        Ok(Self { blocks, surface, smoothed })
    }

    /// Elements that carry the energy and so couple their nodes.
    fn coupled(&self) -> Vec<&ElementBlock> {
        match &self.smoothed {
            Some(parts) => parts.iter().map(|p| &p.block).collect(),
            None => self.blocks.iter().collect(),
        }
    }
}

/// Nodes that are eliminated last: those of contact with bone (`guarded`) and with tissue.
fn last_nodes(mesh: &MixedMesh, guarded: Vec<bool>) -> Vec<bool> {
    if mesh.facing.is_empty() {
        return guarded;
    }
    let mut last = facing_nodes(mesh);
    last.iter_mut().zip(guarded).for_each(|(last, guarded)| *last |= guarded);
    last
}

/// Warnings about mesh and materials before any motion.
fn warnings_at_rest(mesh: &MixedMesh, settings: &SolveSettings, elements: &Elements) -> Vec<Warning> {
    let mut warnings = elements.surface.as_ref().map(C1Surface::warnings).unwrap_or_default();
    if settings.skin_element == SkinElement::Tetrahedron {
        let wedges = elements.blocks.iter().filter(|b| b.n_functions == 6).map(ElementBlock::n_elements).sum();
        warnings.extend(element::wedges_warning(wedges, "tetrahedra"));
    }
    warnings.extend(settings.stiffness_warnings(mesh));
    warnings.extend(settings.stability_warnings(mesh));
    warnings.extend(settings.locking_warning(mesh));
    warnings
}

/// The elements that can strain, with their laws: those of the mesh, and smoothed ones when they carry the energy.
fn assembly(
    blocks: Vec<ElementBlock>,
    smoothed: Option<Vec<Part>>,
    settings: &SolveSettings,
    dofs: &Dofs,
) -> Result<Assembly, SolveError> {
    let whole = laws(settings, |m| m)?;
    // Elements whose nodes all stay at rest have neither stress nor stiffness for any unknown.
    let can_strain = |part: &mut Part| {
        part.block.retain(|nodes| nodes.iter().any(|n| !dofs.stays_at_rest(*n as usize)));
        part.block.n_elements() > 0
    };
    let mut elements: Vec<Part> = blocks.into_iter().map(|block| Part { block, laws: whole.clone() }).collect();
    elements.retain_mut(can_strain);
    match smoothed {
        Some(mut parts) => {
            parts.retain_mut(can_strain);
            Assembly::new(parts, Some(elements), dofs)
        }
        None => Assembly::new(elements, None, dofs),
    }
}

fn limits(settings: &SolveSettings, scale: &Scale) -> Limits {
    Limits {
        relative_residual: settings.relative_residual,
        max_iterations: settings.max_iterations,
        penetration_tolerance_mm: settings.penetration_tolerance_mm,
        force_floor_n: FORCE_FLOOR * scale.shear * scale.element_size_mm.powi(2),
        element_size_mm: scale.element_size_mm,
        mesh_size_mm: scale.mesh_size_mm,
        energy_noise_mj: ENERGY_NOISE * scale.shear * scale.volume,
        linear: settings.model.is_linear(),
        pull_off_mpa: settings.pull_off_mpa,
    }
}

fn size(mesh: &MixedMesh) -> [usize; 3] {
    [mesh.positions.len(), mesh.tetrahedra.len(), mesh.prisms.len()]
}

fn element_blocks(
    mesh: &MixedMesh,
    settings: &SolveSettings,
) -> Result<(Vec<ElementBlock>, Option<C1Surface>), SolveError> {
    let mut blocks = vec![element::tetrahedra(mesh)?];
    let mut surface = None;
    match settings.skin_element {
        SkinElement::Tetrahedron => blocks.extend(element::prisms_as_tetrahedra(mesh)?),
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

/// Smoothed elements whose energies add up to that of the mesh.
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

/// Elements and patches whose energies add up to that of the mesh.
fn patched_parts(blocks: &[ElementBlock], settings: &SolveSettings) -> Result<Vec<Part>, SolveError> {
    let own_bulk = |m: &Material| (1.0 - PATCH_SHARE) * m.bulk.min(PATCH_BULK * m.shear_modulus());
    let of_mean = laws(settings, |m| Material { bulk: m.bulk - own_bulk(&m), ..m.with_isochoric_share(PATCH_SHARE) })?;
    let of_elements = laws(settings, |m| Material { bulk: own_bulk(&m), ..m.with_isochoric_share(1.0 - PATCH_SHARE) })?;
    let isochoric = laws(settings, Material::isochoric_part)?;
    let volumetric = laws(settings, Material::volumetric_part)?;
    let (tetrahedra, others): (Vec<&ElementBlock>, Vec<&ElementBlock>) =
        blocks.iter().partition(|b| b.n_functions == 4);
    let mut parts: Vec<Part> = Vec::new();
    let mut add = |blocks: Vec<ElementBlock>, laws: &[Law; Tissue::COUNT]| {
        parts.extend(blocks.into_iter().map(|block| Part { block, laws: laws.clone() }));
    };
    add(tetrahedra.iter().map(|block| (*block).clone()).collect(), &of_elements);
    add(element::patches(&tetrahedra), &of_mean);
    // Prisms bend by themselves.
    add(others.iter().map(|block| (*block).clone()).collect(), &isochoric);
    add(element::patches(&others), &volumetric);
    Ok(parts)
}

/// Laws by tissue, for the part of each material that `part` extracts.
fn laws(settings: &SolveSettings, part: impl Fn(Material) -> Material) -> Result<[Law; Tissue::COUNT], SolveError> {
    let law = |tissue: Tissue| {
        let material = part(*settings.materials.of(tissue));
        if settings.model.is_linear() {
            Law::small_strain(&material).map_err(|e| SolveError::Problem { detail: e.to_string() })
        } else {
            Ok(Law::Hyperelastic(material))
        }
    };
    let [a, b, c, d, e] = Tissue::ALL;
    Ok([law(a)?, law(b)?, law(c)?, law(d)?, law(e)?])
}

/// Scales for tolerances and for the penalty stiffness.
struct Scale {
    /// mm³.
    volume: f64,
    /// Volume mean of the shear modulus, MPa.
    shear: f64,
    /// Volume mean of the confined modulus K + 4/3 mu, MPa.
    modulus: f64,
    /// Edge of a regular tetrahedron of the mean element volume, mm.
    element_size_mm: f64,
    /// Volume divided by the area of the bone faces, mm.
    thickness_mm: f64,
    /// Diagonal of the box around the mesh, mm.
    mesh_size_mm: f64,
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
        let mesh_size_mm = Aabb::of(&mesh.positions).map_or(0.0, |bounds| (bounds.max - bounds.min).norm());
        Self { volume, shear: shear / volume, modulus: modulus / volume, element_size_mm, thickness_mm, mesh_size_mm }
    }
}

/// Segments to which tissue is tied, ascending.
pub(super) fn tied_segments(mesh: &MixedMesh) -> Vec<u32> {
    let mut segments: Vec<u32> = (mesh.attachment.iter())
        .filter_map(|a| match a {
            Attachment::Tied(segment) | Attachment::Gliding(segment) => Some(*segment),
            Attachment::Free | Attachment::Sliding | Attachment::Fixed => None,
        })
        .collect();
    segments.sort_unstable();
    segments.dedup();
    segments
}
