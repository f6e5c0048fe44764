use super::error::SolveError;
use super::material::Materials;
use super::tuning::{EXPECTED_SHEAR_MPA, LOCKED_POISSON, LOCKED_POISSON_SMOOTHED, USUAL_POISSON};
use crate::mesh::{MixedMesh, Tissue};
use prosopon_geometry::{Implicit, Vector, Warning};

/// Mechanical model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Model {
    /// Small strain on linear elements (LFEM).
    Linear,
    /// Small strain on linear elements, solved by relaxation of vertices (MTM).
    ///
    /// Each vertex moves under the forces of its neighbours. The tensors of vertices and edges are those of Cotin, Delingette and
    /// Ayache, IEEE Trans Vis Comput Graph 1999. Conjugate gradients preconditioned with the vertices' tensors replace their time
    /// steps; the equilibrium is the same.
    MassTensor,
    /// Hyperelastic on linear elements (NFEM).
    Nonlinear,
    /// Hyperelastic, C1 prisms for the skin, linear tetrahedra inside (NFM-EM).
    Mixed,
}

impl Model {
    /// Whether stress is linear in the displacements.
    #[must_use]
    pub fn is_linear(self) -> bool {
        match self {
            Self::Linear | Self::MassTensor => true,
            Self::Nonlinear | Self::Mixed => false,
        }
    }
}

/// Element of the skin layer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SkinElement {
    /// Three linear tetrahedra for each prism.
    Tetrahedron,
    /// Linear wedge.
    Wedge,
    /// Prism with a C1 outer surface.
    C1Prism,
}

impl SkinElement {
    /// Default skin element of a model, the same for every interface.
    ///
    /// The paper's linear model has tetrahedra; wedges lock less.
    #[must_use]
    pub fn of(model: Model) -> Self {
        match model {
            Model::Mixed => Self::C1Prism,
            Model::Linear | Model::MassTensor => Self::Wedge,
            Model::Nonlinear => Self::Tetrahedron,
        }
    }
}

/// Locking-free formulation for linear elements.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Locking {
    /// None: standard linear elements.
    None,
    /// Smoothed elements (selective ES/NS-FEM).
    ///
    /// Isochoric energy at strains averaged around edges, volumetric energy at strains averaged around nodes
    /// ([`edge_domains`](super::element::edge_domains), [`node_domains`](super::element::node_domains)).
    Smoothed,
    /// Patches of about eight tetrahedra with one mean strain.
    ///
    /// Volumetric energy and most of the isochoric energy at the patch's mean strain, the rest at the elements' own strains
    /// ([`patches`](super::element::patches)).
    Patched,
}

/// Reaction to a material that loses ellipticity during a solve.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum UnstableMaterial {
    /// The step's outcome reports it.
    ///
    /// When no equilibrium is found, the path ends with an error that names tissue, element and stretch.
    #[default]
    Report,
    /// Neo-Hookean with the same small-strain moduli replaces it from there on.
    ///
    /// The replacement is that of [`Preset::Wang2009Stable`]; the outcome reports it.
    Stabilise,
}

/// Boundary conditions that do not come from bone: held axes, prescribed displacements and dead loads.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Boundary {
    /// Axes along which each node is held: bit 0 x, bit 1 y, bit 2 z.
    ///
    /// They serve for planes of symmetry. Empty when no axis is held.
    pub held_axes: Vec<u8>,
    /// Displacement of nodes along their held axes at path parameter 1, mm; other axes must be 0.
    ///
    /// It is proportional to the parameter. Empty when all held axes stay at rest.
    pub prescribed_mm: Vec<Vector>,
    /// Dead load on each node at path parameter 1, N.
    ///
    /// It is proportional to the parameter. Empty when there is none.
    pub loads_n: Vec<Vector>,
    /// Share to which each gliding node is tied, 0 (glides freely) to 1; empty when all glide freely.
    ///
    /// At one half, the spring towards the tied place is as stiff as the tissue over one element; at 1, a hundred times.
    pub tied_share: Vec<f64>,
    /// Stiffness of a spring that draws each free or sliding node to its rest position, N/mm; empty when there is none.
    ///
    /// It stands for tissue beyond the mesh.
    pub foundation_n_mm: Vec<f64>,
}

/// Named sets of materials.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Preset {
    /// Stable neo-Hookean with the published small-strain moduli (`src/paper.md`, 20).
    Wang2009Stable,
    /// Stable Yeoh that follows the published curve in tension.
    Wang2009Tension,
    /// The published constants. They lose ellipticity at small stretches.
    Wang2009,
    /// Yeoh fitted to indentation of a cheek, the same for all tissues.
    Nazari2010,
    /// Small-strain moduli of passive facial tissue, the same for all tissues.
    Chabanas2003,
}

