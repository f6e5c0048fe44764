use super::error::SolveError;
use super::material::Materials;
use crate::geometry::Implicit;

/// Mechanical model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Model {
    /// Small strain on linear elements (LFEM).
    Linear,
    /// Hyperelastic, C1 prisms for the skin, linear tetrahedra inside (NFM-EM).
    Mixed,
}

/// Element of the skin layer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SkinElement {
    /// Linear wedge.
    Wedge,
    /// Prism with a C1 outer surface.
    C1Prism,
}

/// Named sets of materials.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Preset {
    /// Stable neo-Hookean with the published small-strain moduli (reading notes 20).
    Wang2009Stable,
    /// The published constants, which lose ellipticity early.
    Wang2009,
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

/// How the problem is solved.
#[derive(Debug, Clone, PartialEq)]
pub struct SolveSettings {
    /// Mechanical model.
    pub model: Model,
    /// Skin element of [`Model::Mixed`].
    pub skin_element: SkinElement,
    /// Materials.
    pub materials: Materials,
    /// Largest penetration accepted after a step, mm.
    pub penetration_tolerance_mm: f64,
    /// Residual force relative to the reaction force.
    pub relative_residual: f64,
    /// Newton iterations before a step is halved.
    pub max_iterations: usize,
    /// Shortest substep as a share of the path, before giving up.
    pub min_substep: f64,
}

impl SolveSettings {
    /// Settings with the defaults: C1 prisms, 0.05 mm penetration, 1e-4 relative residual, 30 iterations, substeps down to 1/256.
    #[must_use]
    pub fn new(model: Model, materials: Materials) -> Self {
        Self {
            model,
            skin_element: SkinElement::C1Prism,
            materials,
            penetration_tolerance_mm: 0.05,
            relative_residual: 1e-4,
            max_iterations: 30,
            min_substep: 1.0 / 256.0,
        }
    }

    pub(super) fn check(&self) -> Result<(), SolveError> {
        let positive = [
            ("penetration_tolerance_mm", self.penetration_tolerance_mm, f64::INFINITY),
            ("relative_residual", self.relative_residual, 0.1),
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

impl Preset {
    /// The materials of this preset, with D1 read as Poisson ratio (reading notes 19).
    #[must_use]
    pub fn materials(self) -> Materials {
        match self {
            Self::Wang2009Stable => Materials::wang2009_stable(),
            Self::Wang2009 => Materials::wang2009(),
        }
    }
}
