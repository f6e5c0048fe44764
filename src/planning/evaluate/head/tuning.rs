//! Limits of the estimate of a head's frame.

/// Points of each surface.
pub(super) const SAMPLES: usize = 500;
/// Points of each surface in the search from many starts, and for choosing among what these find.
pub(super) const COARSE_SAMPLES: usize = 80;
pub(super) const MIDDLE_SAMPLES: usize = 250;
/// Iterations from each start, of those that are kept, and of the chosen planes.
pub(super) const COARSE_ROUNDS: usize = 10;
pub(super) const MIDDLE_ROUNDS: usize = 20;
pub(super) const FINE_ROUNDS: usize = 24;
/// Starts that are kept.
pub(super) const KEPT: usize = 6;
/// Share of the points, the nearest ones to their mirror image, that count: a third of a head may be asymmetric.
pub(super) const TRIMMED_SHARE: f64 = 0.7;
/// Planes whose normals differ by less are one, degrees.
pub(super) const SAME_PLANE_DEG: f64 = 12.0;
/// A plane is a mirror plane when the distance to the mirror image is below this share of the skull's diagonal.
pub(super) const SYMMETRIC_SHARE: f64 = 0.02;
/// Planes up to this factor worse than the best one are tried too.
pub(super) const CLEAR_SYMMETRY: f64 = 1.6;
/// Step of the pitches that are tried, degrees: proposals are found within 20° of upright.
pub(super) const PITCH_STEP_DEG: f64 = 15.0;
/// Step of the pitches from which the last proposals start, degrees.
pub(super) const SNAP_DEG: f64 = 5.0;
/// Rounds of proposing and levelling while searching.
pub(super) const SEARCH_ROUNDS: usize = 2;
/// Poses in which landmarks are proposed at last, and the step of pitch between them, degrees.
pub(super) const VARIED: usize = 5;
pub(super) const VARIED_DEG: f64 = 2.5;
/// Landmarks lie as in a head when there are so many, and lie within this of the average head on average, mm, in a head of such a size.
pub(super) const ENOUGH_LANDMARKS: usize = 12;
pub(super) const UNLIKE_MM: f64 = 9.0;
pub(super) const SIZES: [f64; 2] = [0.7, 1.35];
/// Pitch that is left after levelling, degrees.
pub(super) const LEVEL_DEG: f64 = 8.0;
/// Skin and bone lie no farther in front of the anterior nasal spine than this in a head of average size, mm, but for a small share: noses
/// reach 30 mm, jaws and nasal bones 15 mm.
pub(super) const SKIN_FRONT_MM: f64 = 45.0;
pub(super) const BONE_FRONT_MM: f64 = 25.0;
pub(super) const MOST_IN_FRONT: f64 = 0.02;
/// Landmarks less their mean distance from the average head's, mm, from which on a pose is certain.
pub(super) const CLEAR_WORTH: f64 = 13.0;
/// Points of each surface for the plane of the face, and how far behind the anterior nasal spine the face reaches, mm.
pub(super) const DENSE_SAMPLES: usize = 3000;
pub(super) const FACE_DEPTH_MM: f64 = 70.0;
/// Points nearer than this to their mirror image have most of their weight in the last fit of the plane, mm.
pub(super) const CORE_MM: f64 = 1.5;
