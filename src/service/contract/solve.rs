use std::time::Duration;

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};
use utoipa::ToSchema;
use uuid::Uuid;

use super::attachment::Attachment;
use super::budget::Budget;
use super::check::Check;
use super::choices::{PlanChoice, SupersedeChoice, SupersedeForms};
use super::fault::Fault;
use super::material::{
    D1ReadingName, LockingName, PresetName, SkinElementName, TissueLawsDocument, UnstableMaterialName,
};
use super::material_check::check_laws;
use super::model_name::ModelName;
use super::session::{MAX_STEPS, SessionSettings};
use prosopon_planning::simulate::LEAVE_OUT_BELOW_MM;
use prosopon_tissue::fem::{Locking, SolveSettings};

/// Load steps of a solve that starts from rest.
const DEFAULT_STEPS: u32 = 6;

/// An optional result of a solve. The service always keeps the skin of each step and the report.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum OutputName {
    /// Deformed skin of each step; kept in any case.
    Skin,
    /// Signed error map of each step, if the session has a target or the job names a reference job.
    Error,
    /// Deformed tissue volume, as VTU.
    Tissue,
}

/// Model, elements, materials and tolerances: the part of a solve that HTTP and `prosopon solve` share.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct SolverOptions {
    /// Mechanical model.
    pub model: ModelName,
    /// Element of the skin layer; the model's when `None`.
    pub skin_element: Option<SkinElementName>,
    /// Locking-free formulation; when `None`, the one that [`SolverOptions::settings`] is given.
    pub locking: Option<LockingName>,
    /// Materials.
    pub preset: PresetName,
    /// Meaning of D1 in the preset `wang_2009`.
    pub d1_reading: Option<D1ReadingName>,
    /// Laws in place of the preset's.
    pub materials: TissueLawsDocument,
    /// Residual force over reaction force at which a step is in equilibrium; the solver's when `None`.
    pub relative_residual: Option<f64>,
    /// Largest remaining penetration of bone, mm; the solver's when `None`.
    pub penetration_tolerance_mm: Option<f64>,
    /// Treatment of materials that lose ellipticity.
    pub unstable_material: UnstableMaterialName,
}

impl SolverOptions {
    /// Reports every value that is not allowed.
    pub fn check(&self, check: &mut Check) {
        if self.d1_reading.is_some() && self.preset != PresetName::Wang2009 {
            check.fault("/d1_reading", "applies to the preset wang_2009 only; remove it or choose that preset");
        }
        check_laws(check, "/materials", &self.materials);
        if let Some(share) = self.relative_residual {
            check.number("/relative_residual", share, 1e-12, 0.1);
        }
        if let Some(depth) = self.penetration_tolerance_mm {
            check.number("/penetration_tolerance_mm", depth, 1e-6, 10.0);
        }
    }

    /// Settings for the solver; `locking` applies when the options name none.
    #[must_use]
    pub fn settings(&self, locking: Locking) -> SolveSettings {
        let materials = self.materials.over(self.preset.materials(self.d1_reading.unwrap_or_default()));
        let mut settings = SolveSettings::new(self.model.resolved(self.skin_element).into(), materials);
        settings.skin_element = self.skin_element.map_or(settings.skin_element, Into::into);
        settings.locking = self.locking.map_or(locking, Into::into);
        settings.relative_residual = self.relative_residual.unwrap_or(settings.relative_residual);
        settings.penetration_tolerance_mm = self.penetration_tolerance_mm.unwrap_or(settings.penetration_tolerance_mm);
        settings.unstable_material = self.unstable_material.into();
        settings
    }

    /// The options as a report shows them.
    #[must_use]
    pub fn parameters(&self) -> Map<String, Value> {
        // A structure of plain values is always an object.
        let mut members = json!(self).as_object().cloned().unwrap_or_default();
        members.remove("model");
        members.insert("model_chosen_by_the_service".to_owned(), json!(self.model == ModelName::Auto));
        members
    }
}