/// A bone segment that tissue is tied to or slides on.
#[derive(Clone, Copy)]
pub struct ContactBody<'a> {
    /// Segment number as in [`crate::mesh::Attachment::Tied`]; 0 is the skull, the fixed segment.
    pub segment: u32,
    /// Its solid in the rest frame.
    pub solid: &'a dyn Implicit,
}

impl std::fmt::Debug for ContactBody<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("ContactBody").field("segment", &self.segment).finish_non_exhaustive()
    }
}

/// Settings of a solve.
///
/// ```
/// use prosopon_tissue::fem::{Model, Preset, SkinElement, SolveSettings};
///
/// let settings = SolveSettings::new(Model::Mixed, Preset::Wang2009Stable.materials());
/// assert_eq!(settings.skin_element, SkinElement::C1Prism);
/// assert_eq!((settings.penetration_tolerance_mm, settings.min_substep), (0.05, 1.0 / 256.0));
/// // Small-strain shear modulus of skin, 70.1 kPa.
/// assert!((settings.materials.skin.shear_modulus() - 0.070142923).abs() < 1e-8);
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct SolveSettings {
    /// Mechanical model.
    pub model: Model,
    /// Skin element.
    pub skin_element: SkinElement,
    /// Locking-free formulation.
    pub locking: Locking,
    /// Materials.
    pub materials: Materials,
    /// Largest penetration accepted after a step, mm.
    pub penetration_tolerance_mm: f64,
    /// Factor on the penalty stiffness that the solver chooses.
    ///
    /// The multipliers keep the penetration below its tolerance at any value.
    pub contact_stiffness_factor: f64,
    /// Residual force at convergence, relative to the reaction force.
    pub relative_residual: f64,
    /// Newton iterations before a substep is halved.
    pub max_iterations: usize,
    /// Shortest substep, as a share of the path; a step that needs a shorter one fails.
    pub min_substep: f64,
    /// Reaction to a material that loses ellipticity.
    pub unstable_material: UnstableMaterial,
    /// Pull at which gliding tissue comes off bone, MPa; `None` when it never does.
    ///
    /// Tissue that has come off is still pushed by bone.
    pub pull_off_mpa: Option<f64>,
}

impl SolveSettings {
    /// Settings with the default values.
    ///
    /// They are the model's skin element, standard linear elements ([`Locking::None`]), 0.05 mm penetration, 1e-4 relative
    /// residual, 30 iterations, and substeps down to 1/256. Uploaded meshes are solved with [`Locking::Patched`] by default.
    #[must_use]
    pub fn new(model: Model, materials: Materials) -> Self {
        Self {
            model,
            skin_element: SkinElement::of(model),
            locking: Locking::None,
            materials,
            penetration_tolerance_mm: 0.05,
            contact_stiffness_factor: 1.0,
            relative_residual: 1e-4,
            max_iterations: 30,
            min_substep: 1.0 / 256.0,
            unstable_material: UnstableMaterial::default(),
            pull_off_mpa: None,
        }
    }

    /// Warnings about materials of the tissues in `mesh` whose stiffness suggests another unit.
    ///
    /// Soft tissues of the face have small-strain shear moduli of 0.3 kPa (fat) to 1 MPa (skin along its fibres).
    #[must_use]
    pub fn stiffness_warnings(&self, mesh: &MixedMesh) -> Vec<Warning> {
        let [low, high] = EXPECTED_SHEAR_MPA;
        let warning = |tissue: Tissue| {
            let found = self.materials.of(tissue).shear_modulus();
            (!(low..=high).contains(&found)).then(|| {
                let name = tissue.name();
                let message = format!("{name} has a shear modulus of {found:.3e} MPa, expected is {low} to {high} MPa");
                Warning::check("implausible-stiffness", message).act("Check the unit of the material's constants.")
            })
        };
        tissues(mesh).into_iter().filter_map(warning).collect()
    }

    /// Warnings about materials in `mesh` that lose ellipticity at expected stretches.
    ///
    /// Small strain has no such warnings.
    #[must_use]
    pub fn stability_warnings(&self, mesh: &MixedMesh) -> Vec<Warning> {
        if self.model.is_linear() {
            return Vec::new();
        }
        tissues(mesh).into_iter().filter_map(|t| self.materials.of(t).stability_warning(t.name())).collect()
    }

