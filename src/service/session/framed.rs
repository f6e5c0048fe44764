//! The patient in the frame of the head, in which all numerics run, and the ways there and back.
//!
//! Requests and answers are in LPS of the scan. Proposals, templates, names of segments, regions and the lattice of the mesh follow the
//! axes of space, so that a head that lies tilted in the scanner is turned upright first. Every input goes through here once, and
//! so does every answer.

use std::sync::Arc;

use super::case::Earlier;
use super::{Case, Run, RunWatch, TissueRequest};
use prosopon_contract::{Cuts, Halt};
use prosopon_field::FieldReport;
use prosopon_geometry::{Motion, Point, TriMesh, Vector, Warning};
use prosopon_planning::evaluate::FaceRegion;
use prosopon_planning::plan::{Clearance, Cut, Osteotomy, PathReport, Plan, Proposal, TemplateCall};
use prosopon_planning::simulate::{Frame, Outcome, PathCheckpoint, RunSettings};
use prosopon_tissue::mesh::MeshReport;

/// A case in the frame of its head.
#[derive(Debug, Clone)]
pub(super) struct Framed {
    /// The case in that frame.
    pub(super) case: Case,
    /// Maps LPS into it.
    into: Motion,
    back: Motion,
}

impl Framed {
    /// The case seen from the frame into which `into` maps.
    pub(super) fn new(case: &Case, into: Motion) -> Self {
        let back = into.inverse();
        // The planes of the old form pass through the face, near the frame's origin.
        let near = back * Point::origin();
        let is_given = |name: &str| !case.unconfirmed.iter().any(|n| n == name);
        // Without a midline that someone confirmed, it is that of the frame.
        let midline = case.midline_x_mm.filter(|_| is_given("midline_x_mm"));
        let midline_x_mm = Some(midline.map_or(0.0, |x| (into * Point::new(x, near.y, near.z)).x));
        let occlusal_z_mm = case.occlusal_z_mm.map(|z| (into * Point::new(near.x, near.y, z)).z);
        let anatomy = Arc::new(case.anatomy.moved(&into, midline_x_mm));
        Self { case: Case { anatomy, midline_x_mm, occlusal_z_mm, ..case.clone() }, into, back }
    }

    /// A point of the request.
    pub(super) fn point(&self, p: &Point) -> Point {
        self.into * p
    }

    /// A direction of the answer.
    pub(super) fn direction_back(&self, v: &Vector) -> Vector {
        self.back * v
    }

    /// A point of the answer.
    pub(super) fn point_back(&self, p: &Point) -> Point {
        self.back * p
    }

    /// A skin of the request.
    pub(super) fn surface(&self, mesh: &TriMesh) -> TriMesh {
        mesh.moved(&self.into)
    }

    pub(super) fn cuts(&self, cuts: &[Cut]) -> Vec<Cut> {
        cuts.iter().map(|cut| cut.moved(&self.into)).collect()
    }

    /// The request of an osteotomy.
    pub(super) fn request(&self, request: &Cuts) -> Cuts {
        let near = self.back * Point::origin();
        let template = |call: &TemplateCall| TemplateCall {
            landmarks: call.landmarks.seen_from(&self.into, &near),
            ..call.clone()
        };
        Cuts {
            templates: request.templates.iter().map(template).collect(),
            cuts: self.cuts(&request.cuts),
            protected: request.protected.iter().map(|p| p.moved(&self.into)).collect(),
            warnings: request.warnings.clone(),
        }
    }

    pub(super) fn plan(&self, plan: &Plan) -> Plan {
        plan.seen_from(&self.into)
    }

    pub(super) fn tissue(&self, request: &TissueRequest) -> TissueRequest {
        TissueRequest {
            settings: request.settings.moved(&self.into),
            cuts: request.cuts.as_ref().map(|cuts| self.cuts(cuts)),
            key: request.key.clone(),
        }
    }

    /// The run; its checkpoint is in the frame already.
    pub(super) fn run(&self, run: &Run) -> Run {
        let attachment = run.settings.attachment.as_ref().map(|rules| rules.moved(&self.into));
        Run {
            case: self.case.clone(),
            cuts: self.cuts(&run.cuts),
            tissue: self.tissue(&run.tissue),
            plan: self.plan(&run.plan),
            settings: RunSettings { attachment, ..run.settings.clone() },
            after: run.after.as_ref().map(|earlier| Box::new(self.earlier(earlier))),
            checkpoint: run.checkpoint.clone(),
        }
    }

    fn earlier(&self, earlier: &Earlier) -> Earlier {
        let after = earlier.after.as_ref().map(|before| Box::new(self.earlier(before)));
        Earlier { plan: self.plan(&earlier.plan), steps: earlier.steps, after }
    }

    pub(super) fn motions(&self, motions: &[(u32, Motion)]) -> Vec<(u32, Motion)> {
        motions.iter().map(|(segment, motion)| (*segment, self.into * motion * self.back)).collect()
    }

