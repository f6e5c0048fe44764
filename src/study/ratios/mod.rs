//! Soft-to-hard ratios of predictions beside those that patients show.

mod picture;
mod published;

use std::collections::BTreeMap;
use std::io::Write;
use std::path::Path;

use super::error::{BenchError, write};
use super::files::refuse_unwritable;
use super::head::{Head, HeadSource};
use super::model_case::{ModelCase, clock};
use super::operations::{Operation, Scene, of_ratios, plan, scene};
use prosopon_geometry::control::Control;
use prosopon_geometry::{Motion, TriMesh, Vector};
use prosopon_planning::evaluate::{Clinical, ClinicalInput, MovedBone, NamedPoint, NoRatio, clinical};
use prosopon_planning::plan::{Proposal, propose};
use prosopon_planning::simulate::{FieldsSettings, LEAVE_OUT_BELOW_MM, Mouth, RunSettings, build_fields, solve};
use published::{PUBLISHED, Published, SOURCES};

/// Solves four operations on several heads and compares the soft-to-hard ratios with published ranges.
#[derive(Debug)]
pub struct RatioStudy<'a> {
    /// The heads.
    pub heads: &'a [HeadSource],
    /// The model: `model:locking:edge`.
    pub case: &'a ModelCase,
    /// Run only operations whose name contains this text.
    pub only: Option<&'a str>,
    /// Whether and where the lips part.
    pub mouth: Mouth,
    /// Time limit of a solve, s.
    pub limit_s: f64,
    /// CSV file to write; the chart has the same name with `.svg`.
    pub csv: &'a Path,
}

/// What is compared with a published range.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Measure {
    /// Soft-to-hard ratio of a soft point.
    Ratio(&'static str),
    /// Movement of a soft point upwards, for each mm that its hard point moves.
    UpPerAdvance(&'static str),
}

impl Measure {
    fn point(self) -> &'static str {
        match self {
            Self::Ratio(point) | Self::UpPerAdvance(point) => point,
        }
    }

    fn name(self) -> String {
        match self {
            Self::Ratio(point) => point.to_owned(),
            Self::UpPerAdvance(point) => format!("{point}, up"),
        }
    }
}

/// A measure of one operation on one head.
#[derive(Debug, Clone, PartialEq)]
struct Row {
    head: String,
    operation: String,
    measure: String,
    hard: &'static str,
    /// The value for the point of skin that was there at rest, or why there is none.
    followed: Result<f64, String>,
    /// The value for the point that is found again on the deformed profile, as studies do on their second picture; `None` where
    /// another point was taken for it.
    again: Option<f64>,
    /// Movement of the soft point forward, down and to the left, mm.
    moved_mm: [f64; 3],
    published: Option<[f64; 2]>,
}

impl Row {
    /// The value that is compared with the published range: of the point found again, or else of the point of skin.
    fn judged(&self) -> Option<f64> {
        self.again.or_else(|| self.followed.as_ref().ok().copied())
    }

    /// Where the value lies relative to the published range.
    fn verdict(&self) -> &'static str {
        match (self.judged(), self.published) {
            (Some(v), Some([low, _])) if v < low => "below",
            (Some(v), Some([_, high])) if v > high => "above",
            (Some(_), Some(_)) => "within",
            (Some(_), None) => "",
            (None, _) => "unknown",
        }
    }
}

