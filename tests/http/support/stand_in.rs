//! A fast stand-in for the numerics: surfaces are boxes, and the skin moves with the bone.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Condvar, Mutex};
use std::time::Duration;

use prosopon_contract::{Cuts, Fault, FaultKind, Halt, Solid};
use prosopon_field::{CheckedDistance, FieldReport, Region, RegionKind, RegionsOfKind};
use prosopon_formats::import::Limits;
use prosopon_geometry::control::Control;
use prosopon_geometry::{Aabb, Motion, Point, ScalarGrid, TriMesh, Vector, Warning};
use prosopon_planning::evaluate::{
    BeforeAfter, Clinical, ErrorMap, FaceRegion, NamedPoint, NoRatio, ProfilePiece, Registration, SoftToHard,
    Statistics,
};
use prosopon_planning::plan::{
    BoundedPlane, Clearance, Cut, CutShape, Miss, Osteotomy, PathReport, PathSample, Plan, PlanError, Proposal,
    Protected, Segment, Template,
};
use prosopon_planning::simulate::{Attached, Frame, LeftOut, Outcome, RegionMotion, SimulateError};
use prosopon_planning::surface::{CtSettings, CtSurfaces};
use prosopon_session::{Case, Engine, Kept, Numerics, Run, RunWatch, SceneRun, SceneSolved, TissueRequest};
use prosopon_tissue::fem::{SolveSettings, StartState, StepOutcome, StepReport};
use prosopon_tissue::mesh::MeshReport;

use crate::support::shapes::cube;

/// Behaviour that a test sets, and calls that it can check.
#[derive(Debug, Default)]
pub(crate) struct StandIn {
    /// Number of steps that a solve may finish before it waits; `None` for all.
    allowed_steps: Mutex<Option<usize>>,
    changed: Condvar,
    /// Number of started solves.
    pub(crate) solves: AtomicUsize,
    /// Settings of the last solve.
    pub(crate) settings: Mutex<Option<SolveSettings>>,
    /// Cuts for which the mesh of the last solve was built.
    pub(crate) meshed_for: Mutex<Option<Vec<Cut>>>,
    /// Whether the solve panics.
    pub(crate) panics: AtomicBool,
    /// Step after which the solve fails; 0 for never.
    pub(crate) fails_after: AtomicUsize,
    /// Warnings of each step.
    pub(crate) step_warning: Mutex<Option<Warning>>,
    /// Failure of the next call.
    pub(crate) fails_with: Mutex<Option<Halt>>,
    /// Whether a waiting solve sees no cancellation.
    pub(crate) is_deaf: AtomicBool,
    /// Whether cuts miss the bone from now on.
    pub(crate) cuts_miss: AtomicBool,
    /// Size of a result that is kept beyond the process; 0 for none.
    pub(crate) kept_bytes: AtomicUsize,
    /// Number of kept results that were read.
    pub(crate) recalled: AtomicUsize,
}

impl StandIn {
    /// Lets each solve finish `steps` steps and then wait.
    pub(crate) fn hold_after(&self, steps: usize) {
        *self.allowed_steps.lock().unwrap() = Some(steps);
        self.changed.notify_all();
    }

    /// Lets waiting solves continue.
    pub(crate) fn release(&self) {
        *self.allowed_steps.lock().unwrap() = None;
        self.changed.notify_all();
    }

    /// Makes the next call fail.
    pub(crate) fn fails_next(&self, kind: FaultKind, detail: &str) {
        *self.fails_with.lock().unwrap() = Some(Fault::new(kind, detail).into());
    }

    /// Returns the requested failure once.
    fn planted(&self) -> Result<(), Halt> {
        self.fails_with.lock().unwrap().take().map_or(Ok(()), Err)
    }

    fn cut_again(&self) -> Result<(), Halt> {
        self.planted()?;
        if self.cuts_miss.load(Ordering::SeqCst) {
            return Err(SimulateError::Plan(PlanError::MissesBone { missed_by: vec![missed(0, 3.0)] }).into());
        }
        Ok(())
    }

