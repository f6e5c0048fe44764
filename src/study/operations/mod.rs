//! Forty operations on several heads: share of reliable solves and time of each solve.

mod catalogue;
mod picture;

use std::collections::BTreeMap;
use std::io::Write;
use std::path::Path;
use std::time::Instant;

use super::error::{BenchError, write};
use super::files::refuse_unwritable;
use super::head::{Head, HeadSource};
use super::model_case::{ModelCase, PHASES, clock, phases_s};
use super::process;
use catalogue::{Move, Pivot};
pub(super) use catalogue::{Operation, all, named, of_ratios};
use prosopon_geometry::control::Control;
use prosopon_geometry::{Motion, Severity, Warning};
use prosopon_planning::plan::{
    CondylarAxis, Landmarks, Path as SegmentPath, Plan, Segment, Template, TemplateCall, TemplateCuts, name_segments,
};
use prosopon_planning::simulate::{
    CutBone, Fields, FieldsSettings, LEAVE_OUT_BELOW_MM, Mouth, RunSettings, TissueModel, TissueSettings, build_tissue,
    cut_bone, solve,
};
use prosopon_tissue::fem::PhaseTimes;
use prosopon_tissue::mesh::MeshSettings;

/// Goals: least share of reliable solves, longest and median wall time of a solve, s.
const GOALS: (f64, f64, f64) = (0.97, 60.0, 10.0);

/// Solves forty operations on several heads and measures reliability and time.
#[derive(Debug)]
pub struct OperationStudy<'a> {
    /// The heads.
    pub heads: &'a [HeadSource],
    /// The models: `model:locking:edge`.
    pub cases: &'a [ModelCase],
    /// Run only operations whose name contains this text.
    pub only: Option<&'a str>,
    /// Whether and where the lips part.
    pub mouth: Mouth,
    /// Time limit of a solve, s.
    pub limit_s: f64,
    /// CSV file to write; the chart has the same name with `.svg`.
    pub csv: &'a Path,
}

/// Result of an operation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum End {
    /// Finished in a reliable equilibrium.
    Relied,
    /// Refused before the solve, with a named error and a remedy.
    Refused,
    /// Finished, but the solver reports the result as unreliable.
    Doubtful,
    /// The solver did not find an equilibrium.
    Failed,
    /// Not finished within the time limit.
    Overdue,
}

impl End {
    fn name(self) -> &'static str {
        match self {
            Self::Relied => "relied",
            Self::Refused => "refused",
            Self::Doubtful => "doubtful",
            Self::Failed => "failed",
            Self::Overdue => "overdue",
        }
    }
}

/// Result of one operation on one head with one model.
struct Row {
    head: String,
    operation: String,
    case: String,
    end: End,
    detail: String,
    /// Time for the cut, the fields of the segments and the mesh, s; shared by operations with the same cuts.
    prepare_s: f64,
    solve_s: f64,
    /// Time from the start of the solve to each step, s.
    steps_s: Vec<f64>,
    steps: usize,
    newton: usize,
    substeps: usize,
    factorisations: usize,
    unknowns: usize,
    min_det_f: f64,
    penetration_mm: f64,
    deepest_mm: f64,
    phases: PhaseTimes,
    peak_mb: Option<f64>,
    warnings: String,
}

impl Row {
    fn refused(head: &str, operation: &Operation, case: &ModelCase, detail: String) -> Self {
        Self {
            head: head.to_owned(),
            operation: operation.name.clone(),
            case: case.word(),
            end: End::Refused,
            detail,
            prepare_s: 0.0,
            solve_s: 0.0,
            steps_s: Vec::new(),
            steps: 0,
            newton: 0,
            substeps: 0,
            factorisations: 0,
            unknowns: 0,
            min_det_f: 1.0,
            penetration_mm: 0.0,
            deepest_mm: 0.0,
            phases: PhaseTimes::default(),
            peak_mb: None,
            warnings: String::new(),
        }
    }
}

/// The cut bone and the tissue around it.
pub(super) struct Scene {
    pub(super) bone: CutBone,
    pub(super) tissue: TissueModel,
    /// Time of cut and mesh, s.
    pub(super) prepare_s: f64,
}