/// Request for a solve: a plan, a model, and options that all have defaults.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct SolveRequest {
    /// Id of the plan that the bone follows, or a new plan, which is created first.
    pub plan: PlanChoice,
    /// Mechanical model; `auto` when absent.
    #[serde(default)]
    pub model: ModelName,
    /// Number of streamed steps, 1 to 200.
    ///
    /// When absent: 1 with `warm_start`, else the session's setting, else 6.
    #[serde(default)]
    pub steps: Option<u32>,
    /// Id of a `mesh` job of this session, built for the plan's osteotomy or for no osteotomy.
    ///
    /// The solve uses its mesh.
    ///
    /// When absent, the solve uses the newest mesh that matches the plan's osteotomy. If none matches, the job builds one with
    /// the settings of the newest mesh, or with the defaults if the session has no mesh.
    #[serde(default)]
    pub mesh: Option<Uuid>,
    /// Id of a succeeded solve of this session from whose end state this solve starts.
    ///
    /// Both must have the same mesh, cuts, moving segments, model and settings.
    /// The bone moves straight from the end of that solve's plan to the end of this plan, which takes a fraction of the time.
    /// The steps lie on that path. Where tissue slides over edges of bone, the result can depend slightly on the starting
    /// state: solve plans that you keep from rest. The job starts from rest when absent.
    #[serde(default)]
    pub warm_start: Option<Uuid>,
    /// Limits within which `auto` chooses edge length and elements, where the request does not give them.
    ///
    /// The report's `budget` says what was chosen and why, and the error estimated afterwards by a second solve on a coarser
    /// mesh (phase `estimate`), which takes about as long as mesh and path. The mesh is the one that `mesh` names, or has the
    /// settings of the newest mesh and the chosen edge; a later job with `warm_start` needs it as a `mesh` job of its own.
    #[serde(default)]
    pub budget: Option<Budget>,
    /// Results to keep besides the report; `skin` and `error` when absent.
    #[serde(default)]
    pub outputs: Option<Vec<OutputName>>,
    /// Id of a succeeded solve as reference of the error maps, if the session has no target.
    ///
    /// Its cuts and paths must be the same.
    #[serde(default)]
    pub reference_job: Option<Uuid>,
    /// Material preset; the session's setting when absent, else `wang_2009_stable`.
    #[serde(default)]
    pub preset: Option<PresetName>,
    /// Meaning of the constant D1 in the preset `wang_2009`; not allowed with other presets.
    ///
    /// `poisson_ratio` when absent.
    #[serde(default)]
    pub d1_reading: Option<D1ReadingName>,
    /// Material laws by tissue that replace those of the preset; the preset's when absent.
    #[serde(default)]
    pub materials: TissueLawsDocument,
    /// Element of the skin layer.
    ///
    /// When absent: `wedge` for `linear` and `mass_tensor`, `tet` for `nonlinear`, `c1_prism` for `mixed`.
    #[serde(default)]
    pub skin_element: Option<SkinElementName>,
    /// Locking-free formulation for nearly incompressible tissue.
    ///
    /// When absent: `patched` on an uploaded tissue mesh, else `none`.
    #[serde(default)]
    pub locking: Option<LockingName>,
    /// Convergence tolerance: residual force divided by reaction force, 1e-12 to 0.1; 1e-4 when absent.
    #[serde(default)]
    pub relative_residual: Option<f64>,
    /// Largest penetration of tissue into bone in a converged step, mm, 1e-6 to 10; 0.05 when absent.
    #[serde(default)]
    pub penetration_tolerance_mm: Option<f64>,
    /// Estimated displacement below which tissue is left out, mm, 0 to 1; 0.03 when absent.
    ///
    /// Tissue that is left out is not in the equations and keeps its rest position. 0 keeps all tissue. The report's `left_out`
    /// gives the extent and the effect. Solves on an uploaded tissue mesh always keep all tissue.
    #[serde(default)]
    #[schema(minimum = 0, maximum = 1)]
    pub leave_out_below_mm: Option<f64>,
    /// What to do where a material loses ellipticity; `report` when absent.
    ///
    /// `report` states the loss in the step's `outcome`; the job fails with the problem `solver-unstable` where it finds no
    /// equilibrium. `stabilise` continues there with a neo-Hookean law of the same small-strain moduli.
    #[serde(default)]
    pub unstable_material: UnstableMaterialName,
    /// Attachment of tissue to bone; the default rule, placed by the landmarks, when absent.
    #[serde(default)]
    pub attachment: Option<Attachment>,
    /// Longest computing time, s, at least 1; the service's limit when absent.
    ///
    /// After that time the job fails and keeps its finished steps.
    #[serde(default)]
    pub max_wall_s: Option<f64>,
    /// Which waiting solves this one replaces; none when absent.
    ///
    /// They are cancelled. `true` or `plan`: those of the same plan. `session`: all of the session, as for a slider whose last
    /// position counts.
    #[serde(default)]
    #[schema(value_type = Option<SupersedeForms>)]
    pub supersede: SupersedeChoice,
}

