//! Tuning numbers of the templates, mm unless stated.

// Upper jaw.

/// Half width of the cuts, mm: wider than a maxilla at its alveolar process (some 65 mm), narrower than the distance
/// between the rami (some 85 mm).
pub(super) const HALF_WIDTH_MM: f64 = 38.0;
/// Half width of the Le Fort I plane, mm: in front of the tuberosities there is no mandible, but the zygoma may reach down.
pub(super) const HALF_WIDTH_ABOVE_MM: f64 = 60.0;
/// Distance from the midline at which the plane steps down beside the nose, mm.
pub(super) const STEP_BESIDE_MM: f64 = 21.0;
/// The lowered plane passes this far below the cheek bone's lower border, mm.
pub(super) const BELOW_ZYGOMA_MM: f64 = 2.0;
/// Greatest depth of the step as a share of the height above the occlusal plane: it stays above the apices of the molars.
pub(super) const MAX_STEP_SHARE: f64 = 0.45;
/// Half width of the occlusal cut, mm: streaks of dental metal reach beyond the arch.
pub(super) const HALF_WIDTH_TEETH_MM: f64 = 45.0;
/// Neighbouring rectangles overlap by this, mm; a cut that ends in bone leaves no mark there.
pub(super) const OVERLAP_MM: f64 = 2.0;
/// Distance from the foremost alveolar bone back to the end of the tuberosities where the bone does not show it, mm.
pub(super) const ARCH_DEPTH_MM: f64 = 48.0;

// Midface.

/// Cuts begin this far in front of the face, mm.
pub(super) const AHEAD_MM: f64 = 20.0;
/// Least step along x between neighbouring landmarks of the Le Fort II line, mm, so that the line does not cross itself.
pub(super) const MIN_STEP_MM: f64 = 0.5;
/// Half width of the plane behind the face above the coronoid processes, mm; below, between the rami, it is [`HALF_WIDTH_MM`].
pub(super) const HALF_WIDTH_FACE_MM: f64 = 80.0;

// Mandible.

/// Neighbouring cuts overlap by this, mm.
pub(super) const MANDIBLE_OVERLAP_MM: f64 = 1.5;
/// The medial cut lies this far above the lingula, mm.
pub(super) const ABOVE_LINGULA_MM: f64 = 4.0;
/// The medial cut ends this far behind the lingula (Hunsuck), mm.
pub(super) const BEHIND_LINGULA_MM: f64 = 8.0;
/// From the medial face of the ramus, and from the buccal face of the body, to the middle between the cortices, mm.
pub(super) const HALF_RAMUS_MM: f64 = 3.5;
pub(super) const HALF_BODY_MM: f64 = 4.5;
/// From the lingula to the front border of the ramus and beyond, mm.
pub(super) const TO_FRONT_MM: f64 = 24.0;
/// Cuts through one cortex reach this far from the middle of the bone, mm.
pub(super) const CORTEX_REACH_MM: f64 = 14.0;
/// From the molar's buccal face down to below the lower border, mm.
pub(super) const TO_LOWER_BORDER_MM: f64 = 32.0;
/// The occlusal separation reaches this far in front of the rami, mm: over the whole dental arch.
pub(super) const TEETH_FRONT_MM: f64 = 60.0;
/// How far the rami converge, per side, for each millimetre towards the front, mm.
pub(super) const RAMUS_SLANT: f64 = 0.35;
