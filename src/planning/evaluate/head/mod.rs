//! The frame of a head: where its left, its back and its top are, however it lay in the scanner.

mod orientation;
mod symmetry;
#[cfg(test)]
mod tests;
mod tuning;

use nalgebra::{Rotation3, UnitQuaternion};

use self::orientation::placed;
use self::symmetry::{MirrorPlane, mirror_planes, polished};
use self::tuning::{CLEAR_SYMMETRY, CLEAR_WORTH, DENSE_SAMPLES, FACE_DEPTH_MM, SAMPLES, SYMMETRIC_SHARE};
use super::EvaluateError;
use super::consistency::spread;
use super::distance::Surface;
use prosopon_geometry::control::Control;
use prosopon_geometry::{Motion, Point, TriMesh, Vector, Warning};

/// Code of the warning about a frame that may be wrong.
const DOUBTFUL: &str = "frame-doubtful";

/// What a frame rests on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FrameBasis {
    /// The mirror plane of skin and skull, and landmarks that were found in the head turned upright.
    Landmarks,
    /// The mirror plane alone; the rest as the scanner has it.
    Symmetry,
    /// Nothing of the head: the axes of the scanner.
    Scanner,
    /// A frame that someone set.
    Given,
}

/// Frame of a head: x to the left, y to the back, z up, perpendicular to the Frankfort horizontal.
///
/// The origin lies in the midsagittal plane at the depth of the anterior nasal spine and the height of the occlusal plane.
#[derive(Debug, Clone, PartialEq)]
pub struct HeadFrame {
    /// Maps LPS of the scan, mm, into the frame.
    pub from_scan: Motion,
    /// What it rests on.
    pub basis: FrameBasis,
    /// Mean distance between the surfaces and their mirror images, over the most symmetric 70 %, mm.
    pub asymmetry_mm: f64,
    /// Mean distance of the landmarks from those of an average head, mm; 0 without landmarks.
    pub unlike_mm: f64,
    /// Number of landmarks that were found.
    pub landmarks: usize,
    /// Doubts.
    pub warnings: Vec<Warning>,
}

impl HeadFrame {
    /// The axes of the scanner.
    #[must_use]
    pub fn of_scanner() -> Self {
        Self {
            from_scan: Motion::identity(),
            basis: FrameBasis::Scanner,
            asymmetry_mm: 0.0,
            unlike_mm: 0.0,
            landmarks: 0,
            warnings: Vec::new(),
        }
    }

    /// Angle between the frame and the axes of the scanner, degrees.
    #[must_use]
    pub fn turned_deg(&self) -> f64 {
        self.from_scan.rotation.angle().to_degrees()
    }

    /// How sure it is, 0 to 1: 1 for a head whose two sides and landmarks agree, below 0.5 where it should be looked at.
    #[must_use]
    pub fn confidence(&self) -> f64 {
        match self.basis {
            FrameBasis::Landmarks if self.warnings.is_empty() => {
                1.0 - 0.5 * (self.unlike_mm / tuning::UNLIKE_MM).min(1.0)
            }
            FrameBasis::Landmarks => 0.4,
            FrameBasis::Symmetry => 0.3,
            FrameBasis::Scanner => 0.0,
            FrameBasis::Given => 1.0,
        }
    }
}

