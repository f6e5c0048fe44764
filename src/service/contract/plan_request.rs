use std::collections::BTreeMap;

use nalgebra::{Unit, UnitQuaternion};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use uuid::Uuid;

use super::check::Check;
use super::fault::{Fault, Halt};
use super::landmarks::LandmarksDocument;
use super::motion::motion_from;
use super::osteotomy::OsteotomyDocument;
use super::rotation_request::{RotationRequest, rotation};
use super::tissue::TissueDocument;
use super::transform_request::{TransformFileRequest, matrix_motion};
use prosopon_geometry::{Motion, Point, Vector, Warning};
use prosopon_planning::plan::{CondylarAxis, Path, Plan, PlanError};

/// Largest component of a translation, mm: ten times what an operation moves.
const FARTHEST_MM: f64 = 100.0;

/// A rotation about a hinge axis.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Hinge {
    /// A point on the hinge axis, LPS mm; give it together with `axis`.
    ///
    /// Without both, the axis runs from the landmark `condylion_right` to `condylion_left`, and positive angles open the mouth.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub point_mm: Option<[f64; 3]>,
    /// Direction of the hinge axis, LPS; any length above zero.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub axis: Option<[f64; 3]>,
    /// Right-handed angle about the hinge axis, degrees, -90 to 90.
    #[schema(minimum = -90, maximum = 90)]
    pub angle_deg: f64,
}

/// The segment's motion from rest at path parameter `t`: translation and rotation, a hinge, a matrix, or a transform file.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct WaypointRequest {
    /// Path parameter, 0 to 1; it must increase from waypoint to waypoint, and the last must be 1.
    pub t: f64,
    /// Translation, LPS mm, each component -100 to 100: forward is -y, down is -z. Zero when absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub translation_mm: Option<[f64; 3]>,
    /// Rotation; none when absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rotation: Option<RotationRequest>,
    /// Hinge rotation; excludes `translation_mm` and `rotation`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub hinge: Option<Hinge>,
    /// Motion as a 4 × 4 matrix, `matrix[row][column]`, LPS mm, that maps points of the bone from rest to this position.
    ///
    /// It must turn and shift alone: the last row is 0 0 0 1, and no entry of `RᵀR - 1` exceeds 0.001 (a scale of 1.0005). The
    /// nearest rotation is used, with a note. It excludes the other forms of a motion.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub matrix: Option<[[f64; 4]; 4]>,
    /// Motion as a file of ITK, 3D Slicer or ANTs. It excludes the other forms of a motion.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub transform_file: Option<TransformFileRequest>,
}

/// Autorotation: the mandible rotates about its condyles as the upper jaw moves.
///
/// The lower incisor keeps its height below the upper incisor. Needs the landmarks `condylion_left`, `condylion_right`,
/// `upper_incisor` and `lower_incisor`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Autorotate {
    /// Segment of the upper jaw. The same plan must contain its path, given by waypoints.
    pub follows: u32,
}

/// Path of one segment, given by waypoints, by `autorotate`, or by its end as a matrix or transform file.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PathRequest {
    /// Moving segment, from 1; segment 0 is fixed.
    pub segment: u32,
    /// 1 to 1000 motions from rest at increasing `t`, the last at `t` = 1.
    ///
    /// The service joins them by screw motions.
    #[serde(default)]
    pub waypoints: Vec<WaypointRequest>,
    /// Autorotation instead of waypoints.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub autorotate: Option<Autorotate>,
    /// Position at the end of the path as a 4 × 4 matrix: short for one waypoint at `t` = 1 with this `matrix`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub matrix: Option<[[f64; 4]; 4]>,
    /// Position at the end of the path as a file: short for one waypoint at `t` = 1 with this `transform_file`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub transform_file: Option<TransformFileRequest>,
}

impl PathRequest {
    /// The waypoint at the end that `matrix` or `transform_file` of the path stands for.
    fn end(&self) -> Option<WaypointRequest> {
        let (matrix, transform_file) = (self.matrix, self.transform_file.clone());
        let is_given = matrix.is_some() || transform_file.is_some();
        is_given.then_some(WaypointRequest {
            t: 1.0,
            translation_mm: None,
            rotation: None,
            hinge: None,
            matrix,
            transform_file,
        })
    }
}

/// Request for a plan: the paths of the moving segments.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct CreatePlan {
    /// Id of the osteotomy whose segments move.
    ///
    /// When absent, the plan moves the segments of the session's uploaded tissue mesh: those in its array `attachment` and
    /// those with a bone.
    #[serde(default)]
    pub osteotomy: Option<Uuid>,
    /// A tag of at most 200 characters that the service stores and does not interpret.
    #[serde(default)]
    pub label: Option<String>,
    /// One path per moving segment, at most 32.
    ///
    /// The list may be empty only if the uploaded tissue mesh has loads.
    pub paths: Vec<PathRequest>,
}

