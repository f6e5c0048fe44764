//! The operations of `prosopon bench operations`: templates of the cuts and motions of the segments.

use crate::BenchError;
use prosopon_geometry::{Motion, Point, Vector};
use prosopon_planning::plan::Template;

/// An operation that can be applied to any head.
pub(crate) struct Operation {
    pub(crate) name: String,
    pub(crate) templates: Vec<Template>,
    pub(crate) moves: Vec<Move>,
    /// Streamed steps.
    pub(crate) steps: usize,
}

/// Motion of one segment.
#[derive(Clone)]
pub(crate) struct Move {
    /// Suggested name of the segment.
    pub(crate) segment: &'static str,
    /// Translation to the patient's left, back and up (LPS), mm.
    pub(crate) shift_mm: [f64; 3],
    /// Rotation axis and angle, degrees.
    pub(crate) turn: (Vector, f64),
    pub(crate) about: Pivot,
}

/// Pivot of a segment's rotation.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Pivot {
    /// Centre of mass of the segment.
    Centre,
    /// Condyle on the side of the segment.
    Condyle,
    /// Axis through both condyles, which replaces the axis of the rotation.
    Hinge,
}

impl Move {
    fn shift(segment: &'static str, shift_mm: [f64; 3]) -> Self {
        Self { segment, shift_mm, turn: (Vector::x(), 0.0), about: Pivot::Centre }
    }

    fn turned(self, axis: [f64; 3], degrees: f64) -> Self {
        Self { turn: (Vector::from(axis), degrees), ..self }
    }

    fn about_condyle(segment: &'static str, axis: [f64; 3], degrees: f64) -> Self {
        Self { about: Pivot::Condyle, ..Self::shift(segment, [0.0; 3]) }.turned(axis, degrees)
    }

    /// The motion from rest: a rotation about `pivot`, then the translation.
    pub(super) fn motion(&self, pivot: &Point) -> Motion {
        let (axis, degrees) = self.turn;
        let turn = nalgebra::UnitQuaternion::new(axis.normalize() * degrees.to_radians());
        let shift = pivot - turn * pivot + Vector::from(self.shift_mm);
        Motion::from_parts(shift.into(), turn)
    }
}

const MAXILLA: &str = "maxilla";
const DISTAL: &str = "mandible_distal";
const RAMUS: [&str; 2] = ["mandible_proximal_left", "mandible_proximal_right"];
/// Axes about which the left and right ramus turn upward and inward about their condyles, to meet the moved jaw.
const RAMUS_AXES: [[f64; 3]; 2] = [[1.0, 0.0, 0.7], [1.0, 0.0, -0.7]];
/// Default number of streamed steps.
const STEPS: usize = 6;
const BSSO: [Template; 2] = [Template::BssoLeft, Template::BssoRight];
const BOTH_JAWS: [Template; 3] = [Template::LeFort1, Template::BssoLeft, Template::BssoRight];

/// All forty operations.
pub(crate) fn all() -> Vec<Operation> {
    let mut all = upper_jaw();
    all.extend(chin());
    all.extend(lower_jaw());
    all.extend(both_jaws());
    all.extend(midface());
    all
}

/// The operations with these names, or the usual ones when there is no name.
///
/// # Errors
/// [`BenchError::Head`] for a name that no operation has.
pub(crate) fn named(names: &[String], usual: &[&str]) -> Result<Vec<Operation>, BenchError> {
    let all = all();
    if let Some(unknown) = names.iter().find(|name| all.iter().all(|o| o.name != **name)) {
        let known: Vec<&str> = all.iter().map(|o| o.name.as_str()).collect();
        let detail = format!("there is no operation `{unknown}`: give some of {}", known.join("; "));
        return Err(BenchError::Head { detail });
    }
    let is_meant = |o: &Operation| match names {
        [] => usual.contains(&o.name.as_str()),
        named => named.contains(&o.name),
    };
    Ok(all.into_iter().filter(is_meant).collect())
}

