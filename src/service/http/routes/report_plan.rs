//! The part of the report's page about the bone: named segments with their movements.

use std::collections::BTreeMap;

use nalgebra::{Quaternion, UnitQuaternion};
use serde::Serialize;

use super::report_table::{DOWN, FORWARD, LEFT, moved};
use prosopon_contract::{PathDocument, PathSample, PlanDocument};

/// Words for positive and negative pitch, roll and yaw, as requests define their signs.
const PITCH: [&str; 2] = ["front down", "front up"];
const ROLL: [&str; 2] = ["left side down", "left side up"];
const YAW: [&str; 2] = ["front to the left", "front to the right"];

/// A value with its name.
#[derive(Debug, Serialize)]
pub(super) struct Entry {
    name: &'static str,
    value: String,
}

/// A moving segment.
#[derive(Debug, Serialize)]
pub(super) struct Segment {
    name: String,
    /// The point that moves by `movement`.
    point: &'static str,
    movement: Vec<Entry>,
    turn: Vec<Entry>,
    bone: Vec<Entry>,
}

/// The plan.
#[derive(Debug, Serialize)]
pub(super) struct Plan {
    label: Option<String>,
    segments: Vec<Segment>,
    fixed: Vec<String>,
}

/// The plan with the segments' names; segments without a name have their number.
pub(super) fn plan(plan: &PlanDocument, names: &BTreeMap<u32, String>) -> Plan {
    let moves = |id: u32| plan.paths.iter().any(|p| p.segment == id);
    Plan {
        label: plan.label.clone(),
        segments: plan.paths.iter().map(|path| segment(plan, path, names)).collect(),
        fixed: names.keys().filter(|id| !moves(**id)).map(|id| segment_name(*id, names)).collect(),
    }
}

/// Name of a segment in words: `mandible_distal` is "mandible distal".
pub(super) fn segment_name(id: u32, names: &BTreeMap<u32, String>) -> String {
    match (names.get(&id), id) {
        (Some(name), _) => name.replace('_', " "),
        (None, 0) => "skull".to_owned(),
        (None, _) => format!("segment {id}"),
    }
}

fn segment(plan: &PlanDocument, path: &PathDocument, names: &BTreeMap<u32, String>) -> Segment {
    let report = plan.reports.iter().find(|r| r.segment == path.segment);
    let end = path.waypoints.last();
    let point = if report.is_some() { "its centre" } else { "the point at the origin of coordinates" };
    let [x, y, z] = report.map(|r| r.centroid_displacement_mm).or(end.map(|w| w.translation_mm)).unwrap_or_default();
    let mut bone = Vec::new();
    if let Some(r) = report {
        let most = |of: fn(&PathSample) -> f64| r.along.iter().map(of).fold(0.0, f64::max);
        for (name, value) in [
            ("deepest overlap with other bone", most(|s| s.overlap_mm)),
            ("widest mean gap at the cuts", most(|s| s.gap_mm)),
            ("largest movement of a point", r.max_displacement_mm),
            ("path of its centre", r.path_length_mm),
        ] {
            bone.push(Entry { name, value: format!("{value:.1} mm") });
        }
    }
    Segment {
        name: segment_name(path.segment, names),
        point,
        movement: [("sagittal", -y, FORWARD), ("vertical", -z, DOWN), ("transverse", x, LEFT)]
            .map(|(name, mm, words)| Entry { name, value: moved(mm, " mm", words) })
            .into(),
        turn: turn(end.map_or([0.0, 0.0, 0.0, 1.0], |w| w.quaternion_xyzw)),
        bone,
    }
}

/// Pitch, roll and yaw of a rotation, and its whole angle.
///
/// Inverts `R = Rz(yaw) Rx(pitch) Ry(roll)`, the order of requests: the last row of R is
/// (-cos(pitch) sin(roll), sin(pitch), cos(pitch) cos(roll)), its middle column cos(pitch) (-sin(yaw), cos(yaw)) and sin(pitch).
fn turn([x, y, z, w]: [f64; 4]) -> Vec<Entry> {
    let rotation = UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z));
    let r = rotation.to_rotation_matrix();
    let pitch = r[(2, 1)].clamp(-1.0, 1.0).asin();
    let roll = (-r[(2, 0)]).atan2(r[(2, 2)]);
    let yaw = (-r[(0, 1)]).atan2(r[(1, 1)]);
    let of = |name, angle: f64, words| Entry { name, value: moved(angle.to_degrees(), "°", words) };
    let whole = Entry { name: "whole rotation", value: format!("{:.1}°", rotation.angle().to_degrees()) };
    vec![of("pitch", pitch, PITCH), of("roll", roll, ROLL), of("yaw", yaw, YAW), whole]
}

#[cfg(test)]
mod tests {
    use super::*;
    use prosopon_geometry::Vector;

    #[test]
    fn rotations_come_back_as_the_request_gave_them() {
        let about = |axis, deg: f64| UnitQuaternion::from_axis_angle(&axis, deg.to_radians());
        let q = about(Vector::z_axis(), 3.0) * about(Vector::x_axis(), -2.0) * about(Vector::y_axis(), 1.0);
        let q = q.quaternion();
        let words: Vec<String> = turn([q.i, q.j, q.k, q.w]).into_iter().map(|e| e.value).collect();
        assert_eq!(words[..3], ["2.0° front up", "1.0° left side down", "3.0° front to the left"]);
        assert_eq!(turn([0.0, 0.0, 0.0, 1.0])[0].value, "0.0°");
    }

    #[test]
    fn segments_have_names_in_words() {
        let names = BTreeMap::from([(2, "mandible_distal".to_owned())]);
        assert_eq!(
            [0, 1, 2].map(|id| segment_name(id, &names)),
            ["skull", "segment 1", "mandible distal"].map(str::to_owned)
        );
    }
}