    /// Waits like a Newton iteration until step `k` is allowed or the control is cancelled.
    fn wait_for(&self, k: usize, control: &Control) -> Result<(), Halt> {
        let mut allowed = self.allowed_steps.lock().unwrap();
        while allowed.is_some_and(|steps| k > steps) {
            if !self.is_deaf.load(Ordering::SeqCst) {
                control.check()?;
            }
            allowed = self.changed.wait_timeout(allowed, Duration::from_millis(5)).unwrap().0;
        }
        Ok(control.check()?)
    }
}

fn field_report() -> FieldReport {
    let bounds = Aabb { min: Point::new(1.0, 2.0, 3.0), max: Point::new(4.0, 5.0, 6.0) };
    FieldReport {
        bricks: 8,
        bytes: 4096,
        max_error_mm: 0.05,
        rms_error_mm: 0.01,
        checked_points: 100,
        warnings: Vec::new(),
        regions: vec![RegionsOfKind {
            kind: RegionKind::Inverted,
            count: 3,
            elements: 12,
            area_mm2: 4.5,
            largest: vec![Region { elements: 10, area_mm2: 4.0, bounds }],
        }],
    }
}

fn segment(id: u32, surface: TriMesh, bounded_by: Vec<usize>) -> Segment {
    let centroid = surface.bounds().center();
    Segment { id, name: None, volume_mm3: surface.volume(), area_mm2: surface.area(), centroid, bounded_by, surface }
}

fn statistics(value: f64) -> Statistics {
    Statistics {
        count: 8,
        mean: value,
        mean_abs: value.abs(),
        rms: value.abs(),
        p50: value.abs(),
        p90: value.abs(),
        p95: value.abs(),
        max: value.abs(),
        l2_norm: value.abs() * 8f64.sqrt(),
        variance: 0.0,
        share_below: [1.0; 3],
    }
}

impl Engine for StandIn {
    fn surfaces(&self, ct: &[u8], _: &CtSettings, _: &Control) -> Result<CtSurfaces, Halt> {
        self.planted()?;
        if ct.len() < 100 {
            return Err(Fault::new(FaultKind::VolumeNotUsable, "too short").into());
        }
        Ok(CtSurfaces {
            skin: cube([0.0; 3], 100.0),
            skull: cube([0.0; 3], 60.0),
            air: Some(cube([0.0; 3], 5.0)),
            soft_tissue: ScalarGrid::covering(
                &Aabb { min: Point::new(-1.0, -1.0, -1.0), max: Point::new(1.0, 1.0, 1.0) },
                1.0,
                50.0,
            ),
            warnings: vec![Warning::check("stand-in", "a head-rest was removed")],
        })
    }

    fn has(&self, _: Kept, _: &str) -> bool {
        self.recalled.load(Ordering::SeqCst) > 0
    }

    fn bytes_of(&self, _: Kept, _: &str) -> Option<Vec<u8>> {
        let size = self.kept_bytes.load(Ordering::SeqCst);
        (size > 0).then(|| vec![1; size])
    }

    fn recall(&self, _: Kept, _: &str, bytes: &[u8]) -> bool {
        assert_eq!(bytes.len(), self.kept_bytes.load(Ordering::SeqCst));
        self.recalled.fetch_add(1, Ordering::SeqCst);
        true
    }

    fn fields(&self, case: &Case, control: &Control) -> Result<(FieldReport, FieldReport, Vec<Warning>), Halt> {
        control.report(0.5);
        self.planted()?;
        if case.anatomy.skull.area() > case.anatomy.skin.area() {
            let detail = "the skull lies outside the skin".to_owned();
            return Err(SimulateError::Anatomy { detail }.into());
        }
        Ok((field_report(), field_report(), vec![Warning::check("stand-in", "the skull has crumbs")]))
    }

    fn distances(&self, _: &Case, solid: Solid, points: &[Point], _: &Control) -> Result<Vec<(f64, Vector)>, Halt> {
        let radius = if solid == Solid::Skin { 100.0 } else { 60.0 };
        Ok(points.iter().map(|p| (p.coords.norm() - radius, p.coords.normalize())).collect())
    }

