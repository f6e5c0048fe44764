use super::error::SolveError;
use super::material::Materials;
use crate::mesh::{MixedMesh, Tissue};
use prosopon_geometry::{Implicit, Vector};

/// Mechanical model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Model {
    /// Small strain on linear elements (LFEM).
    Linear,
    /// Small strain again, but vertices are relaxed under the forces of their neighbours instead of solving for all at once (MTM).
    ///
    /// The tensors of vertices and edges are those of Cotin, Delingette and Ayache, IEEE Trans Vis Comput Graph 1999; instead of their
    /// time steps, conjugate gradients with the vertices' tensors as preconditioner bring the vertices to rest: the equilibrium is the same.
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
    /// Three linear tetrahedra a prism.
    Tetrahedron,
    /// Linear wedge.
    Wedge,
    /// Prism with a C1 outer surface.
    C1Prism,
}

impl SkinElement {
    /// The skin element that a model has where nothing else is asked for, at every door. (The paper's linear model has tetrahedra; wedges lock less.)
    #[must_use]
    pub fn of(model: Model) -> Self {
        match model {
            Model::Mixed => Self::C1Prism,
            Model::Linear | Model::MassTensor => Self::Wedge,
            Model::Nonlinear => Self::Tetrahedron,
        }
    }
}

/// What is done against locking of linear tetrahedra.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Locking {
    /// Nothing: the elements as they are.
    None,
    /// Isochoric energy at strains averaged around edges, volumetric energy at strains averaged around nodes
    /// ([`edge_domains`](super::element::edge_domains), [`node_domains`](super::element::node_domains)).
    Smoothed,
}

/// What is done where a material loses ellipticity during a solve.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum UnstableMaterial {
    /// Steps say so in their outcome; where no equilibrium is found the path ends with an error that names tissue, element and stretch.
    #[default]
    Report,
    /// From there on neo-Hookean with the same small-strain moduli takes its place, as in [`Preset::Wang2009Stable`]; the outcome says so.
    Stabilise,
}

/// What acts on a mesh beside bone.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Boundary {
    /// Axes along which each node is held, for planes of symmetry: bit 0 x, bit 1 y, bit 2 z. Empty when no node is held so.
    pub held_axes: Vec<u8>,
    /// Where held nodes go along their held axes at path parameter 1 (proportional to the parameter before), mm; other axes are 0. Empty when
    /// all stay at rest.
    pub prescribed_mm: Vec<Vector>,
    /// Dead load on each node at path parameter 1 (proportional to the parameter before), N. Empty when there is none.
    pub loads_n: Vec<Vector>,
}

/// Named sets of materials.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Preset {
    /// Stable neo-Hookean with the published small-strain moduli (reading notes 20).
    Wang2009Stable,
    /// Stable Yeoh that follows the published curve in tension.
    Wang2009Tension,
    /// The published constants, which lose ellipticity early.
    Wang2009,
    /// Yeoh fitted to indentation of a cheek, the same for all tissues.
    Nazari2010,
    /// Small-strain moduli of passive facial tissue, the same for all tissues.
    Chabanas2003,
}

/// A bone segment that tissue is tied to or slides on.
#[derive(Clone, Copy)]
pub struct ContactBody<'a> {
    /// Segment number as in [`crate::mesh::Attachment::Tied`]; 0 is the skull that stays.
    pub segment: u32,
    /// Its solid in the rest frame.
    pub solid: &'a dyn Implicit,
}

impl std::fmt::Debug for ContactBody<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("ContactBody").field("segment", &self.segment).finish_non_exhaustive()
    }
}

/// Poisson ratio above which linear elements without a cure of locking are told to be too stiff: at 0.49 cells of 4 mm over a patch that is
/// moved by 4 mm are 0.8 to 1.1 mm off (`prosopon bench stability`); at 0.499 the tip of Cook's membrane moves a third of what it should.
const LOCKED_POISSON: f64 = 0.48;
/// The same with the cure: at 0.4999 that scene is 0.5 mm off, at 0.49 0.3 mm, which is the mesh's.
const LOCKED_THOUGH_CURED: f64 = 0.4995;

/// How the problem is solved.
#[derive(Debug, Clone, PartialEq)]
pub struct SolveSettings {
    /// Mechanical model.
    pub model: Model,
    /// Skin element.
    pub skin_element: SkinElement,
    /// Cure of locking.
    pub locking: Locking,
    /// Materials.
    pub materials: Materials,
    /// Largest penetration accepted after a step, mm.
    pub penetration_tolerance_mm: f64,
    /// Factor on the contact stiffness that the solver chooses; multipliers keep penetration below its tolerance whatever it is.
    pub contact_stiffness_factor: f64,
    /// Residual force relative to the reaction force.
    pub relative_residual: f64,
    /// Newton iterations before a step is halved.
    pub max_iterations: usize,
    /// Shortest substep as a share of the path, before giving up.
    pub min_substep: f64,
    /// What is done where a material loses ellipticity.
    pub unstable_material: UnstableMaterial,
}

