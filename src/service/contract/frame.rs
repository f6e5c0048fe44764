use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::check::Check;
use super::fault::Fault;
use super::warning::Findings;
use nalgebra::{Matrix3, Rotation3, UnitQuaternion};
use prosopon_geometry::{Motion, Point, Vector};
use prosopon_planning::evaluate::{FrameBasis, HeadFrame};

/// Largest difference of given axes from unit vectors at right angles.
const AXES_OFF: f64 = 1e-3;

/// The frame of a head that a client sets: its axes in LPS of the scan.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct FrameRequest {
    /// Unit vector to the patient's left.
    pub left: [f64; 3],
    /// Unit vector to the patient's back; the face looks the other way.
    pub back: [f64; 3],
    /// Unit vector to the top of the head.
    pub up: [f64; 3],
    /// A point of the midsagittal plane near the upper incisors, LPS mm.
    pub origin_mm: [f64; 3],
}

impl FrameRequest {
    /// Checks the axes; returns the request with exact ones.
    ///
    /// # Errors
    /// A fault that lists every value that is not allowed.
    pub fn checked(self) -> Result<Self, Fault> {
        let mut check = Check::default();
        check.vector("/origin_mm", self.origin_mm);
        let axes = [self.left, self.back, self.up];
        for (pointer, axis) in ["/left", "/back", "/up"].into_iter().zip(axes) {
            check.vector(pointer, axis);
        }
        let matrix = Matrix3::from_columns(&axes.map(Vector::from));
        let off = (matrix.transpose() * matrix - Matrix3::identity()).abs().max();
        // Written so that a value that is no number is refused too.
        let is_frame = off <= AXES_OFF && matrix.determinant() > 0.0;
        if !is_frame {
            let detail = "left, back and up must be unit vectors at right angles, of which left and back turn to up as x and y to z";
            check.fault("/left", detail);
        }
        check.finish()?;
        let exact = *UnitQuaternion::from_matrix(&matrix).to_rotation_matrix().matrix();
        let [left, back, up] = [0, 1, 2].map(|axis| exact.column(axis).into());
        Ok(Self { left, back, up, ..self })
    }

    /// The motion that maps LPS into the frame, mm.
    #[must_use]
    pub fn motion(&self) -> Motion {
        motion_into([self.left, self.back, self.up], self.origin_mm)
    }
}

/// The motion into the frame with these axes and this origin.
fn motion_into(axes: [[f64; 3]; 3], origin_mm: [f64; 3]) -> Motion {
    let axes = Matrix3::from_columns(&axes.map(Vector::from));
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes.transpose()));
    Motion::from_parts((-(rotation * Vector::from(origin_mm))).into(), rotation)
}

/// What a frame rests on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum FrameBasisName {
    /// The mirror plane of skin and skull, and landmarks that were found in the head turned upright.
    Landmarks,
    /// The mirror plane alone; the pitch is the scanner's.
    Symmetry,
    /// The axes of the scanner, since nothing of the head was found.
    Scanner,
    /// A client set it.
    Given,
}

/// The frame of a head: x to its left, y to its back, z up, perpendicular to the Frankfort horizontal.
///
/// The service computes in it, so that a prediction does not depend on how the head lay in the scanner. Requests and answers stay in LPS of
/// the scan, but where they speak of forward, down and left: these are the frame's.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct FrameDocument {
    /// Unit vector to the patient's left, LPS.
    pub left: [f64; 3],
    /// Unit vector to the patient's back, LPS.
    pub back: [f64; 3],
    /// Unit vector to the top of the head, LPS.
    pub up: [f64; 3],
    /// Origin: in the midsagittal plane, at the depth of the anterior nasal spine and the height of the occlusal plane, LPS mm.
    pub origin_mm: [f64; 3],
    /// How far the head is turned in the scanner, degrees: nodding down, tilted to its left, turned to its left.
    pub pitch_roll_yaw_deg: [f64; 3],
    /// What it rests on.
    pub basis: FrameBasisName,
    /// How sure it is, 0 to 1; below 0.5 it should be looked at.
    pub confidence: f64,
    /// Mean distance between the surfaces and their mirror images over the most symmetric 70 %, mm.
    pub asymmetry_mm: f64,
    /// Number of landmarks that were found.
    pub landmarks: usize,
    /// Mean distance of these from the landmarks of an average head, mm.
    pub unlike_mm: f64,
    /// Warnings and notes.
    #[serde(flatten)]
    pub findings: Findings,
}

