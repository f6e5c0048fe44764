use std::collections::BTreeMap;

use nalgebra::{Quaternion, Unit, UnitQuaternion};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use uuid::Uuid;

use super::check::Check;
use super::file_faults::FileFaults;
use prosopon_geometry::{Motion, Point, Vector};
use prosopon_planning::plan::{CondylarAxis, Path, Plan, PlanError};
use prosopon_session::{Fault, Halt, LandmarksDocument, OsteotomyDocument, PlanDocument, TissueDocument, motion_from};
use prosopon_store::PlanRecord;

/// A rotation about an axis.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct AxisAngle {
    /// The axis.
    pub axis: [f64; 3],
    /// Right-handed angle, degrees.
    pub angle_deg: f64,
}

/// Angles as surgeons give them. Roll is applied first, then pitch, then yaw; each right-handed.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PitchRollYaw {
    /// About x (to the patient's left): positive brings the front down.
    #[serde(default)]
    pub pitch_deg: f64,
    /// About y (backwards): positive brings the patient's left side down.
    #[serde(default)]
    pub roll_deg: f64,
    /// About z (up): positive brings the front to the patient's left.
    #[serde(default)]
    pub yaw_deg: f64,
}

/// A rotation: exactly one of the three forms.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct RotationRequest {
    /// Quaternion x, y, z, w; brought to unit length.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub quaternion_xyzw: Option<[f64; 4]>,
    /// Axis and angle.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub axis_angle: Option<AxisAngle>,
    /// Pitch, roll and yaw.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pitch_roll_yaw: Option<PitchRollYaw>,
    /// Point that the rotation leaves in place; the segment's centroid when absent, the origin for segments of a tissue mesh.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pivot_mm: Option<[f64; 3]>,
}

/// A turn about a fixed axis.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Hinge {
    /// A point of the axis. Without it and `axis`, the axis runs from the landmark `condylion_right` to `condylion_left`: positive
    /// angles open the mouth.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub point_mm: Option<[f64; 3]>,
    /// Direction of the axis.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub axis: Option<[f64; 3]>,
    /// Right-handed angle, degrees, -90 to 90.
    #[schema(minimum = -90, maximum = 90)]
    pub angle_deg: f64,
}

/// A motion from rest at `t`: translation and rotation, or a hinge.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct WaypointRequest {
    /// Path parameter, 0 to 1.
    pub t: f64,
    /// Translation, LPS mm: forward is -y, down is -z.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub translation_mm: Option<[f64; 3]>,
    /// Rotation.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rotation: Option<RotationRequest>,
    /// A hinge instead.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub hinge: Option<Hinge>,
}

/// The mandible follows the upper jaw about its condyles.
///
/// The lower incisor keeps its height below the upper one. Goes by the landmarks `condylion_left`, `condylion_right`,
/// `upper_incisor` and `lower_incisor`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Autorotate {
    /// The segment of the upper jaw; its path must stand in the same plan, with waypoints.
    pub follows: u32,
}

/// Path of one segment: waypoints, or `autorotate`.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PathRequest {
    /// The segment that moves; not 0.
    pub segment: u32,
    /// Motions from rest at rising t, the last at t = 1; joined by screw motions.
    #[serde(default)]
    pub waypoints: Vec<WaypointRequest>,
    /// Instead of waypoints: autorotation.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub autorotate: Option<Autorotate>,
}

/// Where the bone shall go.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct CreatePlan {
    /// The osteotomy whose segments move; without it they are those of the session's `tissue` (its array `attachment`, and its bones).
    #[serde(default)]
    pub osteotomy: Option<Uuid>,
    /// An opaque tag.
    #[serde(default)]
    pub label: Option<String>,
    /// One path a moving segment; may be empty where loads of a tissue mesh act.
    pub paths: Vec<PathRequest>,
}

/// Segments that a plan may move.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::http) struct Segments {
    /// What they are segments of.
    owner: &'static str,
    /// Points that rotations leave in place where they do not say, by segment.
    pivots: BTreeMap<u32, [f64; 3]>,
    /// Whether loads act, so that nothing has to move.
    loads: bool,
    /// The session's landmarks: condyles and incisors.
    landmarks: BTreeMap<String, [f64; 3]>,
}

impl From<&OsteotomyDocument> for Segments {
    fn from(osteotomy: &OsteotomyDocument) -> Self {
        let pivots = osteotomy.segments.iter().map(|s| (s.id, s.centroid_mm)).collect();
        Self { owner: "the osteotomy", pivots, loads: false, landmarks: BTreeMap::new() }
    }
}

