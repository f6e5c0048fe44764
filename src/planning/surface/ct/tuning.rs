//! Tuning numbers of the extraction from a CT.

// Resampling.

/// A face of the volume with less tissue than this share of the largest parallel slice does not cut the head …
pub(super) const CUT_SHARE: f64 = 0.25;
/// … and is extended by this much air, mm.
/// The ball that separates outside from inside then fits between head and face; otherwise a crown that nearly touches the last
/// slice would get a stub.
pub(super) const AIR_MM: f64 = 8.0;
/// Value outside the volume, HU.
pub(super) const AIR_HU: f32 = -1000.0;
/// Value of the plugs that close cut airways, HU.
pub(super) const TISSUE_HU: i16 = 40;
/// Depth of these plugs, mm: more than the thickness of the sheets that `head` removes.
pub(super) const LID_MM: f64 = 5.0;
/// Least inward extent of a cut airway, mm.
/// Shallower air lies between the head and a cover: a mask over the crown encloses air on the last slice.
pub(super) const AIRWAY_MM: f64 = 8.0;
/// Values are clamped to this, because interpolation across the edge of metal would otherwise oscillate by hundreds of HU.
pub(super) const MAX_HU: i16 = 2000;
pub(super) const MIN_HU: i16 = -1000;
/// Finest lattice spacing, mm; finer voxels add noise and time but no shape.
pub(super) const MIN_SPACING_MM: f64 = 0.8;
pub(super) const MAX_SPACING_MM: f64 = 1.5;
/// Largest number of lattice samples; larger volumes get a wider spacing.
pub(super) const MAX_SAMPLES: f64 = 4e7;

// Head.

/// Sheets thinner than twice this are removed, so that they do not connect the head with its surroundings, mm.
pub(super) const SHEET_MM: f64 = 1.5;
/// Protrusions of the filled head that a ball of this radius cannot enter are removed, mm: strands of a mask, markers, streaks.
pub(super) const BUMP_MM: f64 = 3.0;
/// Error of the lattice distances, in steps; smaller protrusions are not removed.
pub(super) const BUMP_TOLERANCE: f32 = 0.4;
/// Outside air is the space that a ball of this radius can reach from the border of the volume, mm …
pub(super) const BALL_MM: f64 = 5.0;
/// … and everything within this distance of the positions that the ball's centre reaches, mm. √2 times the radius lets air into
/// creases of 90° but only a few mm into nostrils and ear canals.
pub(super) const AIR_REACH_MM: f64 = 7.5;
/// Slope that converts distances to HU so that both can be combined, HU per mm; about the slope of skin in a CT.
pub(super) const HU_PER_MM: f64 = 300.0;

// Depth below the skin.

/// Depths are known up to this, mm.
pub(super) const MAX_DEPTH_MM: f64 = 4.0;
/// Largest amount by which the lattice distances exceed the true depth, in steps.
pub(super) const DEPTH_TOLERANCE: f64 = 0.4;

// Bone and air.

/// Smallest depth of bone below the skin, mm.
pub(super) const BONE_DEPTH_MM: f64 = 2.0;
/// Smallest depth of bone near metal, mm: streaks of metal reach the lips.
pub(super) const BONE_DEPTH_NEAR_METAL_MM: f64 = MAX_DEPTH_MM;
/// Smallest depth of air below the skin, mm: it ends before the plugs of nostrils and ears.
pub(super) const AIR_DEPTH_MM: f64 = 1.5;
/// Smallest airspace that is kept, mm³.
pub(super) const MIN_AIR_MM3: f64 = 200.0;

// Metal.

/// Largest distance from metal at which streaks resemble bone, mm.
pub(super) const STREAK_REACH_MM: f64 = 40.0;
/// Runs shorter than this along S are taken for streaks, mm: streaks fill a few slices, while teeth and ramus fill many.
pub(super) const STREAK_MM: f64 = 8.0;
/// Smallest value of metal, HU. Some enamel exceeds it too but loses little.
pub(super) const METAL_HU: i16 = 2800;
/// Metal nearer to the skin is taken for a skin marker, which causes no streaks, mm.
pub(super) const MARKER_DEPTH_MM: f64 = 4.0;

// Soft tissue.

/// Approximate spacing of the lattice, mm: at most half an element's edge.
pub(super) const SOFT_SPACING_MM: f64 = 2.0;
/// Values of soft tissue, HU. Lower values contain air, higher ones bone or metal.
pub(super) const SOFT_HU: std::ops::RangeInclusive<f32> = -150.0..=150.0;
/// Where a smaller share of the surroundings is soft tissue, the mean is NaN.
pub(super) const MIN_SOFT_SHARE: f32 = 0.2;
/// Number of passes of (1, 2, 1) / 4 along each axis; two give a standard deviation of one spacing.
pub(super) const PASSES: usize = 2;
/// Means are rounded to whole HU and clamped to this magnitude.
pub(super) const MAX_MEAN_HU: f32 = 127.0;

// Surfaces.

/// Smoothing iterations of the skin: they remove the steps between slices a few mm apart.
pub(super) const SKIN_ITERATIONS: usize = 10;
/// Smoothing iterations of bone and air: fewer than for the skin, because these structures are thin.
pub(super) const INNER_ITERATIONS: usize = 5;
/// Pieces of bone with a smaller bounding-box diagonal are removed, mm.
pub(super) const MIN_BONE_MM: f64 = 12.0;
/// Surfaces are not simplified below this number of triangles.
pub(super) const MIN_TRIANGLES: usize = 2000;