/// Segments that a plan can move.
#[derive(Debug, Clone, PartialEq)]
pub struct Segments {
    /// Owner of the segments, for messages.
    owner: &'static str,
    /// Default fixed point of rotations, by segment, LPS mm.
    pivots: BTreeMap<u32, [f64; 3]>,
    /// Whether the pivots lie in the segments, so that their movement is that of the bone.
    has_centroids: bool,
    /// Whether the tissue mesh has loads, so that a plan without paths makes sense.
    loads: bool,
    /// The session's landmarks by name, LPS mm; hinges and autorotation use condyles and incisors.
    landmarks: BTreeMap<String, [f64; 3]>,
}

impl From<&OsteotomyDocument> for Segments {
    fn from(osteotomy: &OsteotomyDocument) -> Self {
        let pivots = osteotomy.segments.iter().map(|s| (s.id, s.centroid_mm)).collect();
        Self { owner: "the osteotomy", pivots, has_centroids: true, loads: false, landmarks: BTreeMap::new() }
    }
}

impl Segments {
    /// Segments of an uploaded tissue mesh: those its points are tied to, and those with a bone.
    ///
    /// They rotate about the origin.
    #[must_use]
    pub fn of_tissue(tissue: &TissueDocument, bones: &[(u32, String)]) -> Self {
        let tied = tissue.tied_nodes.keys().copied();
        let pivots = tied.chain(bones.iter().map(|(segment, _)| *segment)).map(|s| (s, [0.0; 3])).collect();
        let loads = tissue.loaded_nodes > 0;
        Self { owner: "the tissue mesh", pivots, has_centroids: false, loads, landmarks: BTreeMap::new() }
    }
}

impl Segments {
    /// Adds the session's landmarks, for hinges about the condyles.
    #[must_use]
    pub fn with_landmarks(self, landmarks: Option<LandmarksDocument>) -> Self {
        Self { landmarks: landmarks.map(|l| l.points).unwrap_or_default(), ..self }
    }

    /// Landmarks by name; reports a fault at `pointer` that names the missing ones.
    fn points<const N: usize>(&self, check: &mut Check, pointer: &str, names: [&str; N]) -> Option<[Point; N]> {
        let missing: Vec<&str> = names.iter().copied().filter(|n| self.landmark(n).is_none()).collect();
        if !missing.is_empty() {
            check.fault(pointer, format!("needs the landmarks {}; PUT them first", missing.join(", ")));
            return None;
        }
        Some(names.map(|n| self.landmark(n).map_or_else(Point::origin, Point::from)))
    }