impl SolveRequest {
    /// The request, checked, with the defaults of the session and the service filled in. This is the stored form.
    ///
    /// `locking` applies when the request names none.
    ///
    /// # Errors
    /// A fault that lists every value that is not allowed.
    pub fn resolved(mut self, session: &SessionSettings, max_wall: Duration, locking: Locking) -> Result<Self, Fault> {
        let usual = if self.warm_start.is_some() { 1 } else { session.steps.unwrap_or(DEFAULT_STEPS) };
        let steps = *self.steps.get_or_insert(usual);
        self.preset.get_or_insert(session.preset.unwrap_or_default());
        let mut check = Check::default();
        check.number("/steps", f64::from(steps), 1.0, f64::from(MAX_STEPS));
        if let Some(attachment) = &self.attachment {
            attachment.check(&mut check);
        }
        self.options().check(&mut check);
        if let Some(seconds) = self.max_wall_s {
            check.number("/max_wall_s", seconds, 1.0, max_wall.as_secs_f64());
        }
        check.number("/leave_out_below_mm", self.leave_out_below_mm(), 0.0, 1.0);
        self.check_budget(max_wall, &mut check);
        check.finish()?;
        self.fill(locking);
        Ok(self)
    }

    fn check_budget(&self, max_wall: Duration, check: &mut Check) {
        let Some(budget) = &self.budget else { return };
        budget.check(max_wall.as_secs_f64(), check);
        if self.model != ModelName::Auto {
            check.fault("/budget", "is for the model `auto`; leave `model` or `budget` out");
        }
        if self.skin_element.is_some_and(|element| element != SkinElementName::Tet) {
            check.fault("/skin_element", "must be `tet` with a budget, whose table knows no other");
        }
        if self.warm_start.is_some() {
            check.fault(
                "/budget",
                "cannot be kept from the end state of another solve; leave `warm_start` or `budget` out",
            );
        }
    }

    /// Fills in the defaults of the solver, so that requests with the same meaning are equal.
    fn fill(&mut self, locking: Locking) {
        let defaults = SolverOptions { model: self.model, ..SolverOptions::default() }.settings(locking);
        self.skin_element.get_or_insert(defaults.skin_element.into());
        self.locking.get_or_insert(defaults.locking.into());
        self.relative_residual.get_or_insert(defaults.relative_residual);
        self.penetration_tolerance_mm.get_or_insert(defaults.penetration_tolerance_mm);
        self.leave_out_below_mm.get_or_insert(LEAVE_OUT_BELOW_MM);
        if self.preset == Some(PresetName::Wang2009) {
            self.d1_reading.get_or_insert_default();
        }
        self.attachment = self.attachment.take().filter(|a| *a != Attachment::default());
        let outputs = [(self.wants_error_maps(), OutputName::Error), (self.wants_tissue(), OutputName::Tissue)];
        let wanted = outputs.into_iter().filter_map(|(wanted, output)| wanted.then_some(output));
        self.outputs = Some(std::iter::once(OutputName::Skin).chain(wanted).collect());
    }

