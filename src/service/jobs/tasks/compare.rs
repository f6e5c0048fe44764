use super::baselines::{BoneBelow, Mapped, baselines, follow_bone};
use super::face::FaceAnchors;
use super::predictions::Predictions;
use crate::Service;
use prosopon_contract::{
    BaselinesDocument, ErrorDocument, Fault, FaultKind, Findings, Halt, RegisterOn, RegistrationDocument,
};
use prosopon_geometry::control::Control;
use prosopon_geometry::{Point, TriMesh, Warning};
use prosopon_planning::evaluate::{Mask, MaskRegion};
use prosopon_session::Engine;

/// A predicted surface.
#[derive(Debug, Clone, PartialEq)]
pub struct Prediction {
    /// The surface.
    pub mesh: TriMesh,
    /// Displacement of each vertex, mm; `None` when no job predicted the surface.
    pub displacement_mm: Option<Vec<f32>>,
    /// The surface at rest, on which the parts of the face are placed; `None` when no job moved it.
    pub rest: Option<TriMesh>,
    /// What places the parts of the face; `None` when it is not a face.
    pub face: Option<FaceAnchors>,
    /// The bone that moved it, or why it is not known.
    pub bone: Result<Box<BoneBelow>, String>,
}

/// Two surfaces to compare.
#[derive(Debug, Clone, PartialEq)]
pub struct Comparison {
    /// The prediction.
    pub prediction: Prediction,
    /// The reference surface.
    pub reference: TriMesh,
    /// Name of the reference in the answer.
    pub reference_name: String,
    /// Models of both, when both are predictions.
    pub predictions: Option<Predictions>,
    /// Vertices of the prediction that count.
    pub mask: Mask,
    /// Parts of space that are left out of the comparison and of the registration.
    pub exclude: Vec<MaskRegion>,
    /// Whether the eyes are left out too, when the prediction is a face.
    pub exclude_eyes: bool,
    /// Whether only the parts of the face count when the mask is empty.
    pub face_only: bool,
    /// Rigid registration of the prediction before comparing.
    pub register: Option<RegisterOn>,
}

/// An error map with its surface.
#[derive(Debug, Clone, PartialEq)]
pub struct Compared {
    /// Statistics.
    pub document: ErrorDocument,
    /// The prediction in its own frame: a registration moves the reference.
    pub mesh: TriMesh,
    /// Signed error of each vertex, mm.
    pub error_mm: Vec<f32>,
    /// Distance of each vertex from its counterpart, mm; `None` when the triangles differ.
    pub correspondence_mm: Option<Vec<f32>>,
}

/// Compares two surfaces on the threads for requests.
///
/// # Errors
/// As [`Comparison::run`].
pub async fn compare(service: &Service, comparison: Comparison) -> Result<Compared, Fault> {
    service.compute(move |engine, control| comparison.run(engine, control)).await
}

impl Comparison {
    /// Registers the surfaces if requested, and compares them.
    ///
    /// # Errors
    /// The numerics'; [`FaultKind::InvalidRequest`] for a mask whose length is not the number of vertices.
    pub fn run(self, engine: &dyn Engine, control: &Control) -> Result<Compared, Halt> {
        let Prediction { mesh, displacement_mm, rest: at_rest, face, bone } = self.prediction;
        let mut reference = self.reference;
        let given = [
            ("/mask_vertices", &self.mask),
            ("/register/unaltered_vertices", &self.register.as_ref().map(|r| r.region.clone()).unwrap_or_default()),
        ];
        for (pointer, mask) in given {
            check_length(pointer, mask, &mesh)?;
        }
        let rest = at_rest.as_ref().unwrap_or(&mesh);
        let (mut except, mut document_of, mut findings) = (self.exclude, None, Findings::default());
        match &face {
            Some(face) if self.exclude_eyes => except.extend(face.eyes(rest)),
            None if self.exclude_eyes => {
                let text = "the eyes were not left out: the prediction is not a skin, so the eyes cannot be placed";
                findings.push(Warning::check("eyes-not-placed", text).into());
            }
            _ => {}
        }
        let without: Vec<bool> = Mask { except, ..Mask::default() }.of(&mesh);
        let both = |a: Vec<bool>| -> Vec<bool> { a.into_iter().zip(&without).map(|(a, b)| a && *b).collect() };
        let regions = face.map(|face| face.regions(rest)).unwrap_or_default();
        let in_face = |p: &Point| regions.iter().any(|r| r.contains(p));
        let (mask_name, counted) = if !self.mask.is_empty() {
            ("given", self.mask.of(&mesh))
        } else if self.face_only && !regions.is_empty() {
            ("face", rest.positions().iter().map(in_face).collect())
        } else {
            ("all", vec![true; mesh.positions().len()])
        };
        let counted = both(counted);
        if let Some(on) = self.register {
            let (name, region) = registered(&on, &mesh, displacement_mm.as_deref());
            let found = engine.register(&mesh, &reference, Some(&both(region)), &control.stage(0.0, 0.5))?;
            findings.extend(found.warnings.iter().cloned());
            document_of = Some(RegistrationDocument::new(&found, name));
            // The reference moves to the prediction, so that masks, parts of the face and pictures stay in the patient's frame.
            reference = reference.moved(&found.motion.inverse());
        }
        let map = engine.error_map(&mesh, &reference, Some(&counted), &regions, &control.stage(0.5, 0.8))?;
        let mut document = ErrorDocument::new(self.reference_name, mask_name, &map);
        let control = control.stage(0.8, 1.0);
        document.baselines = Some(match (&at_rest, bone) {
            (None, why) => BaselinesDocument {
                missing: Some(why.err().unwrap_or_else(|| "the skin at rest is not known".to_owned())),
                ..BaselinesDocument::default()
            },
            (Some(rest), bone) => {
                let bone = match bone {
                    Ok(below) => follow_bone(engine, &below, rest, &control)?,
                    Err(why) => Err(why),
                };
                let (prediction, reference) = (&mesh, &reference);
                let mapped = Mapped { prediction, map: &map, reference, mask: Some(&counted), regions: &regions };
                baselines(&mapped, rest, bone, &control)?
            }
        });
        if self.predictions.as_ref().is_some_and(|both| !both.same_plan) {
            let text = "the two predictions follow different plans: the values do not compare the models alone";
            findings.push(Warning::check("different-plans", text).into());
        }
        document.models = self.predictions.map(|both| both.models);
        document.registration = document_of;
        findings.extend(document.findings.iter().cloned());
        document.findings = findings;
        let correspondence_mm = map.correspondence.map(|c| c.distance_mm);
        Ok(Compared { document, mesh, error_mm: map.signed_mm, correspondence_mm })
    }
}

/// Vertices that a registration uses: name of the region and a flag for each vertex.
fn registered(on: &RegisterOn, mesh: &TriMesh, displacement_mm: Option<&[f32]>) -> (&'static str, Vec<bool>) {
    match displacement_mm {
        _ if !on.region.is_empty() => ("given", on.region.of(mesh)),
        Some(moved) => ("unmoved", moved.iter().map(|d| f64::from(*d) < on.threshold_mm).collect()),
        None => ("all", vec![true; mesh.positions().len()]),
    }
}

fn check_length(pointer: &str, mask: &Mask, mesh: &TriMesh) -> Result<(), Fault> {
    let n = mesh.positions().len();
    match &mask.vertices {
        Some(vertices) if vertices.len() != n => {
            let detail = format!("has {} entries, but the prediction has {n} vertices", vertices.len());
            Err(Fault::new(FaultKind::InvalidRequest, detail).at(pointer))
        }
        _ => Ok(()),
    }
}