/// The operations of `prosopon bench ratios`: those for which soft-to-hard ratios are published.
pub(crate) fn of_ratios() -> Vec<Operation> {
    let shift = |segment, forward: f64| vec![Move::shift(segment, [0.0, -forward, 0.0])];
    vec![
        operation("le_fort_1 6 forward", &[Template::LeFort1], shift(MAXILLA, 6.0)),
        operation("bsso set-back 5", &BSSO, shift(DISTAL, -5.0)),
        operation("bsso advance 5", &BSSO, shift(DISTAL, 5.0)),
        operation("genioplasty 5 forward", &[Template::Genioplasty], shift("chin", 5.0)),
        jaws_apart(),
    ]
}

/// The upper jaw forward and the lower one back: lips that are joined draw each other along.
fn jaws_apart() -> Operation {
    let moves = vec![Move::shift(MAXILLA, [0.0, -5.0, 0.0]), Move::shift(DISTAL, [0.0, 5.0, 0.0])];
    operation("bimaxillary 5 and -5", &BOTH_JAWS, moves)
}

fn operation(name: &str, templates: &[Template], moves: Vec<Move>) -> Operation {
    Operation { name: name.to_owned(), templates: templates.to_vec(), moves, steps: STEPS }
}

fn upper_jaw() -> Vec<Operation> {
    let one = |name: &str, m: Move| operation(&format!("le_fort_1 {name}"), &[Template::LeFort1], vec![m]);
    let shift = |mm: [f64; 3]| Move::shift(MAXILLA, mm);
    let widened = vec![Move::shift("maxilla_left", [2.5, -2.0, 0.0]), Move::shift("maxilla_right", [-2.5, -2.0, 0.0])];
    let far = Operation { steps: 12, ..one("12 forward", shift([0.0, -12.0, 0.0])) };
    vec![
        one("3 forward", shift([0.0, -3.0, 0.0])),
        one("6 forward", shift([0.0, -6.0, 0.0])),
        one("9 forward", shift([0.0, -9.0, 0.0])),
        far,
        one("6 forward 2 down", shift([0.0, -6.0, -2.0])),
        one("3 up", shift([0.0, 0.0, 3.0])),
        one("5 up", shift([0.0, 0.0, 5.0])),
        one("5 forward 3 up", shift([0.0, -5.0, 3.0])),
        one("4 down", shift([0.0, 0.0, -4.0])),
        one("3 back", shift([0.0, 3.0, 0.0])),
        one("3 left", shift([3.0, 0.0, 0.0])),
        one("yaw 4", shift([0.0, -2.0, 0.0]).turned([0.0, 0.0, 1.0], 4.0)),
        one("roll 4", shift([0.0, -2.0, 0.0]).turned([0.0, 1.0, 0.0], 4.0)),
        one("pitch 5", shift([0.0, -3.0, 0.0]).turned([1.0, 0.0, 0.0], 5.0)),
        operation("two_piece 5 wider", &[Template::TwoPieceMaxilla], widened),
    ]
}

fn chin() -> Vec<Operation> {
    let one = |name: &str, mm: [f64; 3]| {
        operation(&format!("genioplasty {name}"), &[Template::Genioplasty], vec![Move::shift("chin", mm)])
    };
    vec![
        one("6 forward", [0.0, -6.0, 0.0]),
        one("10 forward", [0.0, -10.0, 0.0]),
        one("4 back", [0.0, 4.0, 0.0]),
        one("4 down", [0.0, -1.0, -4.0]),
        one("4 left", [4.0, 0.0, 0.0]),
    ]
}

fn lower_jaw() -> Vec<Operation> {
    let one = |name: &str, moves: Vec<Move>| operation(&format!("bsso {name}"), &BSSO, moves);
    let shift = |mm: [f64; 3]| Move::shift(DISTAL, mm);
    let with_rami = |distal: Move, degrees: [f64; 2]| {
        let rami = [0, 1].map(|i| Move::about_condyle(RAMUS[i], RAMUS_AXES[i], degrees[i]));
        std::iter::once(distal).chain(rami).collect::<Vec<Move>>()
    };
    let hinge = Move { about: Pivot::Hinge, ..Move::shift("mandible", [0.0; 3]).turned([1.0, 0.0, 0.0], 5.0) };
    vec![
        one("4 forward", vec![shift([0.0, -4.0, 0.0])]),
        one("7 forward", vec![shift([0.0, -7.0, 0.0])]),
        one("4 back", vec![shift([0.0, 4.0, 0.0])]),
        one("7 back", vec![shift([0.0, 7.0, 0.0])]),
        one("pitch 5", vec![shift([0.0, -3.0, 1.0]).turned([1.0, 0.0, 0.0], -5.0)]),
        one("3 left yaw 4", vec![shift([3.0, -1.0, 0.0]).turned([0.0, 0.0, 1.0], 4.0)]),
        one("7 forward, rami 3", with_rami(shift([0.0, -7.0, 0.0]), [3.0, 3.0])),
        one("5 back, rami 4 and 2", with_rami(shift([0.5, 5.0, 1.0]), [4.0, 2.0])),
        operation("mandible opened 5", &[Template::Mandible], vec![hinge]),
    ]
}