impl FrameDocument {
    /// The motion that maps LPS into the frame, mm.
    #[must_use]
    pub fn motion(&self) -> Motion {
        motion_into([self.left, self.back, self.up], self.origin_mm)
    }
}

impl From<&HeadFrame> for FrameDocument {
    fn from(frame: &HeadFrame) -> Self {
        let back = frame.from_scan.inverse();
        let axis = |k: usize| <[f64; 3]>::from(back * Vector::ith(k, 1.0)).map(plain);
        let up = back * Vector::z();
        let to_left = back * Vector::x();
        // A nod about the axis from side to side, then a tilt, then a turn about the body's axis.
        let pitch = up.y.atan2(up.z);
        let roll = to_left.z.clamp(-1.0, 1.0).asin();
        let yaw = to_left.y.atan2(to_left.x);
        Self {
            left: axis(0),
            back: axis(1),
            up: axis(2),
            origin_mm: <[f64; 3]>::from((back * Point::origin()).coords).map(plain),
            pitch_roll_yaw_deg: [-pitch, -roll, yaw].map(|angle| plain(angle.to_degrees())),
            basis: match frame.basis {
                FrameBasis::Landmarks => FrameBasisName::Landmarks,
                FrameBasis::Symmetry => FrameBasisName::Symmetry,
                FrameBasis::Scanner => FrameBasisName::Scanner,
                FrameBasis::Given => FrameBasisName::Given,
            },
            confidence: frame.confidence(),
            asymmetry_mm: frame.asymmetry_mm,
            landmarks: frame.landmarks,
            unlike_mm: frame.unlike_mm,
            findings: frame.warnings.iter().cloned().collect(),
        }
    }
}

/// Without the sign of a zero.
fn plain(value: f64) -> f64 {
    value + 0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn turned() -> FrameRequest {
        // 30° about the axis from side to side: the face looks down.
        let (sin, cos) = 30f64.to_radians().sin_cos();
        FrameRequest {
            left: [1.0, 0.0, 0.0],
            back: [0.0, cos, sin],
            up: [0.0, -sin, cos],
            origin_mm: [3.0, -80.0, 20.0],
        }
    }

    #[test]
    fn a_frame_maps_its_origin_and_its_axes_and_is_described_by_angles() {
        let motion = turned().checked().unwrap().motion();
        assert!((motion * Point::from(turned().origin_mm)).coords.norm() < 1e-12);
        assert!((motion * Vector::from(turned().up) - Vector::z()).norm() < 1e-12);
        let frame = HeadFrame { from_scan: motion, basis: FrameBasis::Given, ..HeadFrame::of_scanner() };
        let document = FrameDocument::from(&frame);
        assert!((Vector::from(document.back) - Vector::from(turned().back)).norm() < 1e-12);
        let [pitch, roll, yaw] = document.pitch_roll_yaw_deg;
        assert!((pitch - 30.0).abs() < 1e-9 && roll.abs() < 1e-9 && yaw.abs() < 1e-9, "{document:?}");
        assert_eq!((document.basis, document.confidence), (FrameBasisName::Given, 1.0));
        assert!((document.motion().to_homogeneous() - motion.to_homogeneous()).abs().max() < 1e-12);
    }

    #[test]
    fn axes_that_are_no_frame_are_refused() {
        let with = |change: &dyn Fn(&mut FrameRequest)| {
            let mut request = turned();
            change(&mut request);
            request.checked().is_err()
        };
        assert!(!with(&|_| ()));
        assert!(with(&|r| r.left = [-1.0, 0.0, 0.0]) && with(&|r| r.up = [0.0, 0.0, 1.0]));
        assert!(with(&|r| r.back = [0.0; 3]) && with(&|r| r.left = [f64::NAN, 0.0, 0.0]));
        assert!(with(&|r| r.origin_mm[1] = f64::INFINITY));
    }
}