impl OperationStudy<'_> {
    /// Runs the study, prints a line per operation and writes the rows and the chart; returns whether the goals are met.
    ///
    /// # Errors
    /// [`BenchError`]; a refused operation is a result.
    pub fn run(&self, out: &mut dyn Write) -> Result<bool, BenchError> {
        refuse_unwritable(self.csv)?;
        let mut rows: Vec<Row> = Vec::new();
        for source in self.heads {
            let (head, fields) = Head::with_fields(source)?;
            let mut scenes: BTreeMap<(Vec<Template>, u64), Result<Scene, String>> = BTreeMap::new();
            for operation in all() {
                if self.only.is_some_and(|only| !operation.name.contains(only)) {
                    continue;
                }
                for case in self.cases {
                    let key = (operation.templates.clone(), case.edge_mm.to_bits());
                    // Only one set of cuts is kept: a mesh with its fields takes 100 MB.
                    if !scenes.contains_key(&key) {
                        scenes.clear();
                    }
                    let made = || scene(&head, &fields, &operation.templates, &self.mouth, case.edge_mm);
                    let scene = scenes.entry(key).or_insert_with(made);
                    let row = match scene {
                        Ok(scene) => self.solved(source, &head, scene, &operation, case)?,
                        Err(why) => Row::refused(&source.name(), &operation, case, why.clone()),
                    };
                    writeln!(out, "{}", line_of(&row))?;
                    rows.push(row);
                    write(self.csv, csv(&rows).as_bytes())?;
                }
            }
            write(&self.csv.with_extension("svg"), picture::of_times(&rows)?.as_bytes())?;
        }
        self.summary(&rows, out)
    }

    fn solved(
        &self,
        source: &HeadSource,
        head: &Head,
        scene: &Scene,
        operation: &Operation,
        case: &ModelCase,
    ) -> Result<Row, BenchError> {
        let mut row = Row::refused(&source.name(), operation, case, String::new());
        row.prepare_s = scene.prepare_s;
        let plan = match plan(&scene.bone, &operation.moves, &head.landmarks) {
            Ok(plan) => plan,
            Err(why) => return Ok(Row { detail: why, ..row }),
        };
        process::forget_peak();
        let settings = RunSettings {
            solver: case.settings(),
            steps: operation.steps,
            attachment: None,
            leave_out_below_mm: LEAVE_OUT_BELOW_MM,
        };
        let control = Control::new().with_clock(clock).with_deadline(clock() + self.limit_s);
        let begin = Instant::now();
        let mut reports = Vec::new();
        let outcome = solve(&head.anatomy, &scene.tissue, &scene.bone, &plan, &settings, &control, &mut |frame| {
            row.steps_s.push(begin.elapsed().as_secs_f64());
            reports.push(frame.report);
        });
        row.solve_s = begin.elapsed().as_secs_f64();
        row.peak_mb = process::peak_mb();
        for report in &reports {
            row.phases += report.phases;
            row.newton += report.newton_iterations;
            row.substeps += report.substeps;
            row.factorisations += report.factorisations;
            row.unknowns = report.unknowns;
            row.min_det_f = row.min_det_f.min(report.min_det_f);
            row.penetration_mm = row.penetration_mm.max(report.max_penetration_mm);
            row.deepest_mm = row.deepest_mm.max(report.deepest_mm());
        }
        row.steps = reports.len();
        let of_cuts = scene.bone.osteotomy.warnings.iter();
        let warnings: Vec<&Warning> = of_cuts.chain(reports.iter().flat_map(|r| &r.warnings)).collect();
        row.warnings = warnings.iter().map(ToString::to_string).collect::<Vec<_>>().join(" | ");
        let doubt = reports.iter().rev().find_map(|r| r.outcome.fault());
        let unreliable = warnings.iter().find(|w| w.severity == Severity::Unreliable).map(ToString::to_string);
        (row.end, row.detail) = match outcome {
            Err(_) if control.is_overdue() => {
                (End::Overdue, format!("{:.0} % of the path after {:.0} s", 100.0 * control.progress(), row.solve_s))
            }
            Err(error) => (End::Failed, error.to_string()),
            Ok(_) => match doubt.or(unreliable) {
                Some(fault) => (End::Doubtful, fault),
                None => (End::Relied, String::new()),
            },
        };
        Ok(row)
    }

    fn summary(&self, rows: &[Row], out: &mut dyn Write) -> Result<bool, BenchError> {
        let mut met = true;
        for case in self.cases {
            let own: Vec<&Row> = rows.iter().filter(|r| r.case == case.word()).collect();
            let of = |end: End| own.iter().filter(|r| r.end == end).count();
            let tried = own.len() - of(End::Refused);
            let mut times: Vec<f64> = own.iter().filter(|r| r.end != End::Refused).map(|r| r.solve_s).collect();
            times.sort_by(f64::total_cmp);
            let (Some(slowest), Some(median)) = (times.last().copied(), times.get(times.len() / 2).copied()) else {
                writeln!(out, "{}: every operation was refused", case.word())?;
                met = false;
                continue;
            };
            let share = of(End::Relied) as f64 / tried.max(1) as f64;
            let peak = own.iter().filter_map(|r| r.peak_mb).fold(0.0, f64::max);
            writeln!(
                out,
                "{}: {} operations, {} refused; of {tried} solves {} reliable ({:.1} %), {} unreliable, {} failed, \
                 {} over the time limit; median {median:.1} s, slowest {slowest:.1} s, peak memory {peak:.0} MB",
                case.word(),
                own.len(),
                of(End::Refused),
                of(End::Relied),
                100.0 * share,
                of(End::Doubtful),
                of(End::Failed),
                of(End::Overdue)
            )?;
            met &= share >= GOALS.0 && slowest <= GOALS.1 && median <= GOALS.2;
        }
        Ok(met)
    }
}