impl Segments {
    /// Those of a ready mesh: what its points are tied to, and the bones. They turn about the origin.
    pub(in crate::http) fn of_tissue(tissue: &TissueDocument, bones: &[(u32, String)]) -> Self {
        let tied = tissue.tied_nodes.keys().copied();
        let pivots = tied.chain(bones.iter().map(|(segment, _)| *segment)).map(|s| (s, [0.0; 3])).collect();
        Self { owner: "the tissue mesh", pivots, loads: tissue.loaded_nodes > 0, landmarks: BTreeMap::new() }
    }
}

impl Segments {
    /// With the session's landmarks, for hinges about the condyles.
    pub(in crate::http) fn with_landmarks(self, landmarks: Option<LandmarksDocument>) -> Self {
        Self { landmarks: landmarks.map(|l| l.points).unwrap_or_default(), ..self }
    }

    /// Landmarks by name; a fault at `pointer` that names those that are missing.
    fn points<const N: usize>(&self, check: &mut Check, pointer: &str, names: [&str; N]) -> Option<[Point; N]> {
        let missing: Vec<&str> = names.iter().copied().filter(|n| !self.landmarks.contains_key(*n)).collect();
        if !missing.is_empty() {
            check.fault(pointer, format!("needs the landmarks {}; PUT them first", missing.join(", ")));
            return None;
        }
        Some(names.map(|n| self.landmarks.get(n).copied().map_or_else(Point::origin, Point::from)))
    }

    fn condyles(&self, check: &mut Check, pointer: &str) -> Option<CondylarAxis> {
        let [left, right] = self.points(check, pointer, ["condylion_left", "condylion_right"])?;
        if (left - right).norm() < 1.0 {
            check.fault(pointer, "the landmarks condylion_left and condylion_right are less than 1 mm apart");
            return None;
        }
        if left.x <= right.x {
            let detail = format!(
                "the landmark condylion_left (x = {} mm) is not to the left (+x) of condylion_right ({} mm): are they swapped?",
                left.x, right.x
            );
            check.fault(pointer, detail);
            return None;
        }
        Some(CondylarAxis { right, left })
    }
}

impl CreatePlan {
    /// Label and checked paths.
    pub(in crate::http) fn check(self, segments: &Segments) -> Result<(Option<String>, Plan), Fault> {
        let mut check = Check::default();
        let label = check.label("/label", self.label);
        let least = usize::from(!segments.loads);
        if !(least..=32).contains(&self.paths.len()) {
            check.fault("/paths", format!("has {} paths, allowed are {least} to 32", self.paths.len()));
        }
        let mut waypoints = Vec::new();
        for (index, path) in self.paths.iter().enumerate() {
            let pointer = format!("/paths/{index}");
            if self.paths[..index].iter().any(|p| p.segment == path.segment) {
                check.fault(format!("{pointer}/segment"), format!("segment {} has a path already", path.segment));
            }
            waypoints.push(motions(&mut check, &pointer, path, segments));
        }
        let mut turns = Vec::new();
        for (index, path) in self.paths.iter().enumerate() {
            let Some(autorotate) = path.autorotate else { continue };
            let pointer = format!("/paths/{index}/autorotate");
            let of = self.paths.iter().position(|p| p.segment == autorotate.follows && p.autorotate.is_none());
            if of.is_none() {
                let detail = format!("the plan has no path with waypoints for segment {}", autorotate.follows);
                check.fault(format!("{pointer}/follows"), detail);
            }
            let axis = segments.condyles(&mut check, &pointer);
            let incisors = segments.points(&mut check, &pointer, ["upper_incisor", "lower_incisor"]);
            if let (Some(of), Some(axis), Some(incisors)) = (of, axis, incisors) {
                turns.push((index, of, axis, incisors));
            }
        }
        check.finish()?;
        let mut paths = Vec::with_capacity(waypoints.len());
        for (index, (request, motions)) in self.paths.iter().zip(waypoints).enumerate() {
            if request.autorotate.is_none() {
                paths.push((index, Path::new(request.segment, motions).map_err(|e| below(index, e))?));
            }
        }
        for (index, of, axis, [upper, lower]) in turns {
            let Some((_, way)) = paths.iter().find(|(i, _)| *i == of) else { continue };
            let followed = axis.follow(self.paths[index].segment, way, &upper, &lower, &Vector::z());
            let followed = followed.map_err(|e| below(index, e))?;
            paths.push((index, followed));
        }
        paths.sort_by_key(|(index, _)| *index);
        Ok((label, Plan { paths: paths.into_iter().map(|(_, path)| path).collect() }))
    }
}

