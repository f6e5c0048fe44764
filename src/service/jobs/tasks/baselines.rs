//! What simple predictions would score on the points of an error map.

use crate::Service;
use crate::kept::case_of;
use crate::requests::SolveTask;
use prosopon_contract::{BaselinesDocument, Fault, Halt, stored_cuts};
use prosopon_geometry::control::Control;
use prosopon_geometry::{Motion, TriMesh, Vector};
use prosopon_planning::evaluate::{ErrorMap, EvaluateError, FaceRegion, baseline_error};
use prosopon_planning::plan::Cut;
use prosopon_session::{Case, Engine, SessionParts};
use prosopon_store::JobRecord;

/// The bone below a prediction.
#[derive(Debug, Clone, PartialEq)]
pub struct BoneBelow {
    /// The patient.
    pub case: Case,
    /// Cuts that part the bone.
    pub cuts: Vec<Cut>,
    /// Motions of the moved segments from rest.
    pub motions: Vec<(u32, Motion)>,
}

/// The bone below step `t` of a solve; the inner error says why it is not known.
///
/// # Errors
/// The store's.
pub(crate) async fn bone_below(
    service: &Service,
    job: &JobRecord,
    parts: &SessionParts,
    t: f64,
) -> Result<Result<Box<BoneBelow>, String>, Fault> {
    let request = match SolveTask::of(job) {
        Ok(request) => request,
        Err(why) => return Ok(Err(format!("the bone is not known: the job {why}"))),
    };
    let key = parts.mesh_key(&request.mesh.settings, request.mesh.cuts.as_deref());
    if key.ok().as_deref() != Some(request.mesh_key.as_str()) {
        return Ok(Err("the bone is not known: inputs of the session were replaced after the solve".to_owned()));
    }
    let cuts = stored_cuts(&request.cuts)?;
    let motions = request.plan.plan().map_err(|e| Fault::from(Halt::from(e)))?.motions(t);
    Ok(Ok(Box::new(BoneBelow { case: case_of(service, parts).await?, cuts, motions })))
}

/// A prediction with its error map, for the baselines.
pub(crate) struct Mapped<'a> {
    pub(crate) prediction: &'a TriMesh,
    pub(crate) map: &'a ErrorMap,
    pub(crate) reference: &'a TriMesh,
    pub(crate) mask: Option<&'a [bool]>,
    pub(crate) regions: &'a [FaceRegion],
}

/// Error of the skin at rest and of 0.7 of the nearest bone on the points of an error map.
///
/// `bone` is the displacement of the skin at 0.7 of the nearest bone, or why it is not known. A surface that cannot be compared
/// is reported in the document, because the prediction's own error is known already.
///
/// # Errors
/// [`Halt::Cancelled`].
pub(crate) fn baselines(
    mapped: &Mapped<'_>,
    rest: &TriMesh,
    bone: Result<Vec<Vector>, String>,
    control: &Control,
) -> Result<BaselinesDocument, Halt> {
    let of = |skin: &TriMesh| {
        let pair = (mapped.prediction, mapped.map);
        match baseline_error(pair, skin, mapped.reference, mapped.mask, mapped.regions, control) {
            Ok(Some(found)) => Ok(Ok((&found).into())),
            Ok(None) => Ok(Err("no point of the skin projects inside the border of the reference".to_owned())),
            Err(EvaluateError::Cancelled(_)) => Err(Halt::Cancelled),
            Err(fault) => Ok(Err(fault.to_string())),
        }
    };
    let no_prediction = of(rest)?;
    let nearest_bone = match bone {
        Ok(moved) => {
            let moved = rest.positions().iter().zip(&moved).map(|(p, u)| p + u).collect();
            match rest.with_positions(moved) {
                Ok(skin) => of(&skin)?,
                Err(fault) => Err(fault.to_string()),
            }
        }
        Err(why) => Err(why),
    };
    let missing = [&no_prediction, &nearest_bone].into_iter().find_map(|found| found.as_ref().err().cloned());
    Ok(BaselinesDocument { no_prediction: no_prediction.ok(), nearest_bone: nearest_bone.ok(), missing })
}

/// Displacement of the skin at 0.7 of the nearest bone, or why there is none.
///
/// # Errors
/// [`Halt::Cancelled`].
pub(crate) fn follow_bone(
    engine: &dyn Engine,
    below: &BoneBelow,
    rest: &TriMesh,
    control: &Control,
) -> Result<Result<Vec<Vector>, String>, Halt> {
    match engine.nearest_bone(&below.case, &below.cuts, &below.motions, rest, control) {
        Ok(Some(moved)) => Ok(Ok(moved)),
        Ok(None) => Ok(Err("the bone is not known: the cuts leave no segment".to_owned())),
        Err(Halt::Cancelled) => Err(Halt::Cancelled),
        Err(Halt::Fault(fault)) => Ok(Err(format!("the bone is not known: {}", fault.detail))),
    }
}