    fn nearest(&self, _: &Case, solid: Solid, points: &[Point], _: &Control) -> Result<Vec<CheckedDistance>, Halt> {
        let radius = if solid == Solid::Skin { 100.0 } else { 60.0 };
        let settled = |p: &Point| {
            let gradient = p.coords.normalize();
            CheckedDistance {
                distance: p.coords.norm() - radius,
                gradient,
                closest: Point::from(gradient * radius),
                triangle: 7,
            }
        };
        Ok(points.iter().map(settled).collect())
    }

    fn place(&self, _: &Case, cuts: &Cuts, _: &Control) -> Result<(Vec<Cut>, Vec<Warning>), Halt> {
        self.planted()?;
        let mut all = Vec::new();
        for call in &cuts.templates {
            let (point, normal) = match call.template {
                Template::LeFort1 => call.landmarks.le_fort_1_plane.unwrap_or((Point::origin(), Vector::z())),
                other @ (Template::LeFort2
                | Template::LeFort3
                | Template::BssoLeft
                | Template::BssoRight
                | Template::Genioplasty
                | Template::TwoPieceMaxilla
                | Template::Mandible) => {
                    let missing = other.needs().iter().copied().filter(|n| !call.landmarks.points.contains_key(*n));
                    let missing = missing.collect();
                    return Err(PlanError::MissingLandmarks { template: other.name(), missing }.into());
                }
            };
            all.push(Cut::from(BoundedPlane { point, normal, bounds: None }));
        }
        all.extend(cuts.cuts.iter().cloned());
        Ok((all, Vec::new()))
    }

    fn cut(&self, case: &Case, cuts: &Cuts, control: &Control) -> Result<(Osteotomy, Vec<Clearance>), Halt> {
        let (all, _) = self.place(case, cuts, control)?;
        for (cut, asked) in all.iter().enumerate() {
            let CutShape::Plane(plane) = &asked.shape else { continue };
            let distance_mm = plane.point.z.abs() - 60.0;
            if distance_mm > 0.0 {
                return Err(PlanError::MissesBone { missed_by: vec![missed(cut, distance_mm)] }.into());
            }
        }
        let segments = vec![
            segment(0, cube([0.0, 0.0, 30.0], 30.0), vec![0]),
            segment(1, cube([0.0, -20.0, -30.0], 20.0), vec![0]),
        ];
        let near =
            |(protected, p): (usize, &Protected)| Clearance { cut: 0, protected, distance_mm: 1.5, place: p.points[0] };
        let clearances = cuts.protected.iter().enumerate().map(near).collect();
        let osteotomy =
            Osteotomy { cuts: all, segments, bone_mm3: 280_000.0, dropped_mm3: 0.0, warnings: Vec::new(), arch: None };
        Ok((osteotomy, clearances))
    }

    fn propose(&self, _: &Case, _: &Control) -> Result<Proposal, Halt> {
        let points = [("ans".to_owned(), Point::new(0.0, -70.0, 20.0))].into_iter().collect();
        Ok(Proposal { points, midline_x_mm: 0.5, ..Proposal::default() })
    }

    fn outline(&self, case: &Case, cuts: &[Cut], plan: &Plan, control: &Control) -> Result<Vec<PathReport>, Halt> {
        let reports = self.follow(case, cuts, plan, control)?.into_iter();
        Ok(reports.map(|report| PathReport { warnings: Vec::new(), along: Vec::new(), ..report }).collect())
    }

    fn follow(&self, _: &Case, _: &[Cut], plan: &Plan, _: &Control) -> Result<Vec<PathReport>, Halt> {
        self.cut_again()?;
        let report = |path: &prosopon_planning::plan::Path| {
            let moved: Vector = path.at(1.0).translation.vector;
            PathReport {
                segment: path.segment(),
                max_displacement_mm: moved.norm(),
                centroid_displacement_mm: moved.into(),
                path_length_mm: moved.norm(),
                warnings: vec![Warning::check("stand-in", "a wide gap")],
                along: [(0.0, 0.0), (1.0, 0.5)]
                    .map(|(t, gap_mm)| PathSample { t, gap_mm, ..PathSample::default() })
                    .to_vec(),
            }
        };
        Ok(plan.paths.iter().map(report).collect())
    }