/// The room's own refusal, with its pointer below the path.
fn below(index: usize, error: PlanError) -> Fault {
    let mut fault = Fault::from(Halt::from(error));
    for field in &mut fault.errors {
        field.pointer = format!("/paths/{index}{}", field.pointer);
    }
    fault
}

fn motions(check: &mut Check, pointer: &str, path: &PathRequest, segments: &Segments) -> Vec<(f64, Motion)> {
    let pivot = segments.pivots.get(&path.segment).copied();
    if path.segment == 0 {
        check.fault(format!("{pointer}/segment"), "segment 0 is the skull that stays");
    } else if pivot.is_none() {
        let known: Vec<String> = segments.pivots.keys().filter(|s| **s > 0).map(u32::to_string).collect();
        let known = if known.is_empty() { "none that can move".to_owned() } else { known.join(", ") };
        let detail = format!("there is no segment {}, {} has {known}", path.segment, segments.owner);
        check.fault(format!("{pointer}/segment"), detail);
    }
    let pivot = pivot.unwrap_or_default();
    if path.autorotate.is_some() {
        if !path.waypoints.is_empty() {
            check.fault(format!("{pointer}/waypoints"), "cannot stand beside autorotate");
        }
        return Vec::new();
    }
    if !(1..=1000).contains(&path.waypoints.len()) {
        let detail = format!("has {} waypoints, allowed are 1 to 1000", path.waypoints.len());
        check.fault(format!("{pointer}/waypoints"), detail);
    }
    let mut motions: Vec<(f64, Motion)> = Vec::new();
    for (index, waypoint) in path.waypoints.iter().enumerate() {
        let pointer = format!("{pointer}/waypoints/{index}");
        check.number(&format!("{pointer}/t"), waypoint.t, 0.0, 1.0);
        if let Some((before, _)) = motions.last()
            && waypoint.t <= *before
        {
            check
                .fault(format!("{pointer}/t"), format!("is {}, but must rise: the one before is {before}", waypoint.t));
        }
        motions.push((waypoint.t, motion(check, &pointer, waypoint, pivot, segments)));
    }
    if let Some((last, _)) = motions.last()
        && *last != 1.0
    {
        let index = motions.len() - 1;
        check.fault(format!("{pointer}/waypoints/{index}/t"), format!("is {last}, but the last must be 1"));
    }
    motions
}

fn motion(
    check: &mut Check,
    pointer: &str,
    waypoint: &WaypointRequest,
    centroid: [f64; 3],
    segments: &Segments,
) -> Motion {
    if let Some(hinge) = &waypoint.hinge {
        if waypoint.translation_mm.is_some() || waypoint.rotation.is_some() {
            check.fault(format!("{pointer}/hinge"), "cannot stand beside translation_mm or rotation");
        }
        let angle = check.number(&format!("{pointer}/hinge/angle_deg"), hinge.angle_deg, -90.0, 90.0);
        let (point, axis) = match (hinge.point_mm, hinge.axis) {
            (Some(point), Some(axis)) => {
                let axis = check.direction(&format!("{pointer}/hinge/axis"), axis);
                (check.vector(&format!("{pointer}/hinge/point_mm"), point), axis)
            }
            (None, None) => {
                let condyles = segments.condyles(check, &format!("{pointer}/hinge"));
                let turn = condyles.and_then(|axis| axis.turn(angle.to_radians()).ok());
                return turn.unwrap_or_else(Motion::identity);
            }
            _ => {
                check.fault(format!("{pointer}/hinge"), "must have both point_mm and axis, or neither");
                return Motion::identity();
            }
        };
        let turn = UnitQuaternion::from_axis_angle(&Unit::new_unchecked(axis), angle.to_radians());
        return motion_from(Vector::zeros(), turn, Point::from(point));
    }
    if waypoint.translation_mm.is_none() && waypoint.rotation.is_none() {
        check.fault(pointer, "must have translation_mm, rotation or hinge");
    }
    let translation = waypoint.translation_mm.unwrap_or_default();
    for (axis, length) in translation.into_iter().enumerate() {
        check.number(&format!("{pointer}/translation_mm/{axis}"), length, -100.0, 100.0);
    }
    let (rotation, pivot) = match &waypoint.rotation {
        Some(r) => rotation(check, &format!("{pointer}/rotation"), r, centroid),
        None => (UnitQuaternion::identity(), centroid),
    };
    motion_from(Vector::from(translation), rotation, Point::from(pivot))
}

