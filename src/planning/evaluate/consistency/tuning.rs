//! Limits of the checks. A real head (`ct_head`, `vtk_headsq`) and the phantom lie well within all of them.

// Skin and bone.

/// Points of bone for a judgement; the share outside is then known to about 1 %.
pub(super) const BONE_SAMPLES: usize = 800;
/// Bone farther than this in front of the skin lies outside, mm: decimated surfaces of one CT cross by up to 2 mm.
pub(super) const OUTSIDE_MM: f64 = 3.0;
/// Above this share of bone outside the skin a cause is looked for.
pub(super) const DOUBTFUL_OUTSIDE: f64 = 0.04;
/// Above this share skin and bone do not belong together, whatever the cause.
pub(super) const TOO_MUCH_OUTSIDE: f64 = 0.1;
/// A cause counts when it leaves no more than this share of what is outside as given.
pub(super) const LEFT_BY_CAUSE: f64 = 0.3;
/// The shallowest tenth of the bone lies no deeper than this below the skin, mm: bone of a face is 3 to 20 mm deep.
pub(super) const DEEPEST_BONE_MM: f64 = 25.0;
/// Least share of the bone's points that must face the inside of an open skin for a judgement.
pub(super) const LEAST_COVERED: f64 = 0.05;
/// Share of edges that run twice in one direction above which it is not known which side of the skin is outside.
pub(super) const MOST_INCONSISTENT: f64 = 0.01;
/// Size of bone or of a second skin relative to the skin that a change of unit must lead to.
pub(super) const LIKELY_SIZES: [f64; 2] = [0.3, 2.5];

// Two skins.

/// Points of the second skin that are followed.
pub(super) const SKIN_SAMPLES: usize = 250;
pub(super) const FIT_ITERATIONS: usize = 40;
/// Share of the points, the nearest ones, that a fit uses: hair, neck and the operated part differ.
pub(super) const FITTED_SHARE: f64 = 0.7;
/// Two skins whose median distance after a fit is below this show one head, mm.
pub(super) const SAME_HEAD_MM: f64 = 3.0;
/// A face laid on its own mirror image differs by more than this, mm (median; `ct_head` 1.0).
pub(super) const BEYOND_SYMMETRY_MM: f64 = 0.7;
/// A mirror image of one head counts when it reduces the median distance to this share: a planned change does not.
pub(super) const MIRRORED_SHARE: f64 = 0.25;
/// Fits that differ by less than this are alike, mm.
pub(super) const ALIKE_MM: f64 = 1.0;
/// A change that fits two skins must reduce the median distance to this share.
pub(super) const BETTER_SHARE: f64 = 0.5;

// Landmarks.

/// Allowed distance of a landmark from its surface beyond its accuracy, mm: a point read off slices of 2.5 mm lies within
/// about 4 mm, and a decimated surface lies up to 2 mm beside the true one.
pub(super) const ROOM_MM: f64 = 6.0;
/// Accuracy of points that the program does not propose, mm.
pub(super) const UNKNOWN_MM: f64 = 5.0;
/// From this number of landmarks off their surface on, a common cause is looked for.
pub(super) const SEVERAL: usize = 3;
/// Above this mean distance a common cause is looked for although few are off, mm: points of `ct_head` lie 1 to 2 mm off.
pub(super) const DOUBTFUL_MEAN_MM: f64 = 3.0;
/// The least shift that counts as the cause then, mm.
pub(super) const PLAIN_SHIFT_MM: f64 = 10.0;
/// Fewest landmarks by which a change is judged, of which there are few.
pub(super) const FEWEST_JUDGED: usize = 3;
/// Fewest landmarks by which a shift is judged: fewer points fit a head in many places.
pub(super) const FEWEST_SHIFTED: usize = 5;
/// Mean distance from the surfaces after a common shift up to which the shift counts as the cause, mm.
pub(super) const SHIFTED_MM: f64 = 3.0;
/// A shorter shift explains nothing, mm.
pub(super) const LEAST_SHIFT_MM: f64 = 5.0;
/// Steps of the starts of the search for a shift along each axis, mm, and how many to each side.
pub(super) const SHIFT_STEP_MM: f64 = 10.0;
pub(super) const SHIFT_STEPS: i32 = 8;
/// Starts, the best ones, from which a shift is refined.
pub(super) const BEST_STARTS: usize = 8;
pub(super) const SHIFT_ITERATIONS: usize = 25;

/// Smallest and largest size of a head relative to that of an average adult; beyond, the unit is wrong.
pub(super) const HEAD_SIZES: [f64; 2] = [0.55, 1.6];
/// Landmarks of a line determine no pose: smallest ratio of the extent across to the extent along.
pub(super) const FLAT: f64 = 0.08;
/// A landmark may lie this far above one that belongs above it, mm: extrema of rounded shapes are read off to about 4 mm.
pub(super) const ORDER_MM: f64 = 4.0;
/// A side is exchanged when the landmark lies this far on the other side, mm.
pub(super) const SIDE_MM: f64 = 5.0;
/// A landmark this far from where the others place it is not what its name says, mm: jaws of patients differ by up to 25 mm.
pub(super) const OUT_OF_PLACE_MM: f64 = 40.0;
/// Largest distance of the midline from the middle of the landmarks, mm: faces are up to 10 mm asymmetric.
pub(super) const MIDLINE_MM: f64 = 15.0;
/// Names in one message.
pub(super) const MOST_NAMED: usize = 8;