    /// A landmark by its name, or by its other name: proposals and landmark files have `incisor_upper` and `incisor_lower`.
    fn landmark(&self, name: &str) -> Option<[f64; 3]> {
        let other = match name {
            "upper_incisor" => "incisor_upper",
            "lower_incisor" => "incisor_lower",
            name => name,
        };
        self.landmarks.get(name).or_else(|| self.landmarks.get(other)).copied()
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

/// A plan that has been checked.
#[derive(Debug, Clone, PartialEq)]
pub struct CheckedPlan {
    /// Tag of the client.
    pub label: Option<String>,
    /// Paths of the segments.
    pub plan: Plan,
    /// How matrices and transform files were read.
    pub notes: Vec<Warning>,
}

impl CreatePlan {
    /// Checks the request and returns the label, the plan and notes on how it was read.
    ///
    /// # Errors
    /// A fault that lists every value that is not allowed.
    pub fn check(self, segments: &Segments) -> Result<CheckedPlan, Fault> {
        let (mut check, mut notes) = (Check::default(), Vec::new());
        let label = check.label("/label", self.label);
        let least = usize::from(!segments.loads);
        if !(least..=32).contains(&self.paths.len()) {
            check.fault("/paths", format!("has {} paths, allowed are {least} to 32", self.paths.len()));
        }
        let mut waypoints = Vec::new();
        for (index, path) in self.paths.iter().enumerate() {
            let pointer = format!("/paths/{index}");
            if self.paths[..index].iter().any(|p| p.segment == path.segment) {
                check.fault(format!("{pointer}/segment"), format!("segment {} already has a path", path.segment));
            }
            waypoints.push(motions(&mut check, &mut notes, &pointer, path, segments));
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
        let plan = Plan { paths: paths.into_iter().map(|(_, path)| path).collect() };
        Ok(CheckedPlan { label, plan, notes })
    }
}

/// The planner's error, with its JSON pointers below the path.
fn below(index: usize, error: PlanError) -> Fault {
    let mut fault = Fault::from(Halt::from(error));
    for field in &mut fault.errors {
        field.pointer = format!("/paths/{index}{}", field.pointer);
    }
    fault
}

fn motions(
    check: &mut Check,
    notes: &mut Vec<Warning>,
    pointer: &str,
    path: &PathRequest,
    segments: &Segments,
) -> Vec<(f64, Motion)> {
    let pivot = segments.pivots.get(&path.segment).copied();
    if path.segment == 0 {
        check.fault(format!("{pointer}/segment"), "names segment 0, the fixed skull; name a moving segment");
    } else if pivot.is_none() {
        let known: Vec<String> = segments.pivots.keys().filter(|s| **s > 0).map(u32::to_string).collect();
        let known = if known.is_empty() { "none that can move".to_owned() } else { known.join(", ") };
        let detail = format!("there is no segment {}; {} has {known}", path.segment, segments.owner);
        check.fault(format!("{pointer}/segment"), detail);
    }
    let place = Place { segment: path.segment, pivot: pivot.unwrap_or_default(), segments };
    let end = path.end();
    if path.autorotate.is_some() {
        if !path.waypoints.is_empty() {
            check.fault(format!("{pointer}/waypoints"), "cannot be combined with autorotate; give one of them");
        }
        if end.is_some() {
            check.fault(format!("{pointer}/autorotate"), "cannot be combined with a matrix or transform_file");
        }
        return Vec::new();
    }
    if let Some(end) = end {
        if !path.waypoints.is_empty() {
            let detail = "cannot be combined with a matrix or transform_file of the path; give that to a waypoint";
            check.fault(format!("{pointer}/waypoints"), detail);
        }
        return vec![(1.0, motion(check, notes, pointer, &end, &place))];
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
                .fault(format!("{pointer}/t"), format!("is {}, but must exceed the previous t = {before}", waypoint.t));
        }
        motions.push((waypoint.t, motion(check, notes, &pointer, waypoint, &place)));
    }
    if let Some((last, _)) = motions.last()
        && *last != 1.0
    {
        let index = motions.len() - 1;
        check.fault(format!("{pointer}/waypoints/{index}/t"), format!("is {last}, but the last t must be 1"));
    }
    motions
}

/// The segment that a motion belongs to.
#[derive(Debug, Clone, Copy)]
struct Place<'a> {
    segment: u32,
    /// Default fixed point of rotations, LPS mm.
    pivot: [f64; 3],
    segments: &'a Segments,
}

/// The motion of a matrix or a transform file.
fn mapped(
    check: &mut Check,
    notes: &mut Vec<Warning>,
    pointer: &str,
    waypoint: &WaypointRequest,
    place: &Place<'_>,
) -> Option<Motion> {
    let has_other = waypoint.translation_mm.is_some() || waypoint.rotation.is_some() || waypoint.hinge.is_some();
    let (name, motion) = match (&waypoint.matrix, &waypoint.transform_file) {
        (None, None) => return None,
        (Some(rows), file) => {
            if has_other || file.is_some() {
                check.fault(format!("{pointer}/matrix"), "cannot be combined with another form of the motion");
            }
            ("matrix", matrix_motion(check, notes, &format!("{pointer}/matrix"), rows, place.segment))
        }
        (None, Some(file)) => {
            if has_other {
                check.fault(format!("{pointer}/transform_file"), "cannot be combined with another form of the motion");
            }
            ("transform_file", file.motion(check, notes, &format!("{pointer}/transform_file"), place.segment))
        }
    };
    let motion = motion.unwrap_or_else(Motion::identity);
    let pivot = Point::from(place.pivot);
    let moved = motion * pivot - pivot;
    if place.segments.has_centroids && moved.amax() > FARTHEST_MM {
        let detail = format!(
            "moves the centroid of segment {} by {:.1}, {:.1}, {:.1} mm, each may be -{FARTHEST_MM} to {FARTHEST_MM}: check \
             that it is in LPS and mm, and which way it maps points",
            place.segment, moved.x, moved.y, moved.z
        );
        check.fault(format!("{pointer}/{name}"), detail);
    }
    Some(motion)
}

fn motion(
    check: &mut Check,
    notes: &mut Vec<Warning>,
    pointer: &str,
    waypoint: &WaypointRequest,
    place: &Place<'_>,
) -> Motion {
    let Place { pivot: centroid, segments, .. } = *place;
    if let Some(mapped) = mapped(check, notes, pointer, waypoint, place) {
        return mapped;
    }
    if let Some(hinge) = &waypoint.hinge {
        if waypoint.translation_mm.is_some() || waypoint.rotation.is_some() {
            check.fault(format!("{pointer}/hinge"), "cannot be combined with translation_mm or rotation");
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
        check.fault(pointer, "must have translation_mm, rotation, hinge, matrix or transform_file");
    }
    let translation = waypoint.translation_mm.unwrap_or_default();
    for (axis, length) in translation.into_iter().enumerate() {
        check.number(&format!("{pointer}/translation_mm/{axis}"), length, -FARTHEST_MM, FARTHEST_MM);
    }
    let (rotation, pivot) = match &waypoint.rotation {
        Some(r) => rotation(check, &format!("{pointer}/rotation"), r, centroid),
        None => (UnitQuaternion::identity(), centroid),
    };
    motion_from(Vector::from(translation), rotation, Point::from(pivot))
}
