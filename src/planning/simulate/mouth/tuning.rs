//! Tuning numbers of the search for the oral slit, mm.

// Place of the mouth.

/// The crease lies this far below and above the edge of the upper incisors: they show by 0 to 4 mm below the upper lip at rest,
/// and an overbite or a short lip adds some.
pub(super) const FROM_INCISORS_MM: [f64; 2] = [-6.0, 9.0];
/// The crease lies within this distance of the landmark `stomion`: a person places it to about a millimetre.
pub(super) const FROM_STOMION_MM: f64 = 3.0;
/// Height of the crease between `subnasale` (0) and `soft_pogonion` (1): a third in the canon of proportions, here with the
/// spread of faces.
pub(super) const PROFILE_SHARES: [f64; 2] = [0.2, 0.6];
/// Half width of the field of view.
pub(super) const VIEW_HALF_MM: f64 = 44.0;

// Crease.

/// Edge of a pixel of the view.
pub(super) const PIXEL_MM: f64 = 0.5;
/// Height of a lip over which its foremost point is looked for.
pub(super) const LIP_MM: f64 = 9.0;
/// Distance at which the curvature of the crease is measured.
pub(super) const NOTCH_MM: f64 = 1.5;
/// A crease deeper than this counts no more.
pub(super) const DEEP_MM: f64 = 2.5;
/// A notch deeper than this counts no more.
pub(super) const SHARP_MM: f64 = 0.8;
/// Weight of a notch beside that of the depth: the line between the lips is the sharpest of a face's creases.
pub(super) const NOTCH_WEIGHT: f64 = 3.0;
/// Cost of a step up or down by one pixel from one column to the next, in mm of depth.
pub(super) const STEP_COST: f64 = 0.15;
/// Least mean depth of a crease in its middle half: well above the roughness of skin from a CT, about a tenth of a voxel.
pub(super) const MIN_CREASE_MM: f64 = 0.25;
/// The crease ends where its score falls below this share of that in the middle.
pub(super) const END_SHARE: f64 = 0.25;
/// Length over which that score is averaged.
pub(super) const END_WINDOW_MM: f64 = 3.0;
/// The crease may be hidden over this length: a marker, a streak of metal or the print of a mask.
pub(super) const MAX_BREAK_MM: f64 = 8.0;
/// Distance of a commissure from the middle where the crease runs on into a fold of the cheek; half of an adult's mouth, about
/// 50 mm wide (Farkas 1994).
pub(super) const USUAL_HALF_WIDTH_MM: f64 = 25.0;
/// Least and greatest distance of a commissure from the middle of the mouth; adults have 20 to 30 mm.
pub(super) const HALF_WIDTH_MM: [f64; 2] = [14.0, 32.0];
/// One half of a mouth is at most this many times as wide as the other.
pub(super) const MAX_UNEVEN: f64 = 1.6;
/// Half length over which the curve is averaged, an edge of the default mesh: the print of a mask makes it waver.
pub(super) const SMOOTH_HALF_MM: f64 = 4.0;

// Slit.

/// Distance of the slit's knots.
pub(super) const KNOT_STEP_MM: f64 = 2.0;
/// A given curve may lie this far off the skin, and this far above or below the place at which a crease is looked for.
pub(super) const MAX_CURVE_OFF_MM: f64 = 8.0;
/// Room around a given curve in which the skin is looked at.
pub(super) const MIN_LIP_MM: f64 = 3.0;
/// Step of the search behind the lips.
pub(super) const DEPTH_STEP_MM: f64 = 0.25;
/// Thinnest lips: bone nearer than this is a streak of dental metal.
pub(super) const LEAST_DEPTH_MM: f64 = 4.0;
/// Thickest lips, with the cheek beside the commissures.
pub(super) const MAX_DEPTH_MM: f64 = 25.0;
/// Thickness of lips behind which nothing is found; average lips at the incisors have 11 to 13 mm.
pub(super) const DEFAULT_DEPTH_MM: f64 = 12.0;
/// Half length over which the median of the depths is taken: an incisor's width.
pub(super) const MEDIAN_HALF_MM: f64 = 4.0;
/// Share of places behind which teeth or air should be found.
pub(super) const MIN_HITS: f64 = 0.7;