impl RatioStudy<'_> {
    /// Runs the study, prints every ratio beside its range and writes rows and chart.
    ///
    /// # Errors
    /// [`BenchError`]; an operation that is refused or fails is a row.
    pub fn run(&self, out: &mut dyn Write) -> Result<(), BenchError> {
        refuse_unwritable(self.csv)?;
        let mut rows: Vec<Row> = Vec::new();
        for source in self.heads {
            let mut head = Head::load(source)?;
            let proposal = propose(&head.anatomy.skin, &head.anatomy.skull);
            proposal.fill(&mut head.landmarks);
            let fields = build_fields(&head.anatomy, &FieldsSettings::default(), &Control::new())?;
            for operation in of_ratios().iter().filter(|o| self.only.is_none_or(|only| o.name.contains(only))) {
                let found = scene(&head, &fields, &operation.templates, &self.mouth, self.case.edge_mm)
                    .and_then(|scene| self.measured(&head, &proposal, &scene, operation));
                let new = match found {
                    Ok(found) => rows_of(&source.name(), operation, &found),
                    Err(why) => vec![failed(&source.name(), operation, why)],
                };
                for row in &new {
                    writeln!(out, "{}", line_of(row))?;
                }
                rows.extend(new);
                write(self.csv, csv(&rows).as_bytes())?;
            }
        }
        if rows.iter().any(|r| r.again.is_some() && r.published.is_some()) {
            write(&self.csv.with_extension("svg"), picture::of_ratios(&rows)?.as_bytes())?;
        }
        summary(&rows, out)
    }

    fn measured(
        &self,
        head: &Head,
        proposal: &Proposal,
        scene: &Scene,
        operation: &Operation,
    ) -> Result<Found, String> {
        let plan = plan(&scene.bone, &operation.moves, &head.landmarks)?;
        let settings = RunSettings {
            solver: self.case.settings(),
            steps: operation.steps,
            attachment: None,
            leave_out_below_mm: LEAVE_OUT_BELOW_MM,
        };
        let control = Control::new().with_clock(clock).with_deadline(clock() + self.limit_s);
        let (anatomy, mut last): (_, Option<TriMesh>) = (&head.anatomy, None);
        solve(anatomy, &scene.tissue, &scene.bone, &plan, &settings, &control, &mut |frame| last = Some(frame.skin))
            .map_err(|error| error.to_string())?;
        let moved = last.ok_or("the solve has no step")?;
        let motions = plan.motions(1.0);
        let motion = |id: u32| motions.iter().find(|(s, _)| *s == id).map_or_else(Motion::identity, |(_, m)| *m);
        let segments = scene.bone.osteotomy.segments.iter();
        let bones: Vec<_> = segments.map(|s| MovedBone { surface: &s.surface, motion: motion(s.id) }).collect();
        let input = ClinicalInput {
            rest: scene.tissue.skin(anatomy),
            moved: &moved,
            given: &anatomy.landmarks,
            proposed: &proposal.points,
            midline_x_mm: head.landmarks.midline_x_mm.unwrap_or(proposal.midline_x_mm),
            bones: &bones,
        };
        let clinical = clinical(&input, &Control::new()).map_err(|error| error.to_string())?;
        Ok(Found { again: found_again(&input, &clinical.soft)?, clinical })
    }
}

/// A point found on a profile is taken for the point of skin within this distance, mm: twice the accuracy of soft landmarks.
const SAME_POINT_MM: f64 = 3.0;

/// What is measured after one operation.
struct Found {
    clinical: Clinical,
    /// Movement of soft points between their places on the two profiles, each found without knowledge of the other.
    again: BTreeMap<&'static str, Vector>,
}

/// Finds the soft points on the profile at rest and once more on the deformed one, as studies do on two pictures.
///
/// Points that lie far from the point of skin `of_skin` on either profile are left out: they are others, such as the nose for
/// the lip on a skin with gaps.
fn found_again(input: &ClinicalInput<'_>, of_skin: &[NamedPoint]) -> Result<BTreeMap<&'static str, Vector>, String> {
    let nothing = BTreeMap::new();
    let places = |skin| {
        let alone = ClinicalInput { rest: skin, moved: skin, given: &[], proposed: &nothing, bones: &[], ..*input };
        clinical(&alone, &Control::new()).map(|found| found.soft).map_err(|error| error.to_string())
    };
    let (before, after) = (places(input.rest)?, places(input.moved)?);
    Ok(movements(of_skin, &before, &after))
}

/// Movement of the points of two profiles that are those of skin.
fn movements(of_skin: &[NamedPoint], before: &[NamedPoint], after: &[NamedPoint]) -> BTreeMap<&'static str, Vector> {
    let moved = |p: &NamedPoint| {
        let named = |points: &[NamedPoint]| points.iter().find(|q| q.name == p.name).map(|q| q.rest);
        let (at_rest, at_end) = (named(before)?, named(after)?);
        let is_same = (at_rest - p.rest).norm() <= SAME_POINT_MM && (at_end - p.moved).norm() <= SAME_POINT_MM;
        is_same.then_some((p.name, at_end - at_rest))
    };
    of_skin.iter().filter_map(moved).collect()
}

/// One row for each ratio that exists, and for each published range.
fn rows_of(head: &str, operation: &Operation, Found { clinical: found, again }: &Found) -> Vec<Row> {
    let ranges: Vec<&Published> = PUBLISHED.iter().filter(|p| operation.name.contains(p.operation)).collect();
    let mut measures: Vec<Measure> = found
        .ratios
        .iter()
        .map(|r| Measure::Ratio(r.soft))
        .filter(|m| ranges.iter().any(|p| p.measure == *m) || value(*m, found).is_ok())
        .collect();
    measures.extend(ranges.iter().map(|p| p.measure).filter(|m| matches!(m, Measure::UpPerAdvance(_))));
    let row = |measure: Measure| {
        let soft = found.soft.iter().find(|p| p.name == measure.point());
        let moved = soft.map(|p| p.movement()).unwrap_or_default();
        let ratio = found.ratios.iter().find(|r| r.soft == measure.point());
        Row {
            head: head.to_owned(),
            operation: operation.name.clone(),
            measure: measure.name(),
            hard: ratio.and_then(|r| r.hard).unwrap_or(""),
            again: again.get(measure.point()).and_then(|moved| share(measure, moved, found).ok()),
            followed: value(measure, found),
            moved_mm: [-moved.y, -moved.z, moved.x],
            published: ranges.iter().find(|p| p.measure == measure).map(|p| p.range),
        }
    };
    measures.into_iter().map(row).collect()
}