/// Cuts the bone and builds a mesh with this edge; the error is the reason in words.
pub(super) fn scene(
    head: &Head,
    fields: &Fields,
    templates: &[Template],
    mouth: &Mouth,
    edge_mm: f64,
) -> Result<Scene, String> {
    let mesh = MeshSettings { edge_mm, ..MeshSettings::default() };
    scene_with(head, fields, templates, &TissueSettings { mesh, mouth: mouth.clone(), ..TissueSettings::default() })
}

/// Cuts the bone and builds the mesh; the error is the reason in words.
pub(super) fn scene_with(
    head: &Head,
    fields: &Fields,
    templates: &[Template],
    tissue: &TissueSettings,
) -> Result<Scene, String> {
    let begin = Instant::now();
    let control = Control::new();
    let call = |t: &Template| TemplateCall { template: *t, landmarks: head.landmarks.clone(), kerf_mm: 0.0 };
    let calls: Vec<TemplateCall> = templates.iter().map(call).collect();
    let (skin, skull) = (&head.anatomy.skin, &head.anatomy.skull);
    let placed = TemplateCuts::place(&calls, skin, skull, &fields.bone)
        .map_err(|fault| format!("{}: {}", templates[fault.index].name(), fault.error))?;
    let settings = FieldsSettings::default();
    let mut bone = cut_bone(&fields.bone, &placed.cuts, &settings.field, &control).map_err(|e| e.to_string())?;
    let mut osteotomy = (*bone.osteotomy).clone();
    name_segments(&mut osteotomy, &head.landmarks);
    bone.osteotomy = osteotomy.into();
    let tissue = build_tissue(&head.anatomy, fields, Some(&bone), tissue, &control).map_err(|e| e.to_string())?;
    Ok(Scene { bone, tissue, prepare_s: begin.elapsed().as_secs_f64() })
}

/// The paths of all segments that the operation moves; the error is the reason in words.
pub(super) fn plan(bone: &CutBone, moves: &[Move], landmarks: &Landmarks) -> Result<Plan, String> {
    let segments = &bone.osteotomy.segments;
    let path = |m: &Move| {
        let named = |s: &&Segment| s.name.as_deref() == Some(m.segment);
        let segment = segments.iter().find(named).ok_or_else(|| {
            let names: Vec<&str> = segments.iter().map(|s| s.name.as_deref().unwrap_or("unnamed")).collect();
            format!("the cuts leave no segment `{}`: there are {}", m.segment, names.join(", "))
        })?;
        let motion = motion(segment, m, landmarks)?;
        SegmentPath::new(segment.id, vec![(1.0, motion)]).map_err(|e| e.to_string())
    };
    Ok(Plan { paths: moves.iter().map(path).collect::<Result<_, String>>()? })
}

fn motion(segment: &Segment, m: &Move, landmarks: &Landmarks) -> Result<Motion, String> {
    let condyle = |side: &str| {
        let name = format!("condylion_{side}");
        landmarks.points.get(&name).copied().ok_or(format!("landmark {name} is neither given nor found: set it"))
    };
    match m.about {
        Pivot::Centre => Ok(m.motion(&segment.centroid)),
        Pivot::Condyle => {
            let side = if m.segment.ends_with("left") { "left" } else { "right" };
            Ok(m.motion(&condyle(side)?))
        }
        Pivot::Hinge => CondylarAxis { right: condyle("right")?, left: condyle("left")? }
            .turn(m.turn.1.to_radians())
            .map_err(|e| e.to_string()),
    }
}

const COLUMNS: &str = "head,operation,case,end,detail,prepare_s,solve_s,steps_s,steps,newton,substeps,factorisations,unknowns,min_det_f,penetration_mm,deepest_mm,peak_mb";

fn csv(rows: &[Row]) -> String {
    let quoted = |text: &str| format!("\"{}\"", text.replace('"', "'"));
    let mut text = format!("{COLUMNS},{},warnings\n", PHASES.join(","));
    for r in rows {
        text += &format!(
            "{},{},{},{},{},{:.2},{:.2},{},{},{},{},{},{},{:.4},{:.4},{:.3},{},{},{}\n",
            r.head,
            quoted(&r.operation),
            r.case,
            r.end.name(),
            quoted(&r.detail),
            r.prepare_s,
            r.solve_s,
            r.steps_s.iter().map(|s| format!("{s:.1}")).collect::<Vec<_>>().join(";"),
            r.steps,
            r.newton,
            r.substeps,
            r.factorisations,
            r.unknowns,
            r.min_det_f,
            r.penetration_mm,
            r.deepest_mm,
            r.peak_mb.map_or(String::new(), |mb| format!("{mb:.0}")),
            phases_s(&r.phases).map(|s| format!("{s:.2}")).join(","),
            quoted(&r.warnings),
        );
    }
    text
}

fn line_of(r: &Row) -> String {
    format!(
        "{:<12} {:<30} {:<18} {:<8} {:>6.1} s ({} steps, {} substeps, {} iterations, contact {:.0} %) {}",
        r.head,
        r.operation,
        r.case,
        r.end.name(),
        r.solve_s,
        r.steps,
        r.substeps,
        r.newton,
        100.0 * r.phases.contact_s / r.phases.total_s().max(f64::MIN_POSITIVE),
        r.detail
    )
}