    fn tissue(&self, _: &Case, request: &TissueRequest, _: &Control) -> Result<MeshReport, Halt> {
        self.cut_again()?;
        Ok(MeshReport {
            cartilage: 0,
            tetrahedra: 60_000,
            prisms: 6_000,
            nodes: 20_000,
            inverted: 0,
            min_dihedral_deg: 12.0,
            max_dihedral_deg: 150.0,
            min_scaled_jacobian: 0.3,
            volume_error: request.settings.mesh.edge_mm * 1e-3,
            max_skin_distance_mm: 0.1,
            nonmanifold_edges: 0,
            muscle_share: 0.4,
            tissue_from_ct: false,
            warnings: vec![Warning::check("stand-in", "thin over the nose")],
        })
    }

    fn solve(&self, run: &Run, control: &Control, watch: &mut dyn RunWatch) -> Result<Outcome, Halt> {
        self.solves.fetch_add(1, Ordering::SeqCst);
        *self.settings.lock().unwrap() = Some(run.settings.solver.clone());
        self.cut_again()?;
        watch.stage("mesh");
        watch.mesh(&self.tissue(&run.case, &run.tissue, control)?);
        *self.meshed_for.lock().unwrap() = run.tissue.cuts.clone();
        watch.stage("solve");
        let skin = &run.case.anatomy.skin;
        let mut steps = Vec::new();
        for k in 1..=run.settings.steps {
            self.wait_for(k, control)?;
            assert!(!self.panics.load(Ordering::SeqCst), "planted");
            let t = k as f64 / run.settings.steps as f64;
            let moved: Vector = run.plan.motions(t)[0].1.translation.vector;
            let report = StepReport {
                outcome: StepOutcome::Converged,
                newton_iterations: 4,
                substeps: 1,
                factorisations: 4,
                relative_residual: 1e-6,
                remaining_mm: 1e-4,
                min_det_f: 0.5,
                max_penetration_mm: 0.01,
                gliding_gap_mm: 0.0,
                pulled_off: 0,
                bone_penetration: None,
                active_contacts: 3,
                reactions_n: vec![(1, [0.0, 1.0, 0.0])],
                unknowns: 60_000,
                phases: prosopon_tissue::fem::PhaseTimes::default(),
                warnings: self.step_warning.lock().unwrap().iter().cloned().collect(),
            };
            let positions = skin.positions().iter().map(|p| p + moved).collect();
            watch.frame(
                Frame {
                    k,
                    t,
                    skin: skin.with_positions(positions).unwrap(),
                    displacement_mm: vec![moved.norm() as f32; skin.positions().len()],
                    report: report.clone(),
                },
                &|| None,
            );
            steps.push(report);
            control.report(t);
            if k == self.fails_after.load(Ordering::SeqCst) {
                let error = prosopon_tissue::fem::SolveError::NotConverged {
                    path_share: t,
                    iterations: 30,
                    residual_n: 0.4,
                    tolerance_n: 0.001,
                };
                return Err(error.into());
            }
        }
        let moved: Vector = run.plan.motions(1.0)[0].1.translation.vector;
        let regions =
            vec![RegionMotion { name: "upper_lip", forward_mm: -moved.y, down_mm: -moved.z, left_mm: moved.x }];
        Ok(Outcome {
            steps,
            regions,
            face: Vec::new(),
            nodes: Vec::new(),
            attachment: Vec::new(),
            end: StartState::default(),
            left_out: LeftOut::default(),
            attached: Attached::default(),
            warnings: vec![Warning::check("stand-in", "a stand-in")],
        })
    }

    /// Uses the real numerics: the scenes of the tests are small.
    fn distance_to_mesh(&self, _: &Run, _: &TriMesh, _: &TissueRequest, _: &Control) -> Result<Option<f64>, Halt> {
        self.planted()?;
        Ok(Some(0.1))
    }

    fn solve_scene(&self, run: &SceneRun, control: &Control, watch: &mut dyn RunWatch) -> Result<SceneSolved, Halt> {
        *self.settings.lock().unwrap() = Some(run.solver.clone());
        Numerics::new(Limits::default()).solve_scene(run, control, watch)
    }

    fn tissue_file(&self, _: &Run, _: &Outcome, _: &Control) -> Result<Vec<u8>, Halt> {
        Ok(b"<VTKFile/>".to_vec())
    }

