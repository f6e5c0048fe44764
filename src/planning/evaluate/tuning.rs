//! Tuning numbers of comparison and registration.

// Pairs of surfaces.

/// Surfaces whose bounding boxes differ by more than this factor are in different units; metres and mm differ by 1000.
pub(super) const OTHER_UNIT: f64 = 200.0;
/// Above this factor between the bounding boxes there is a warning about the units.
pub(super) const DOUBTFUL_SIZE: f64 = 5.0;
/// Surfaces whose bounding boxes lie farther apart than this do not show one head in one frame, mm.
pub(super) const APART_MM: f64 = 50.0;

// Error maps.

/// Width of the histogram's bins between plus and minus [`HISTOGRAM_LIMIT_MM`], mm.
pub(super) const BIN_MM: f64 = 0.25;
pub(super) const HISTOGRAM_LIMIT_MM: f64 = 3.0;
/// Standard deviation of the Gaussian neighbourhood that `ErrorMap::smoothed` averages over, mm.
pub(super) const SMOOTHED_MM: f64 = 5.0;
/// Area-weighted mean cosine between the normals below which the surfaces face opposite ways.
pub(super) const OPPOSITE: f64 = -0.2;
/// Mean distance above which the surfaces are not registered, mm; a prediction's error is smaller.
pub(super) const UNREGISTERED_MM: f64 = 20.0;

/// Most averaging rounds; on very fine meshes the averages therefore cover less than the requested radius.
pub(super) const MAX_ROUNDS: usize = 200;

// Registration.

/// The fine run uses about this many source vertices, picked evenly by index.
pub(super) const FINE_POINTS: usize = 5000;
/// The coarse runs, which choose the start, use about this many.
pub(super) const COARSE_POINTS: usize = 500;
pub(super) const COARSE_ITERATIONS: usize = 25;
pub(super) const ITERATIONS: usize = 120;
/// Rotation of the alternative starts about each axis, in both senses, rad.
pub(super) const START_TURN: f64 = 0.14;
/// Centroids farther apart than this are also aligned by one of the starts, mm.
pub(super) const START_APART_MM: f64 = 15.0;
/// Cap on the distances that score a start, mm.
pub(super) const START_CAP_MM: f64 = 10.0;
/// Share of the pairs, the nearest ones, that the alignment phase keeps.
pub(super) const ALIGNED_SHARE: f64 = 0.6;
/// The alignment phase ends when no point moves farther than this in one iteration, mm.
pub(super) const ALIGNED_MM: f64 = 1e-3;
/// Later pairs farther apart than this many robust standard deviations are trimmed.
pub(super) const TRIM: f64 = 2.5;
/// Smallest trimming distance, mm: with exact data the robust standard deviation falls to 0 and would trim all pairs.
pub(super) const TRIM_FLOOR_MM: f64 = 1e-3;
/// An update that moves no point farther than this ends the iteration, mm.
pub(super) const STILL_MM: f64 = 1e-8;
/// Movement still accepted when the iterations run out, in mm and as a share of the residual.
/// Pairs that alternate between kept and trimmed cause it; the movement that one such pair causes grows with the residual.
pub(super) const NEARLY_STILL_MM: f64 = 5e-3;
pub(super) const NEARLY_STILL_SHARE: f64 = 0.05;
/// A larger final movement is reported as a warning, mm.
pub(super) const WARN_MOVEMENT_MM: f64 = 1e-3;
/// Surfaces whose median distance stays above this do not match, mm.
pub(super) const MATCH_MM: f64 = 3.0;
/// A median distance above this gives a warning, mm.
pub(super) const GOOD_MM: f64 = 1.0;
/// Smallest share of the region's area with kept pairs, and the share below which there is a warning.
pub(super) const MIN_OVERLAP: f64 = 0.1;
pub(super) const WARN_OVERLAP: f64 = 0.5;
/// Smallest number of vertices and smallest area of a region, mm².
pub(super) const MIN_VERTICES: usize = 30;
pub(super) const MIN_AREA_MM2: f64 = 500.0;
/// Normals are averaged over this radius before the shape is judged, mm, but over at most this share of the surface's diagonal.
/// Without the averaging noise would count as shape.
pub(super) const SHAPE_MM: f64 = 8.0;
pub(super) const SHAPE_SHARE: f64 = 0.04;
/// Smallest ratio of the softest rigid motion's stiffness to the stiffest one's; below it the region slides along itself.
pub(super) const MIN_STIFFNESS: f64 = 2e-3;

