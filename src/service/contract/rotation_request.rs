use nalgebra::{Quaternion, Unit, UnitQuaternion};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::check::Check;
use super::file_faults::FileFaults;
use super::motion::motion_from;
use prosopon_geometry::{Motion, Point, Vector};

/// A rotation given by axis and angle.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct AxisAngle {
    /// Direction of the rotation axis, LPS; any length above zero.
    pub axis: [f64; 3],
    /// Right-handed angle about the axis, degrees, -180 to 180.
    pub angle_deg: f64,
}

/// A rotation given by pitch, roll and yaw, as surgeons give them.
///
/// Roll is applied first, then pitch, then yaw. Each angle is right-handed, in degrees, -180 to 180, and 0 when absent.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PitchRollYaw {
    /// Rotation about x (to the patient's left), degrees; a positive angle moves the front down.
    #[serde(default)]
    pub pitch_deg: f64,
    /// Rotation about y (to the back), degrees; a positive angle moves the patient's left side down.
    #[serde(default)]
    pub roll_deg: f64,
    /// Rotation about z (up), degrees; a positive angle moves the front to the patient's left.
    #[serde(default)]
    pub yaw_deg: f64,
}

/// A rotation in exactly one of the forms `quaternion_xyzw`, `axis_angle` and `pitch_roll_yaw`.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct RotationRequest {
    /// Quaternion x, y, z, w with a length of 0.5 to 2; the service normalises it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub quaternion_xyzw: Option<[f64; 4]>,
    /// Axis and angle of the rotation.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub axis_angle: Option<AxisAngle>,
    /// Pitch, roll and yaw of the rotation.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pitch_roll_yaw: Option<PitchRollYaw>,
    /// Fixed point of the rotation, LPS mm.
    ///
    /// When absent: the segment's centroid, or the origin for segments of an uploaded tissue mesh.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pivot_mm: Option<[f64; 3]>,
}

/// Motion of a segment from rest: rotation about its pivot, then translation, mm.
///
/// The pivot is the origin when the rotation names none. `pointer` is the JSON pointer of the segment in its file.
///
/// # Errors
/// [`FileFaults`] with every value that is not allowed and its JSON pointer.
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

/// The rotation of a request and its fixed point, which is `centroid` when it names none.
pub(super) fn rotation(
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Pitch, roll and yaw of 90° applied to the front (0, -1, 0) or the patient's left (1, 0, 0).
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
