//! Where the top and the front of a head are, within its midsagittal plane.

use nalgebra::Matrix2;

use super::super::EvaluateError;
use super::super::consistency::Pose;
use super::motion_into;
use super::symmetry::MirrorPlane;
use super::tuning::{
    BONE_FRONT_MM, CLEAR_WORTH, ENOUGH_LANDMARKS, LAST_ROUNDS, LEVEL_DEG, MOST_IN_FRONT, PITCH_STEP_DEG, SEARCH_ROUNDS,
    SIZES, SKIN_FRONT_MM, SNAP_DEG, UNLIKE_MM,
};
use crate::plan::propose;
use prosopon_geometry::control::Control;
use prosopon_geometry::{Motion, Point, TriMesh, Vector};

/// A pose in which landmarks lie as in a head.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Placed {
    pub(super) from_scan: Motion,
    /// Mean distance of the landmarks from those of the average head, mm.
    pub(super) unlike_mm: f64,
    /// Number of landmarks that were found.
    pub(super) landmarks: usize,
}

impl Placed {
    /// How much it speaks for a pose: the number of landmarks, less their mean distance from those of the average head, mm.
    ///
    /// In the right pose real heads have 20 and more, in wrong ones 7 at most (`ct_head`, `vtk_headsq`).
    pub(super) fn worth(&self) -> f64 {
        self.landmarks as f64 - self.unlike_mm
    }
}

/// Axes within the midsagittal plane that move with the head, and its middle.
struct InPlane {
    middle: Point,
    normal: Vector,
    /// The longer principal axis of the points, and the one across it.
    axes: [Vector; 2],
}

impl InPlane {
    fn of(plane: &MirrorPlane, samples: &[Vec<Point>; 2]) -> Option<Self> {
        let points: Vec<Point> = samples.iter().flatten().map(|p| plane.foot(p)).collect();
        let middle = Point::from(points.iter().map(|p| p.coords).sum::<Vector>() / points.len() as f64);
        let first = plane.normal.cross(&Vector::ith(plane.normal.iamin(), 1.0)).normalize();
        let second = plane.normal.cross(&first);
        let at = |p: &Point| [(p - middle).dot(&first), (p - middle).dot(&second)];
        let spread =
            points.iter().map(at).fold(Matrix2::zeros(), |sum, [u, v]| sum + Matrix2::new(u * u, u * v, u * v, v * v));
        let eigen = nalgebra::SymmetricEigen::new(spread);
        let [u, v] = eigen.eigenvectors.column(eigen.eigenvalues.imax()).into();
        let long = first * u + second * v;
        (long.norm() > 0.5).then(|| Self { middle, normal: plane.normal, axes: [long, plane.normal.cross(&long)] })
    }

    /// The motion into the frame whose top lies at `angle_deg` from the long axis, with the face to one of two sides.
    fn frame(&self, angle_deg: f64, faces_along: bool) -> Motion {
        let (sin, cos) = angle_deg.to_radians().sin_cos();
        let up = self.axes[0] * cos + self.axes[1] * sin;
        let left = if faces_along { self.normal } else { -self.normal };
        motion_into(&self.middle, [left, up.cross(&left), up])
    }

    /// The angle of a frame's top from the long axis, degrees.
    fn angle_deg(&self, from_scan: &Motion) -> f64 {
        let up = from_scan.rotation.inverse() * Vector::z();
        up.dot(&self.axes[1]).atan2(up.dot(&self.axes[0])).to_degrees()
    }
}

/// The pose of the head whose midsagittal plane is `plane`; `None` when no landmarks lie as in a head.
///
/// # Errors
/// [`EvaluateError::Cancelled`].
pub(super) fn placed(
    skin: &TriMesh,
    skull: &TriMesh,
    plane: &MirrorPlane,
    samples: &[Vec<Point>; 2],
    control: &Control,
) -> Result<Option<Placed>, EvaluateError> {
    let Some(within) = InPlane::of(plane, samples) else { return Ok(None) };
    let steps = (360.0 / PITCH_STEP_DEG).round() as u32;
    let all = (0..steps).flat_map(|k| [true, false].map(|side| within.frame(f64::from(k) * PITCH_STEP_DEG, side)));
    let mut starts: Vec<Motion> = all.collect();
    // Most heads lie nearly as the scanner says.
    starts.sort_by(|a, b| a.rotation.angle().total_cmp(&b.rotation.angle()));
    let mut best: Option<Found> = None;
    for start in starts {
        control.check()?;
        let Some(found) = levelled(skin, skull, start, SEARCH_ROUNDS) else { continue };
        if found.is_head()
            && found.is_behind_the_face(samples)
            && best.as_ref().is_none_or(|b| found.worth() > b.worth())
        {
            let is_clear = found.worth() >= CLEAR_WORTH;
            best = Some(found);
            if is_clear {
                break;
            }
        }
    }
    let Some(found) = best else { return Ok(None) };
    let snapped = (within.angle_deg(&found.placed.from_scan) / SNAP_DEG).round() * SNAP_DEG;
    let faces_along = (found.placed.from_scan.rotation * within.normal).x > 0.0;
    let last = levelled(skin, skull, within.frame(snapped, faces_along), LAST_ROUNDS);
    Ok(Some(last.filter(Found::is_head).unwrap_or(found).placed))
}

/// Landmarks in a pose.
struct Found {
    placed: Placed,
    size: f64,
    pitch_deg: f64,
}

impl Found {
    fn worth(&self) -> f64 {
        self.placed.worth()
    }

    /// Whether the landmarks lie as in a head.
    fn is_head(&self) -> bool {
        self.placed.landmarks >= ENOUGH_LANDMARKS
            && self.placed.unlike_mm <= UNLIKE_MM
            && (SIZES[0]..SIZES[1]).contains(&self.size)
            && self.pitch_deg.abs() <= LEVEL_DEG
    }

    /// Whether hardly anything lies farther forward than a nose and a jaw reach before the anterior nasal spine.
    fn is_behind_the_face(&self, [skin, skull]: &[Vec<Point>; 2]) -> bool {
        let before = |points: &[Point], mm: f64| {
            let front = points.iter().filter(|p| (self.placed.from_scan * **p).y < -mm * self.size).count();
            front as f64 <= MOST_IN_FRONT * points.len() as f64
        };
        before(skin, SKIN_FRONT_MM) && before(skull, BONE_FRONT_MM)
    }
}

/// Proposes landmarks in the pose `start`, lays the average head on them, turns the pose to its top about the axis from side to side,
/// and so on.
fn levelled(skin: &TriMesh, skull: &TriMesh, start: Motion, rounds: usize) -> Option<Found> {
    let mut from_scan = start;
    let mut found = None;
    for _ in 0..rounds {
        let proposal = propose(&skin.moved(&from_scan), &skull.moved(&from_scan));
        let points: Vec<(String, Point)> = proposal.points.into_iter().collect();
        let pose = Pose::of(&points)?;
        let up = pose.up();
        let pitch = up.y.atan2(up.z);
        // The midsagittal plane stays where the surfaces have it.
        let place = pose.place(&Point::origin());
        let origin = Point::new(0.0, place.y, place.z);
        let level = Motion::rotation(Vector::x() * pitch);
        from_scan = Motion::from_parts((-(level * origin).coords).into(), level.rotation) * from_scan;
        let unlike_mm = pose.unlike_mm(&points);
        found = Some(Found {
            placed: Placed { from_scan, unlike_mm, landmarks: points.len() },
            size: pose.size,
            pitch_deg: pitch.to_degrees(),
        });
    }
    found
}