/// Estimates the frame of a head from its surfaces, whatever its pose.
///
/// 1. The midsagittal plane is the one about which skin and skull, mirrored, lie closest to themselves (trimmed iterated closest
///    points from 49 starts). It does not need a jaw, and bears a third of the surface being asymmetric.
/// 2. Within that plane, landmarks are proposed with the head turned by steps of 15°, those near the scanner's axes first, until many
///    lie as in a head; else the best of all counts, with a warning.
/// 3. The plane is fitted anew to the face: its skin and bone down to 70 mm behind the anterior nasal spine.
/// 4. Beside the nearest step on a grid that moves with the head, landmarks are proposed anew in five poses, the average head is laid on
///    them, and the median counts, so that equal heads in different poses get the same frame.
///
/// Without landmarks that lie as in a head, the frame is the scanner's, and a warning says so.
///
/// # Errors
/// [`EvaluateError::Input`] when a surface is not usable, [`EvaluateError::Cancelled`].
pub fn head_frame(skin: &TriMesh, skull: &TriMesh, control: &Control) -> Result<HeadFrame, EvaluateError> {
    let surfaces = [Surface::new(skin)?, Surface::new(skull)?];
    let samples = [spread(skin, SAMPLES), spread(skull, SAMPLES)];
    let sides: Vec<(&Surface, &[Point])> =
        surfaces.iter().zip(&samples).filter(|(_, s)| !s.is_empty()).map(|(s, p)| (s, p.as_slice())).collect();
    let planes = mirror_planes(&sides, control)?;
    let Some(best) = planes.first() else { return Ok(unknown(None)) };
    let size_mm = skull.bounds().diagonal();
    let is_symmetric = best.off_mm < SYMMETRIC_SHARE * size_mm;
    // The second plane only where it is about as good: a face without much of its sides.
    let likely = |plane: &&MirrorPlane| plane.off_mm <= CLEAR_SYMMETRY * best.off_mm || !is_symmetric;
    let likely: Vec<&MirrorPlane> = planes.iter().filter(likely).collect();
    let Some(placed) = placed(skin, skull, &likely, &samples, control)? else {
        return Ok(unknown(Some(best).filter(|_| is_symmetric)));
    };
    // The search ended in a pose that depends on the scanner's axes; this one moves with the head.
    let placed = orientation::placed_near(skin, skull, &placed.plane(), &samples, &placed).unwrap_or(placed);
    // Vault and neck are as symmetric as the face, but not about the same plane: the face decides.
    let face = [skin, skull].map(|mesh| {
        let is_face = |p: &Point| (placed.from_scan * p).y < FACE_DEPTH_MM;
        spread(mesh, DENSE_SAMPLES).into_iter().filter(is_face).collect::<Vec<Point>>()
    });
    let faces: Vec<(&Surface, &[Point])> = surfaces.iter().zip(&face).map(|(s, p)| (s, p.as_slice())).collect();
    let plane = polished(&faces, placed.plane());
    control.check()?;
    let placed = orientation::placed_near(skin, skull, &plane, &samples, &placed).unwrap_or(placed);
    let is_clear = placed.worth() >= CLEAR_WORTH;
    let message = format!(
        "the pose of the head is not certain: only {} landmarks were found that lie as in a head, {:.0} mm off an average one",
        placed.landmarks, placed.unlike_mm
    );
    let doubt = Warning::check(DOUBTFUL, message)
        .act("Look at the frame (`GET …/frame`), and send the right one if it is wrong.");
    Ok(HeadFrame {
        from_scan: placed.from_scan,
        basis: FrameBasis::Landmarks,
        asymmetry_mm: plane.off_mm,
        unlike_mm: placed.unlike_mm,
        landmarks: placed.landmarks,
        warnings: if is_clear { Vec::new() } else { vec![doubt] },
    })
}

/// The frame where no landmarks lie as in a head: the scanner's, with the mirror plane upright in it where that is near.
fn unknown(plane: Option<&MirrorPlane>) -> HeadFrame {
    /// A mirror plane farther from the scanner's midplane may be another one than the midsagittal, degrees.
    const NEAR_DEG: f64 = 25.0;
    let scanner = HeadFrame::of_scanner();
    let near = plane.and_then(|plane| {
        let left = if plane.normal.x < 0.0 { -plane.normal } else { plane.normal };
        let turn = Rotation3::rotation_between(&left, &Vector::x())?;
        (turn.angle().to_degrees() < NEAR_DEG).then(|| {
            let middle = Point::from(left * plane.offset * plane.normal.dot(&left).signum());
            let rotation = UnitQuaternion::from_rotation_matrix(&turn);
            let from_scan = Motion::from_parts((-(rotation * middle.coords)).into(), rotation);
            HeadFrame { from_scan, basis: FrameBasis::Symmetry, asymmetry_mm: plane.off_mm, ..scanner.clone() }
        })
    });
    let message = "the pose of the head was not found: the surfaces show no landmarks that lie as in a head, so the scanner's axes are used";
    let doubt = Warning::check(DOUBTFUL, message)
        .act("Check that the face looks towards -y with the top of the head at +z, or send the frame (`PUT …/frame`).");
    HeadFrame { warnings: vec![doubt], ..near.unwrap_or(scanner) }
}