fn value(measure: Measure, found: &Clinical) -> Result<f64, String> {
    let soft = found.soft.iter().find(|p| p.name == measure.point()).ok_or("the soft point was not found")?;
    share(measure, &soft.movement(), found)
}

/// The measure of a soft point that moves by `moved`, in proportion to its hard point.
fn share(measure: Measure, moved: &Vector, found: &Clinical) -> Result<f64, String> {
    let ratio = found.ratios.iter().find(|r| r.soft == measure.point()).ok_or("no such point")?;
    match ratio.ratio {
        Err(NoRatio::NoSoftPoint) => return Err("the soft point was not found".to_owned()),
        Err(NoRatio::NoHardPoint) => return Err("the hard point was not found".to_owned()),
        Err(NoRatio::Still(mm)) => return Err(format!("the hard point moves by {mm:.2} mm")),
        Ok(_) => {}
    }
    let hard = found.hard.iter().find(|p| Some(p.name) == ratio.hard).ok_or("the hard point was not found")?;
    let hard = hard.movement();
    Ok(match measure {
        Measure::Ratio(_) => moved.dot(&hard) / hard.norm_squared(),
        Measure::UpPerAdvance(_) => moved.z / hard.norm(),
    })
}

fn failed(head: &str, operation: &Operation, why: String) -> Row {
    Row {
        head: head.to_owned(),
        operation: operation.name.clone(),
        measure: String::new(),
        hard: "",
        followed: Err(why),
        again: None,
        moved_mm: [0.0; 3],
        published: None,
    }
}

fn line_of(r: &Row) -> String {
    let value = match (&r.followed, r.again) {
        (Ok(v), Some(again)) => format!("{again:>6.2} (point of skin {v:.2})"),
        (Ok(v), None) => format!("     – (point of skin {v:.2})"),
        (Err(why), _) => format!("     – ({why})"),
    };
    let range = r.published.map_or(String::new(), |[low, high]| format!("published {low:.2} to {high:.2}"));
    let [forward, down, left] = r.moved_mm;
    format!(
        "{:<14} {:<22} {:<18} {:<14} {value} {range:<24} {:<7} moved {forward:+.2} forward {down:+.2} down {left:+.2} left",
        r.head,
        r.operation,
        r.measure,
        r.hard,
        r.verdict()
    )
}

fn csv(rows: &[Row]) -> String {
    let mut text = String::from(
        "head,operation,measure,hard,ratio,point_of_skin,published_low,published_high,verdict,forward_mm,down_mm,left_mm,detail\n",
    );
    for r in rows {
        let (followed, detail) = match &r.followed {
            Ok(v) => (format!("{v:.4}"), String::new()),
            Err(why) => (String::new(), why.replace('"', "'")),
        };
        let again = r.again.map(|v| format!("{v:.4}")).unwrap_or_default();
        let [low, high] = r.published.map_or([String::new(), String::new()], |ends| ends.map(|v| v.to_string()));
        let [forward, down, left] = r.moved_mm.map(|mm| format!("{mm:.3}"));
        text += &format!(
            "{},\"{}\",\"{}\",{},{again},{followed},{low},{high},{},{forward},{down},{left},\"{detail}\"\n",
            r.head,
            r.operation,
            r.measure,
            r.hard,
            r.verdict()
        );
    }
    text
}