/// Motion from rest of a segment in a file: rotation about its pivot (the origin when absent), then translation.
///
/// # Errors
/// Values that are not allowed, each with its place.
pub fn segment_motion(
    pointer: &str,
    translation_mm: [f64; 3],
    turn: Option<&RotationRequest>,
) -> Result<Motion, FileFaults> {
    let mut check = Check::default();
    let translation = check.vector(&format!("{pointer}/translation_mm"), translation_mm);
    let (turn, pivot) = match turn {
        Some(turn) => rotation(&mut check, &format!("{pointer}/rotation"), turn, [0.0; 3]),
        None => (UnitQuaternion::identity(), [0.0; 3]),
    };
    FileFaults::finish(check)?;
    Ok(motion_from(Vector::from(translation), turn, Point::from(pivot)))
}

fn rotation(
    check: &mut Check,
    pointer: &str,
    r: &RotationRequest,
    centroid: [f64; 3],
) -> (UnitQuaternion<f64>, [f64; 3]) {
    let pivot = r.pivot_mm.map_or(centroid, |p| check.vector(&format!("{pointer}/pivot_mm"), p));
    let angle = |check: &mut Check, name: &str, deg: f64| {
        check.number(&format!("{pointer}/{name}"), deg, -180.0, 180.0).to_radians()
    };
    let rotation = match (r.quaternion_xyzw, r.axis_angle, r.pitch_roll_yaw) {
        (Some([x, y, z, w]), None, None) => {
            let quaternion = Quaternion::new(w, x, y, z);
            let norm = quaternion.norm();
            check.number(&format!("{pointer}/quaternion_xyzw"), norm, 0.5, 2.0);
            if (0.5..=2.0).contains(&norm) {
                UnitQuaternion::new_normalize(quaternion)
            } else {
                UnitQuaternion::identity()
            }
        }
        (None, Some(a), None) => {
            let axis = check.direction(&format!("{pointer}/axis_angle/axis"), a.axis);
            let angle = angle(check, "axis_angle/angle_deg", a.angle_deg);
            UnitQuaternion::from_axis_angle(&Unit::new_unchecked(axis), angle)
        }
        (None, None, Some(a)) => {
            let pitch = angle(check, "pitch_roll_yaw/pitch_deg", a.pitch_deg);
            let roll = angle(check, "pitch_roll_yaw/roll_deg", a.roll_deg);
            let yaw = angle(check, "pitch_roll_yaw/yaw_deg", a.yaw_deg);
            let about = |axis, angle| UnitQuaternion::from_axis_angle(&axis, angle);
            about(Vector::z_axis(), yaw) * about(Vector::x_axis(), pitch) * about(Vector::y_axis(), roll)
        }
        _ => {
            check.fault(pointer, "must have exactly one of quaternion_xyzw, axis_angle and pitch_roll_yaw");
            UnitQuaternion::identity()
        }
    };
    (rotation, pivot)
}

/// A plan.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PlanView {
    /// Its id.
    pub id: Uuid,
    /// The osteotomy whose segments move; absent when they are those of the tissue mesh.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub osteotomy: Option<Uuid>,
    /// When it was made.
    pub created_at: String,
    /// Paths and what they meet.
    #[serde(flatten)]
    pub content: PlanDocument,
}

impl PlanView {
    pub(in crate::http) fn new(record: &PlanRecord, content: PlanDocument) -> Self {
        Self {
            id: record.id.uuid(),
            osteotomy: record.osteotomy.map(|o| o.uuid()),
            created_at: record.created_at.clone(),
            content,
        }
    }
}

/// All plans of a session, oldest first.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PlanList {
    /// The plans.
    pub plans: Vec<PlanView>,
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Where pitch, roll and yaw of 90° bring the front (0, -1, 0) or the patient's left (1, 0, 0).
    #[test]
    fn angles_turn_the_way_their_docs_say() {
        let turn = |a: PitchRollYaw| {
            let request =
                RotationRequest { quaternion_xyzw: None, axis_angle: None, pitch_roll_yaw: Some(a), pivot_mm: None };
            let mut check = Check::default();
            rotation(&mut check, "", &request, [0.0; 3]).0
        };
        let zero = PitchRollYaw { pitch_deg: 0.0, roll_deg: 0.0, yaw_deg: 0.0 };
        let front = -Vector::y();
        let near = |a: Vector, b: Vector| assert!((a - b).norm() < 1e-12, "{a}");
        near(turn(PitchRollYaw { pitch_deg: 90.0, ..zero }) * front, -Vector::z());
        near(turn(PitchRollYaw { roll_deg: 90.0, ..zero }) * Vector::x(), -Vector::z());
        near(turn(PitchRollYaw { yaw_deg: 90.0, ..zero }) * front, Vector::x());
    }
}