/// Operations on both jaws.
///
/// Three have the motions of real patients (maxilla, distal mandible and both rami), each with and without the rami.
fn both_jaws() -> Vec<Operation> {
    let turn_axis = [0.8, 0.2, 0.5];
    let real = [
        ("a", ([-0.1, -2.4, 0.7], 1.9), ([-3.9, 4.3, 3.4], 3.4), [8.2, 2.1]),
        ("b", ([0.5, -4.1, 1.4], 3.5), ([0.0, 4.1, 7.5], 1.3), [3.7, 7.7]),
        ("c", ([0.8, -1.1, 0.5], 1.9), ([2.8, 4.7, 2.7], 2.3), [3.3, 4.8]),
    ];
    let mut all = vec![
        jaws_apart(),
        operation(
            "bimaxillary 4 up, 6 forward",
            &BOTH_JAWS,
            vec![Move::shift(MAXILLA, [0.0, -3.0, 4.0]), Move::shift(DISTAL, [0.0, -6.0, 4.0])],
        ),
        operation(
            "bimaxillary 4 and -3, chin 4",
            &[Template::LeFort1, Template::BssoLeft, Template::BssoRight, Template::Genioplasty],
            vec![
                Move::shift(MAXILLA, [0.0, -4.0, 0.0]),
                Move::shift(DISTAL, [0.0, 3.0, 0.0]),
                Move::shift("chin", [0.0, -1.0, 0.0]),
            ],
        ),
    ];
    for (patient, upper, lower, rami) in real {
        let jaws = vec![
            Move::shift(MAXILLA, upper.0).turned(turn_axis, upper.1),
            Move::shift(DISTAL, lower.0).turned(turn_axis, lower.1),
        ];
        let turned = [0, 1].map(|i| Move::about_condyle(RAMUS[i], RAMUS_AXES[i], rami[i]));
        let with_rami = jaws.iter().cloned().chain(turned).collect();
        all.push(operation(&format!("patient {patient}"), &BOTH_JAWS, jaws));
        all.push(operation(&format!("patient {patient}, rami"), &BOTH_JAWS, with_rami));
    }
    all
}

fn midface() -> Vec<Operation> {
    let one = |name: &str, template: Template, forward: f64, steps: usize| {
        let moves = vec![Move::shift("midface", [0.0, -forward, 0.0])];
        Operation { steps, ..operation(name, &[template], moves) }
    };
    vec![
        one("le_fort_2 8 forward", Template::LeFort2, 8.0, 8),
        one("le_fort_3 15 forward", Template::LeFort3, 15.0, 15),
    ]
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn there_are_forty_operations_with_names_of_their_own() {
        let all = all();
        let names: BTreeSet<&str> = all.iter().map(|o| o.name.as_str()).collect();
        assert_eq!((all.len(), names.len()), (40, 40));
    }

    #[test]
    fn a_move_turns_about_its_pivot_and_then_shifts() {
        let pivot = Point::new(40.0, 8.0, 30.0);
        let m = Move::shift(MAXILLA, [1.0, -2.0, 3.0]).turned([0.0, 0.0, 2.0], 90.0).motion(&pivot);
        assert!((m * pivot - (pivot + Vector::new(1.0, -2.0, 3.0))).norm() < 1e-12);
        let beside = m * (pivot + Vector::x());
        assert!((beside - (pivot + Vector::new(1.0, -1.0, 3.0))).norm() < 1e-12);
    }
}