    /// The answer with its places in LPS, or why there is none.
    pub(super) fn halt_back<T>(&self, result: Result<T, Halt>) -> Result<T, Halt> {
        result.map_err(|halt| halt.moved(&self.back))
    }

    pub(super) fn warnings_back(&self, warnings: impl IntoIterator<Item = Warning>) -> Vec<Warning> {
        warnings.into_iter().map(|warning| warning.moved(&self.back)).collect()
    }

    /// The cuts of the answer, of which the last ones are the client's `own`, to the last bit.
    pub(super) fn cuts_back(&self, cuts: &[Cut], own: &[Cut]) -> Vec<Cut> {
        let of_templates = cuts.iter().take(cuts.len().saturating_sub(own.len()));
        of_templates.map(|cut| cut.moved(&self.back)).chain(own.iter().cloned()).collect()
    }

    pub(super) fn osteotomy_back(&self, osteotomy: &Osteotomy) -> Osteotomy {
        osteotomy.moved(&self.back)
    }

    pub(super) fn clearances_back(&self, clearances: Vec<Clearance>) -> Vec<Clearance> {
        clearances.into_iter().map(|near| Clearance { place: self.back * near.place, ..near }).collect()
    }

    pub(super) fn paths_back(&self, reports: Vec<PathReport>) -> Vec<PathReport> {
        let back = |report: PathReport| PathReport {
            centroid_displacement_mm: (self.back * Vector::from(report.centroid_displacement_mm)).into(),
            warnings: self.warnings_back(report.warnings),
            ..report
        };
        reports.into_iter().map(back).collect()
    }

    pub(super) fn mesh_back(&self, report: &MeshReport) -> MeshReport {
        MeshReport { warnings: self.warnings_back(report.warnings.clone()), ..report.clone() }
    }

    pub(super) fn regions_back(&self, regions: &[FaceRegion]) -> Vec<FaceRegion> {
        regions.iter().map(|region| region.moved(&self.back)).collect()
    }

    /// A skin of the answer, of which `rest` is the same skin at rest in this frame and `own` that in LPS.
    ///
    /// What has not moved keeps its coordinates to the last bit.
    pub(super) fn skin_back(&self, moved: &TriMesh, rest: &TriMesh, own: &TriMesh) -> TriMesh {
        let places = moved.positions().iter().zip(rest.positions()).zip(own.positions());
        let positions = places.map(|((p, r), o)| o + self.back * (p - r)).collect();
        moved.with_positions(positions).unwrap_or_else(|_| moved.moved(&self.back))
    }

    pub(super) fn outcome_back(&self, outcome: &Outcome) -> Outcome {
        Outcome {
            steps: outcome.steps.iter().map(|report| report.moved(&self.back)).collect(),
            face: self.regions_back(&outcome.face),
            nodes: outcome.nodes.iter().map(|p| self.back * p).collect(),
            warnings: self.warnings_back(outcome.warnings.clone()),
            ..outcome.clone()
        }
    }

    pub(super) fn proposal_back(&self, proposal: &Proposal) -> Proposal {
        proposal.seen_from(&self.back, &Point::origin())
    }

    /// The report with the smallest boxes along the axes of LPS around its doubtful regions.
    pub(super) fn field_back(&self, report: &FieldReport) -> FieldReport {
        let mut back = report.clone();
        back.warnings = self.warnings_back(back.warnings);
        for region in back.regions.iter_mut().flat_map(|kind| &mut kind.largest) {
            region.bounds = region.bounds.moved(&self.back);
        }
        back
    }

    /// The skin at rest in LPS, of which `rest` is that in this frame; vertices of `own`, the patient's skin, keep their coordinates.
    pub(super) fn rest_back(&self, rest: &TriMesh, own: &TriMesh) -> TriMesh {
        let back = rest.positions().iter().map(|p| self.back * p);
        let exact = own.positions().iter().copied().chain(back.skip(own.positions().len()));
        rest.with_positions(exact.collect()).unwrap_or_else(|_| rest.moved(&self.back))
    }
}

/// Passes the progress of a solve on, with its places in LPS.
pub(super) struct WatchBack<'a> {
    pub(super) framed: &'a Framed,
    /// The skin at rest in the frame, and in LPS.
    pub(super) rest: [&'a TriMesh; 2],
    pub(super) watch: &'a mut dyn RunWatch,
}

impl RunWatch for WatchBack<'_> {
    fn stage(&mut self, name: &'static str) {
        self.watch.stage(name);
    }

    fn mesh(&mut self, report: &MeshReport) {
        self.watch.mesh(&self.framed.mesh_back(report));
    }

    fn warning(&mut self, warning: Warning) {
        self.watch.warning(warning.moved(&self.framed.back));
    }

    fn frame(&mut self, frame: Frame, checkpoint: &dyn Fn() -> Option<PathCheckpoint>) {
        let [rest, own] = self.rest;
        let skin = self.framed.skin_back(&frame.skin, rest, own);
        let report = frame.report.moved(&self.framed.back);
        self.watch.frame(Frame { skin, report, ..frame }, checkpoint);
    }
}