    /// Warning about tissues in `mesh` that are so nearly incompressible that elements lock.
    pub(super) fn locking_warning(&self, mesh: &MixedMesh) -> Option<Warning> {
        let above = match self.locking {
            Locking::None => LOCKED_POISSON,
            Locking::Smoothed => LOCKED_POISSON_SMOOTHED,
            // Not too stiff at 0.4999 either (`cooks_membrane_does_not_lock_with_patches`).
            Locking::Patched => return None,
        };
        let mut locked: Vec<Tissue> = tissues(mesh);
        locked.retain(|t| self.materials.of(*t).poisson_ratio() > above);
        if locked.is_empty() {
            return None;
        }
        let names: Vec<&str> = locked.into_iter().map(Tissue::name).collect();
        let found = format!("the Poisson ratio of {} is above {above}", names.join(", "));
        let (code, elements, share) = if self.locking == Locking::None {
            ("stiff-elements", "linear", "a quarter")
        } else {
            ("stiff-smoothed-elements", "even smoothed", "an eighth")
        };
        let message =
            format!("{found}: {elements} elements are too stiff there, on coarse meshes by {share} of the movement");
        // At the paper's 0.49 the error is that of the default, which README states.
        let is_usual = tissues(mesh).into_iter().all(|t| self.materials.of(t).poisson_ratio() <= USUAL_POISSON);
        let warning = if self.locking == Locking::None && is_usual {
            Warning::info(code, message)
        } else {
            Warning::check(code, message)
        };
        Some(warning.act("Use the locking option `patched`."))
    }

    pub(super) fn check(&self) -> Result<(), SolveError> {
        let positive = [
            ("penetration_tolerance_mm", self.penetration_tolerance_mm, f64::INFINITY),
            ("relative_residual", self.relative_residual, 0.1),
            ("contact_stiffness_factor", self.contact_stiffness_factor, f64::INFINITY),
            ("min_substep", self.min_substep, 1.0),
        ];
        for (name, found, most) in positive {
            if !(found > 0.0 && found <= most && found.is_finite()) {
                let detail = format!("{name} is {found}, allowed is above 0 and at most {most}");
                return Err(SolveError::Problem { detail });
            }
        }
        if let Some(pull) = self.pull_off_mpa.filter(|pull| !(pull.is_finite() && *pull >= 0.0)) {
            let detail = format!("pull_off_mpa is {pull}, allowed is 0 or more");
            return Err(SolveError::Problem { detail });
        }
        if self.max_iterations == 0 {
            return Err(SolveError::Problem { detail: "max_iterations is 0, at least 1 is needed".into() });
        }
        Ok(())
    }
}

/// Tissues of a mesh, each once, ascending.
fn tissues(mesh: &MixedMesh) -> Vec<Tissue> {
    let mut tissues: Vec<Tissue> = mesh.tetrahedron_tissue.clone();
    tissues.extend((0..mesh.prisms.len()).map(|p| mesh.tissue_of_prism(p)));
    tissues.sort_unstable();
    tissues.dedup();
    tissues
}

impl Preset {
    /// Publication from which the constants are taken.
    #[must_use]
    pub fn source(self) -> &'static str {
        match self {
            Self::Wang2009Stable => {
                "Wang, Yang and Gee, Int J Med Robotics 5, 2009, Table 1: the small-strain shear moduli 2 (C10 + C01), as \
                 neo-Hookean"
            }
            Self::Wang2009Tension => {
                "Wang, Yang and Gee, Int J Med Robotics 5, 2009, Table 1: the same moduli, second constant fitted to the \
                 published uniaxial curve up to a stretch of 1.2 (within 13, 12, 40 % in skin, muscle, fat)"
            }
            Self::Wang2009 => "Wang, Yang and Gee, Int J Med Robotics 5, 2009, Table 1, as published",
            Self::Nazari2010 => {
                "Nazari, Perrier, Chabanas and Payan, Comput Methods Biomech Biomed Eng 13, 2010, after indentation of a cheek \
                 by Gerard, Ohayon, Luboz, Perrier and Payan, Med Eng Phys 27, 2005; the Poisson ratio is chosen here; \
                 constants not compared with the print"
            }
            Self::Chabanas2003 => {
                "Chabanas, Luboz and Payan, Med Image Anal 7, 2003: passive tissue, E = 15 kPa and Poisson ratio 0.49 at small \
                 strain, here neo-Hookean; without the stiffer fibres of muscles; constants not compared with the print"
            }
        }
    }

    /// The materials of this preset, with D1 read as Poisson ratio (`src/paper.md`, 19).
    #[must_use]
    pub fn materials(self) -> Materials {
        match self {
            Self::Wang2009Stable => Materials::wang2009_stable(),
            Self::Wang2009Tension => Materials::wang2009_tension(),
            Self::Wang2009 => Materials::wang2009(),
            Self::Nazari2010 => Materials::nazari2010(),
            Self::Chabanas2003 => Materials::chabanas2003(),
        }
    }
}