/// Fewer pairs than the six unknowns cannot determine a motion.
pub(super) const MIN_PAIRS: usize = 6;
/// Smallest ratio of eigenvalues at which the equations of one step are solved.
pub(super) const SOLVABLE: f64 = 1e-9;

// Baselines.

/// Share of the nearest bone's motion that the simplest prediction gives to skin (issue 26; between the published 0.6 of the
/// upper lip and 1.0 of the chin).
pub(super) const BONE_SHARE: f64 = 0.7;

// Profile.

/// The profile line ends this far above and below the tip of the nose, and this far behind it, mm: at the forehead and where the
/// neck begins in an adult.
pub(super) const PROFILE_ABOVE_MM: f64 = 70.0;
pub(super) const PROFILE_BELOW_MM: f64 = 130.0;
pub(super) const PROFILE_BEHIND_MM: f64 = 75.0;
/// Widest gap between two pieces of the profile, mm: a mouth opened wide.
pub(super) const MAX_BREAK_MM: f64 = 40.0;
/// A gap of the profile is the mouth when it begins no farther than this below the tip of the nose, mm.
pub(super) const MOUTH_BELOW_MM: f64 = 60.0;
/// Shifts from the midline, mm, of the planes in which the profile is looked for: beside the first one there may be a nostril,
/// into which the line would turn.
pub(super) const PROFILE_SHIFTS_MM: [f64; 7] = [0.0, 1.0, -1.0, 2.0, -2.0, 3.0, -3.0];
/// A profile that ends higher than this below the tip of the nose does not reach the chin, mm.
pub(super) const PROFILE_REACH_MM: f64 = 60.0;
/// Points of a reported profile line are at least this far apart, mm.
pub(super) const PROFILE_STEP_MM: f64 = 0.5;

// Points on the profile. Shares are of the height from the first to the second point named, downwards, in an average adult
// (Farkas, Anthropometry of the Head and Face, 2nd ed. 1994: pronasale, subnasale, stomion, sublabiale and pogonion lie about
// 0, 13, 37, 55 and 74 mm below the tip of the nose), with room on both sides.

/// Heights of the chin below the tip of the nose, from the fold of the lower lip to the lower border, mm.
pub(super) const CHIN_BELOW_NOSE_MM: [f64; 2] = [50.0, 95.0];
/// Subnasale between pronasale and pogonion.
pub(super) const SUBNASALE_SHARES: [f64; 2] = [0.04, 0.33];
/// Stomion between subnasale and pogonion.
pub(super) const STOMION_SHARES: [f64; 2] = [0.18, 0.62];
/// End of the lower lip between subnasale and pogonion.
pub(super) const LOWER_LIP_END: f64 = 0.72;
/// Least depth of the line between the lips behind both lips, mm; a shallower one is noise of the surface.
pub(super) const MIN_NOTCH_MM: f64 = 0.3;
/// A lip's margin lies no deeper than this behind the lip's foremost point, mm; farther back is the mouth.
pub(super) const LIP_DEPTH_MM: f64 = 8.0;
/// The lowest point of the chin lies no farther behind its foremost one than this, mm.
pub(super) const CHIN_DEPTH_MM: f64 = 22.0;

// Hard points.

/// A bone point is looked for this far inside its bone, mm: landmarks lie on the surface to about 4 mm (`prosopon bench
/// proposals`), and teeth of the other jaw may be closer than their own root.
pub(super) const INTO_BONE_MM: f64 = 3.0;
pub(super) const ROOTWARD_MM: f64 = 5.0;
/// A hard point that moves by less than this has no ratio, mm: 0.1 mm of error would change it by more than 0.1.
pub(super) const STILL_BONE_MM: f64 = 1.0;
