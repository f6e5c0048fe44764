//! Where the top and the front of a head are, within its midsagittal plane.

use nalgebra::{Matrix2, Matrix3, Rotation3, UnitQuaternion};
use rayon::prelude::*;

use super::symmetry::MirrorPlane;
use super::tuning::{
    BONE_FRONT_MM, CLEAR_WORTH, ENOUGH_LANDMARKS, LEVEL_DEG, MOST_IN_FRONT, PITCH_STEP_DEG, SEARCH_ROUNDS, SIZES,
    SKIN_FRONT_MM, SNAP_DEG, UNLIKE_MM, VARIED, VARIED_DEG,
};
use crate::evaluate::EvaluateError;
use crate::evaluate::consistency::Pose;
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
    /// Its midsagittal plane.
    pub(super) fn plane(&self) -> MirrorPlane {
        let back = self.from_scan.inverse();
        let normal = back * Vector::x();
        MirrorPlane { normal, offset: normal.dot(&(back * Point::origin()).coords), off_mm: f64::INFINITY }
    }

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

/// The pose of the head whose midsagittal plane is one of `planes`; `None` when no landmarks lie as in a head.
///
/// # Errors
/// [`EvaluateError::Cancelled`].
pub(super) fn placed(
    skin: &TriMesh,
    skull: &TriMesh,
    planes: &[&MirrorPlane],
    samples: &[Vec<Point>; 2],
    control: &Control,
) -> Result<Option<Placed>, EvaluateError> {
    let steps = (360.0 / PITCH_STEP_DEG).round() as u32;
    let angles = (0..steps).map(|k| f64::from(k) * PITCH_STEP_DEG);
    let poses: Vec<(f64, bool)> = angles.flat_map(|angle| [(angle, true), (angle, false)]).collect();
    let within = planes.iter().filter_map(|plane| InPlane::of(plane, samples));
    let mut starts: Vec<Motion> = within
        .flat_map(|w| poses.iter().map(move |(angle, side)| w.frame(*angle, *side)).collect::<Vec<_>>())
        .collect();
    // Most heads lie nearly as the scanner says.
    starts.sort_by(|a, b| a.rotation.angle().total_cmp(&b.rotation.angle()));
    let mut best: Option<Found> = None;
    for start in starts {
        control.check()?;
        let Some(found) = levelled(skin, skull, start, SEARCH_ROUNDS) else { continue };
        let is_better = best.as_ref().is_none_or(|b| found.placed.worth() > b.placed.worth());
        if is_better && found.is_head() && found.is_behind_the_face(samples) {
            let is_clear = found.placed.worth() >= CLEAR_WORTH;
            best = Some(found);
            if is_clear {
                break;
            }
        }
    }
    Ok(best.map(|found| found.placed))
}

/// The pose of a head whose midsagittal plane is `plane` and whose pose is nearly `known`.
///
/// Single proposals jump when the head is turned by a fraction of a degree. So landmarks are proposed in several poses beside the nearest
/// pitch on a grid that moves with the head, and the median counts.
pub(super) fn placed_near(
    skin: &TriMesh,
    skull: &TriMesh,
    plane: &MirrorPlane,
    samples: &[Vec<Point>; 2],
    known: &Placed,
) -> Option<Placed> {
    let within = InPlane::of(plane, samples)?;
    let snapped = (within.angle_deg(&known.from_scan) / SNAP_DEG).round() * SNAP_DEG;
    let faces_along = (known.from_scan.rotation * within.normal).x > 0.0;
    let half = VARIED / 2;
    let varied: Vec<f64> = (0..VARIED).map(|k| VARIED_DEG * (k as f64 - half as f64)).collect();
    let found: Vec<Found> = varied
        .into_par_iter()
        .filter_map(|by| levelled(skin, skull, within.frame(snapped + by, faces_along), 1))
        .filter(Found::is_like_a_head)
        .collect();
    if found.len() <= half {
        return None;
    }
    // Near the pitch on the grid, so that an angle does not jump by a revolution.
    let apart = |f: &Found| (within.angle_deg(&f.placed.from_scan) - snapped + 540.0).rem_euclid(360.0) - 180.0;
    let level = within.frame(snapped + median(found.iter().map(apart)), faces_along);
    let origin =
        |axis: usize| median(found.iter().map(|f| (level * (f.placed.from_scan.inverse() * Point::origin()))[axis]));
    let from_scan = Motion::translation(0.0, -origin(1), -origin(2)) * level;
    let unlike_mm = median(found.iter().map(|f| f.placed.unlike_mm));
    let landmarks = median(found.iter().map(|f| f.placed.landmarks as f64)) as usize;
    Some(Placed { from_scan, unlike_mm, landmarks })
}

/// The middle one of some values; of an even number the upper of the two.
fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or_default()
}

/// Landmarks in a pose.
struct Found {
    placed: Placed,
    size: f64,
    pitch_deg: f64,
}

impl Found {
    /// Whether the landmarks lie as in a head, of any pitch.
    fn is_like_a_head(&self) -> bool {
        self.placed.landmarks >= ENOUGH_LANDMARKS
            && self.placed.unlike_mm <= UNLIKE_MM
            && (SIZES[0]..SIZES[1]).contains(&self.size)
    }

    /// Whether the landmarks lie as in a head that is upright.
    fn is_head(&self) -> bool {
        self.is_like_a_head() && self.pitch_deg.abs() <= LEVEL_DEG
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

/// The motion into the frame whose axes are the unit vectors `left`, `back` and `up` of the scan and whose origin is `origin`.
fn motion_into(origin: &Point, [left, back, up]: [Vector; 3]) -> Motion {
    let turn = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[left, back, up]).transpose());
    let rotation = UnitQuaternion::from_rotation_matrix(&turn);
    Motion::from_parts((-(rotation * origin.coords)).into(), rotation)
}