fn summary(rows: &[Row], out: &mut dyn Write) -> Result<(), BenchError> {
    let asked: Vec<&Row> = rows.iter().filter(|r| r.published.is_some() || r.measure.is_empty()).collect();
    let of = |verdict: &str| asked.iter().filter(|r| r.verdict() == verdict).count();
    writeln!(
        out,
        "of {} ratios with a published range {} lie within it, {} below, {} above, {} are unknown",
        asked.len(),
        of("within"),
        of("below"),
        of("above"),
        of("unknown")
    )?;
    writeln!(out, "sources:")?;
    for source in SOURCES {
        writeln!(out, "- {source}")?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use prosopon_geometry::Point;
    use prosopon_planning::evaluate::SoftToHard;

    fn found() -> Found {
        let point = |name, moved: [f64; 3]| NamedPoint {
            name,
            rest: Point::origin(),
            moved: Point::origin() + Vector::from(moved),
            is_given: false,
        };
        let ratio = |soft, ratio| SoftToHard { soft, hard: Some("a_point"), ratio };
        let clinical = Clinical {
            midline_x_mm: 0.0,
            soft: vec![point("pronasale", [0.0, -1.5, 3.0]), point("subnasale", [0.5, -4.2, 0.0])],
            hard: vec![point("a_point", [0.0, -6.0, 0.0])],
            ratios: vec![
                ratio("pronasale", Ok(0.25)),
                ratio("subnasale", Ok(0.7)),
                ratio("labrale_superius", Err(NoRatio::NoSoftPoint)),
                ratio("soft_pogonion", Err(NoRatio::Still(0.1))),
            ],
            profile: Vec::new(),
            nasolabial_deg: None,
            labiomental_deg: None,
            lip_gap_mm: None,
            is_mouth_sealed: true,
            left_out: Vec::new(),
        };
        // The tip that is found again lies where its own point went; the new subnasale lies farther back.
        let again = [("pronasale", [0.0, -1.5, 3.0]), ("subnasale", [0.0, -3.0, 1.0])];
        Found { clinical, again: again.map(|(name, v)| (name, Vector::from(v))).into() }
    }

    #[test]
    fn a_point_found_again_counts_only_near_the_point_of_skin() {
        let point = |name, rest: [f64; 3], moved: [f64; 3]| NamedPoint {
            name,
            rest: Point::from(rest),
            moved: Point::from(moved),
            is_given: false,
        };
        let still = |name, place| point(name, place, place);
        let of_skin = [
            point("pronasale", [0.0; 3], [0.0, -2.0, 0.0]),
            point("subnasale", [0.0; 3], [0.0, -2.0, 0.0]),
            point("labrale_superius", [0.0; 3], [0.0, -2.0, 0.0]),
        ];
        let before = [
            still("pronasale", [0.0, 1.0, 0.0]),
            still("subnasale", [0.0; 3]),
            still("labrale_superius", [0.0, 9.0, 0.0]),
        ];
        let after = [
            still("pronasale", [0.0, -3.0, 0.0]),
            still("subnasale", [0.0, -9.0, 0.0]),
            still("labrale_superius", [0.0; 3]),
        ];
        let found = movements(&of_skin, &before, &after);
        assert_eq!(found, BTreeMap::from([("pronasale", Vector::new(0.0, -4.0, 0.0))]));
    }

    #[test]
    fn each_ratio_is_judged_by_its_published_range() {
        let operations = of_ratios();
        let advance = operations.iter().find(|o| o.name.starts_with("le_fort_1")).unwrap();
        let rows = rows_of("head", advance, &found());
        let verdicts: Vec<(&str, &str)> = rows.iter().map(|r| (r.measure.as_str(), r.verdict())).collect();
        // The chin has no range in this operation and no ratio. The tip rises by half of the advance.
        let expected = [
            ("pronasale", "within"),
            ("subnasale", "within"),
            ("labrale_superius", "unknown"),
            ("pronasale, up", "above"),
        ];
        assert_eq!(verdicts, expected);
        assert_eq!((rows[3].again, rows[3].followed.clone()), (Some(0.5), Ok(0.5)));
        let text = csv(&rows);
        assert!(
            text.contains("head,\"le_fort_1 6 forward\",\"subnasale\",a_point,0.5000,0.7000,0.4,0.6,within,4.200"),
            "{text}"
        );
        let mut out = Vec::new();
        summary(&rows, &mut out).unwrap();
        let out = String::from_utf8(out).unwrap();
        assert!(
            out.starts_with("of 4 ratios with a published range 2 lie within it, 0 below, 1 above, 1 are"),
            "{out}"
        );
        let svg = picture::of_ratios(&rows).unwrap();
        for part in ["<svg", "le_fort_1 6 forward", "subnasale", "</svg>"] {
            assert!(svg.contains(part), "{part}");
        }
        assert!(picture::of_ratios(&[]).is_err());
    }

    #[test]
    fn every_published_range_belongs_to_one_operation() {
        for p in PUBLISHED {
            let names: Vec<String> =
                of_ratios().into_iter().map(|o| o.name).filter(|n| n.contains(p.operation)).collect();
            assert_eq!(names.len(), 1, "{p:?} {names:?}");
            assert!(p.range[0] < p.range[1]);
        }
    }
}
