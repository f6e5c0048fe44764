//! The modelling choices that the study changes.

use super::super::end_skin::usual_run;
use prosopon_planning::simulate::{AttachmentRules, Beyond, Mouth, NodeClass, RunSettings, TissueSettings};
use prosopon_tissue::fem::material::{Material, Materials};
use prosopon_tissue::fem::{Locking, Model, SolveSettings};

/// All choices of one solve.
pub(super) struct Choices {
    pub(super) run: RunSettings,
    pub(super) tissue: TissueSettings,
}

/// A choice that differs from the usual one.
pub(super) struct Choice {
    pub(super) name: &'static str,
    pub(super) change: fn(&mut Choices),
}

impl Choices {
    /// The defaults of the service.
    pub(super) fn usual(steps: usize) -> Self {
        Self { run: usual_run(steps), tissue: TissueSettings::default() }
    }

    fn rules(&mut self) -> &mut AttachmentRules {
        self.run.attachment.get_or_insert_default()
    }

    fn materials(&mut self, change: impl Fn(Material) -> Material) {
        let Materials { skin, muscle, fat, mucosa, cartilage } = self.run.solver.materials;
        let [skin, muscle, fat, mucosa, cartilage] = [skin, muscle, fat, mucosa, cartilage].map(change);
        self.run.solver.materials = Materials { skin, muscle, fat, mucosa, cartilage };
    }
}

/// The material with its shear modulus times `factor`, and another Poisson ratio when there is one.
fn changed(material: Material, factor: f64, poisson: Option<f64>) -> Material {
    Material::neo_hookean(factor * material.shear_modulus(), poisson.unwrap_or(material.poisson_ratio()))
}

/// Every choice, in groups: how tissue hangs on bone, materials, elements and mesh.
pub(super) fn choices() -> Vec<Choice> {
    let choice = |name, change| Choice { name, change };
    vec![
        choice("teeth: pushed only", |c| c.rules().mucosa = NodeClass::Sliding),
        choice("teeth: tied", |c| c.rules().mucosa = NodeClass::Tied),
        choice("stripped bone: pushed only", |c| c.rules().stripped = NodeClass::Sliding),
        choice("stripped bone: tied", |c| c.rules().stripped_mm = Some(0.0)),
        choice("stripped bone: 6 mm", |c| c.rules().stripped_mm = Some(6.0)),
        choice("stripped bone: 18 mm", |c| c.rules().stripped_mm = Some(18.0)),
        choice("saw line: pushed only", |c| c.rules().saw_line = NodeClass::Sliding),
        choice("saw line: glides", |c| c.rules().saw_line = NodeClass::Gliding),
        choice("gliding: lets go at 1 kPa", |c| c.rules().pull_off_mpa = Some(1e-3)),
        choice("lips: part", |c| c.tissue.mouth = Mouth::Auto),
        choice("neck: a wall", |c| c.rules().beyond = Beyond::Wall),
        choice("all: pushed only, 6 mm", |c| {
            c.rules().beyond = Beyond::Wall;
            let rules = c.rules();
            (rules.mucosa, rules.stripped) = (NodeClass::Sliding, NodeClass::Sliding);
            rules.stripped_mm = Some(6.0);
        }),
        choice("stiffness: twice", |c| c.materials(|m| changed(m, 2.0, None))),
        choice("stiffness: half", |c| c.materials(|m| changed(m, 0.5, None))),
        choice("skin: twice as stiff", |c| {
            c.run.solver.materials.skin = changed(c.run.solver.materials.skin, 2.0, None);
        }),
        choice("skin: half as stiff", |c| {
            c.run.solver.materials.skin = changed(c.run.solver.materials.skin, 0.5, None);
        }),
        choice("Poisson ratio: 0.40", |c| c.materials(|m| changed(m, 1.0, Some(0.40)))),
        choice("Poisson ratio: 0.49, patched", |c| {
            c.materials(|m| changed(m, 1.0, Some(0.49)));
            c.run.solver.locking = Locking::Patched;
        }),
        choice("skin layer: 1 mm", |c| c.tissue.mesh.skin_thickness_mm = 1.0),
        choice("skin layer: 2.5 mm", |c| c.tissue.mesh.skin_thickness_mm = 2.5),
        choice("nose: cartilage", |c| c.tissue.cartilage = true),
        choice("nose: cartilage of 3 MPa", |c| {
            c.tissue.cartilage = true;
            c.run.solver.materials.cartilage = changed(c.run.solver.materials.cartilage, 3.0, None);
        }),
        choice("eyes: move with tissue", |c| c.tissue.globes = false),
        choice("tissue by depth", |c| c.tissue.tissue_by_depth = true),
        choice("model: linear", |c| {
            c.run.solver = SolveSettings::new(Model::Linear, c.run.solver.materials);
        }),
        choice("model: mixed", |c| {
            c.run.solver = SolveSettings::new(Model::Mixed, c.run.solver.materials);
        }),
        choice("elements: patched", |c| c.run.solver.locking = Locking::Patched),
        choice("elements: smoothed", |c| c.run.solver.locking = Locking::Smoothed),
        choice("edge: 3 mm", |c| c.tissue.mesh.edge_mm = 3.0),
        choice("edge: 5 mm", |c| c.tissue.mesh.edge_mm = 5.0),
        choice("depth: 45 mm", |c| c.tissue.mesh.depth_mm = 45.0),
    ]
}