    /// Refuses options that an uploaded tissue mesh replaces.
    ///
    /// # Errors
    /// A fault that lists them.
    pub fn check_uploaded_mesh(&self) -> Result<(), Fault> {
        let mut check = Check::default();
        if self.attachment.is_some() {
            check.fault("/attachment", "the uploaded tissue mesh has its own array `attachment`; remove this member");
        }
        if self.budget.is_some() {
            check.fault("/budget", "is for meshes that the service builds; remove this member");
        }
        if self.mesh.is_some() {
            check.fault("/mesh", "solves of this session use the uploaded tissue mesh; remove this member");
        }
        if self.reference_job.is_some() {
            check.fault("/reference_job", "solves on an uploaded tissue mesh make no error maps; remove this member");
        }
        if self.warm_start.is_some() {
            check.fault("/warm_start", "solves on an uploaded tissue mesh start from rest; remove this member");
        }
        if self.leave_out_below_mm.is_some_and(|least| least != 0.0) {
            check.fault("/leave_out_below_mm", "must be 0: solves on an uploaded tissue mesh keep all tissue");
        }
        check.finish()
    }

    /// The part that HTTP and `prosopon solve` share.
    #[must_use]
    pub fn options(&self) -> SolverOptions {
        SolverOptions {
            model: self.model,
            skin_element: self.skin_element,
            locking: self.locking,
            preset: self.preset.unwrap_or_default(),
            d1_reading: self.d1_reading,
            materials: self.materials,
            relative_residual: self.relative_residual,
            penetration_tolerance_mm: self.penetration_tolerance_mm,
            unstable_material: self.unstable_material,
        }
    }

    /// The model that is solved.
    #[must_use]
    pub fn solved_model(&self) -> ModelName {
        self.model.resolved(self.skin_element)
    }

    /// Number of load steps of a resolved request.
    #[must_use]
    pub fn steps(&self) -> u32 {
        self.steps.unwrap_or(DEFAULT_STEPS)
    }

    /// Expected movement below which tissue is left out, mm; 0 keeps all.
    #[must_use]
    pub fn leave_out_below_mm(&self) -> f64 {
        self.leave_out_below_mm.unwrap_or(LEAVE_OUT_BELOW_MM)
    }

    /// Whether error maps are made if there is something to compare with; by default they are.
    #[must_use]
    pub fn wants_error_maps(&self) -> bool {
        self.outputs.as_ref().is_none_or(|outputs| outputs.contains(&OutputName::Error))
    }

    /// Whether the deformed volume is kept; by default it is not.
    #[must_use]
    pub fn wants_tissue(&self) -> bool {
        self.outputs.as_ref().is_some_and(|outputs| outputs.contains(&OutputName::Tissue))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn resolved(text: &str) -> SolveRequest {
        let request: SolveRequest = serde_json::from_str(text).unwrap();
        request.resolved(&SessionSettings::default(), Duration::from_secs(3600), Locking::None).unwrap()
    }

    #[test]
    fn a_default_that_is_given_makes_no_other_request() {
        const PLAN: &str = r#""plan": "0192f0c4-0000-7000-8000-000000000000", "model": "linear""#;
        let plain = resolved(&format!("{{{PLAN}}}"));
        for given in [
            r#""locking": "none""#,
            r#""skin_element": "wedge""#,
            r#""relative_residual": 1e-4"#,
            r#""penetration_tolerance_mm": 0.05"#,
            r#""leave_out_below_mm": 0.03"#,
            r#""outputs": ["error", "skin", "skin"]"#,
            r#""attachment": {"paint": []}"#,
            r#""preset": "wang_2009_stable", "steps": 6"#,
        ] {
            assert_eq!(resolved(&format!("{{{PLAN}, {given}}}")), plain, "{given}");
        }
        assert_ne!(resolved(&format!(r#"{{{PLAN}, "locking": "smoothed"}}"#)), plain);
        let auto = |more: &str| resolved(&format!("{{{PLAN}{more}}}").replace(r#", "model": "linear""#, ""));
        assert_eq!(auto("").solved_model(), ModelName::Nonlinear);
        // As earlier versions stored `auto`.
        assert_eq!(auto(r#", "skin_element": "c1_prism", "locking": "none""#).solved_model(), ModelName::Mixed);
        assert_eq!(serde_json::from_str::<SolveRequest>(&serde_json::to_string(&plain).unwrap()).unwrap(), plain);
    }
}