impl SolveSettings {
    /// Settings with the defaults: the model's skin element, 0.05 mm penetration, 1e-4 relative residual, 30 iterations, substeps down to 1/256.
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
        }
    }

    /// What to tell of materials so stiff or so soft that another unit was probably meant, of the tissues that `mesh` has. Soft tissues of the
    /// face have small-strain shear moduli of 0.3 kPa (fat) to 1 MPa (skin along its fibres).
    #[must_use]
    pub fn stiffness_warnings(&self, mesh: &MixedMesh) -> Vec<String> {
        const EXPECTED_MPA: [f64; 2] = [1e-5, 30.0];
        let [low, high] = EXPECTED_MPA;
        let warning = |tissue: Tissue| {
            let found = self.materials.of(tissue).shear_modulus();
            (!(low..=high).contains(&found)).then(|| {
                let name = tissue.name();
                format!("the material of {name} has a shear modulus of {found:.3e} MPa; {low} to {high} MPa are to be expected: check the unit")
            })
        };
        tissues(mesh).into_iter().filter_map(warning).collect()
    }

    /// What to tell of materials that are not stable at the stretches to be expected, of the tissues that `mesh` has; nothing for small strain.
    #[must_use]
    pub fn stability_warnings(&self, mesh: &MixedMesh) -> Vec<String> {
        if self.model.is_linear() {
            return Vec::new();
        }
        tissues(mesh).into_iter().filter_map(|t| self.materials.of(t).stability_warning(t.name())).collect()
    }

    /// What to tell of tissues that are so nearly incompressible that elements lock; of those that `mesh` has.
    pub(super) fn locking_warning(&self, mesh: &MixedMesh) -> Option<String> {
        let (above, what) = match self.locking {
            Locking::None => (
                LOCKED_POISSON,
                "linear elements without a cure of locking are too stiff there, on coarse meshes by a quarter of the movement; `smoothed` cures it",
            ),
            Locking::Smoothed => (
                LOCKED_THOUGH_CURED,
                "even smoothed elements are an eighth of the movement too stiff there on coarse meshes",
            ),
        };
        let mut locked: Vec<Tissue> = tissues(mesh);
        locked.retain(|t| self.materials.of(*t).poisson_ratio() > above);
        let names: Vec<&str> = locked.into_iter().map(Tissue::name).collect();
        (!names.is_empty()).then(|| format!("the Poisson ratio of {} is above {above}: {what}", names.join(", ")))
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
        if self.max_iterations == 0 {
            return Err(SolveError::Problem { detail: "max_iterations is 0, at least 1 is needed".into() });
        }
        Ok(())
    }
}

/// Tissues of a mesh, each once.
fn tissues(mesh: &MixedMesh) -> Vec<Tissue> {
    let mut tissues: Vec<Tissue> = mesh.tetrahedron_tissue.clone();
    tissues.extend((0..mesh.prisms.len()).map(|p| mesh.tissue_of_prism(p)));
    tissues.sort_unstable();
    tissues.dedup();
    tissues
}

impl Preset {
    /// Where its constants come from.
    #[must_use]
    pub fn source(self) -> &'static str {
        match self {
            Self::Wang2009Stable => {
                "Wang, Yang and Gee, Int J Med Robotics 5, 2009, Table 1: the small-strain shear moduli 2 (C10 + C01), as neo-Hookean"
            }
            Self::Wang2009Tension => {
                "Wang, Yang and Gee, Int J Med Robotics 5, 2009, Table 1: the same moduli, second constant fitted to the published uniaxial \
                 curve up to a stretch of 1.2 (within 13, 12, 40 % in skin, muscle, fat)"
            }
            Self::Wang2009 => "Wang, Yang and Gee, Int J Med Robotics 5, 2009, Table 1, as published",
            Self::Nazari2010 => {
                "Nazari, Perrier, Chabanas and Payan, Comput Methods Biomech Biomed Eng 13, 2010, after indentation of a cheek by Gerard, \
                 Ohayon, Luboz, Perrier and Payan, Med Eng Phys 27, 2005; the Poisson ratio is ours; constants not compared with the print"
            }
            Self::Chabanas2003 => {
                "Chabanas, Luboz and Payan, Med Image Anal 7, 2003: passive tissue, E = 15 kPa and Poisson ratio 0.49 at small strain, here \
                 neo-Hookean; without the stiffer fibres of muscles; constants not compared with the print"
            }
        }
    }

    /// The materials of this preset, with D1 read as Poisson ratio (reading notes 19).
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