    /// One soft and one hard point, of which the soft one is given where the case has it.
    fn clinical(&self, run: &Run, moved: &TriMesh, _: &Control) -> Result<Clinical, Halt> {
        if run.case.anatomy.landmarks.iter().any(|(name, _)| name == "nowhere") {
            return Err(Fault::new(FaultKind::Internal, "planted").into());
        }
        let skin = &run.case.anatomy.skin;
        let (rest, moved) = (skin.positions()[0], moved.positions()[0]);
        let bone = run.plan.motions(1.0)[0].1 * rest;
        let is_given = run.case.anatomy.landmarks.iter().any(|(name, _)| name == "subnasale");
        let line = [[-100.0, 30.0], [-100.0, -30.0]];
        Ok(Clinical {
            midline_x_mm: run.case.midline_x_mm.unwrap_or(0.5),
            soft: vec![NamedPoint { name: "subnasale", rest, moved, is_given }],
            hard: vec![NamedPoint { name: "a_point", rest, moved: bone, is_given: false }],
            ratios: vec![
                SoftToHard { soft: "subnasale", hard: Some("a_point"), ratio: Ok(1.0) },
                SoftToHard { soft: "soft_pogonion", hard: Some("pogonion"), ratio: Err(NoRatio::Still(0.2)) },
            ],
            profile: vec![ProfilePiece { before: line.to_vec(), after: line.map(|[y, z]| [y - 6.0, z]).to_vec() }],
            nasolabial_deg: Some(BeforeAfter { before: 100.0, after: 92.5 }),
            labiomental_deg: None,
            lip_gap_mm: Some(BeforeAfter { before: 0.0, after: 0.0 }),
            is_mouth_sealed: true,
            left_out: Vec::new(),
        })
    }

    /// All skin at 0.7 of the first motion.
    fn nearest_bone(
        &self,
        _: &Case,
        _: &[Cut],
        motions: &[(u32, Motion)],
        skin: &TriMesh,
        _: &Control,
    ) -> Result<Option<Vec<Vector>>, Halt> {
        Ok(motions.first().map(|(_, m)| vec![m.translation.vector * 0.7; skin.positions().len()]))
    }

    fn regions(&self, case: &Case, _: &Control) -> Result<(Vec<FaceRegion>, bool), Halt> {
        let region = FaceRegion::new("upper_lip", case.anatomy.skin.bounds());
        Ok((vec![region], !case.anatomy.landmarks.is_empty()))
    }

    /// The mean shift along -y, the forward movement of a box.
    fn error_map(
        &self,
        prediction: &TriMesh,
        reference: &TriMesh,
        _: Option<&[bool]>,
        regions: &[FaceRegion],
        control: &Control,
    ) -> Result<ErrorMap, Halt> {
        control.report(1.0);
        let shift = reference.bounds().center().y - prediction.bounds().center().y;
        Ok(ErrorMap {
            signed_mm: vec![shift as f32; prediction.positions().len()],
            whole: statistics(shift),
            backward: statistics(-shift),
            regions: regions.iter().map(|r| (r.name, statistics(shift))).collect(),
            backward_regions: Vec::new(),
            smoothed: statistics(shift),
            roughness_mm: 0.0,
            correspondence: None,
            warnings: Vec::new(),
            histogram: vec![(-3.0, 0.0), (0.0, 1.0)],
            excluded: 0,
        })
    }

    fn register(
        &self,
        source: &TriMesh,
        target: &TriMesh,
        _: Option<&[bool]>,
        _: &Control,
    ) -> Result<Registration, Halt> {
        let shift = target.bounds().center() - source.bounds().center();
        Ok(Registration {
            motion: Motion::translation(shift.x, shift.y, shift.z),
            iterations: 9,
            vertices: source.positions().len(),
            residual_mm: 0.1,
            median_mm: 0.05,
            overlap: 0.9,
            stiffness: 0.05,
            warnings: vec![Warning::check("stand-in", "hardly fits")],
        })
    }
}

fn missed(cut: usize, distance_mm: f64) -> Miss {
    Miss { cut, label: format!("cut {cut}"), distance_mm }
}
