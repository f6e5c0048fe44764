//! Tuning numbers of the extraction from a CT.

// Units of the values.

/// Largest number of bins of a histogram: of 3500 HU a bin holds 14.
pub(super) const BINS: i64 = 256;
/// Standard deviation of the smoothing of a histogram, bins: 35 HU hide the comb of coarse grey values and join fat and muscle
/// when both are noisy.
pub(super) const SMOOTH_BINS: f64 = 2.5;
/// Neighbouring peaks are one when the valley between them is higher than this share of the lower one.
pub(super) const MERGE_RATIO: f64 = 0.75;
/// Smallest share of the voxels under a peak: a head that fills the volume leaves a few per cent of air.
pub(super) const MIN_PEAK_SHARE: f64 = 0.01;
/// Air and soft tissue are told apart when the valley between them is at most this share of the lower peak.
pub(super) const SEPARATION: f64 = 0.5;
/// Peaks above the largest one belong to soft tissue up to this share of the step from air: muscle lies 14 % above fat.
pub(super) const SOFT_STEP: f64 = 0.25;
/// Such a peak counts when it holds this share of the largest one.
pub(super) const SOFT_SHARE: f64 = 0.3;
/// Plausible steps from soft tissue to the 98 % quantile of tissue, in steps from air to soft tissue: bone lies 0.25 to 3 above it.
/// Fat taken for air gives 10.
pub(super) const BONE_STEPS: [f64; 2] = [0.2, 5.0];
/// Peak of air in a volume in HU.
pub(super) const HU_AIR: [f64; 2] = [-1150.0, -850.0];
/// Peak of soft tissue in a volume in HU: from fat to brain with contrast medium.
pub(super) const HU_SOFT: [f64; 2] = [-150.0, 120.0];
/// Levels that all other constants here refer to, HU.
pub(super) const AIR_LEVEL_HU: f64 = -1000.0;
pub(super) const SOFT_LEVEL_HU: f64 = 40.0;
/// Default thresholds, HU.
pub(super) const SKIN_HU: f64 = -300.0;
pub(super) const BONE_HU: f64 = 300.0;
/// Smallest share of the voxels that is padding around the scanned cylinder; the corners of its square hold 21 %.
pub(super) const PADDING_SHARE: f64 = 0.02;
/// Half the width of a peak of air, in steps from air to soft tissue, and its smallest share of the voxels nearer to air than to
/// tissue: noise of 150 HU leaves 0.3, while voxels shared by air and tissue have 0.12 to 0.2.
pub(super) const AIR_WIDTH: f64 = 0.06;
pub(super) const AIR_PEAK_SHARE: f64 = 0.25;
/// Padding above air by this share of the step from air to soft tissue is set to air.
pub(super) const PADDING_STEP: f64 = 0.15;

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
/// Largest area of an airway that leaves through an edge of the volume, mm²: a pharynx cut along and across has about 2500, and air
/// beside a head several times this.
pub(super) const MAX_AIRWAY_MM2: f64 = 5000.0;
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

// Noise.

/// Soft tissue with more noise is averaged, HU. Clinical CTs have 10 to 50; at 100 HU, 0.5 % of soft tissue exceeds the level of
/// bone.
pub(super) const NOISY_HU: f64 = 70.0;
/// Values of soft tissue with noise, HU.
pub(super) const NOISE_WINDOW_HU: [f32; 2] = [-300.0, 400.0];

// Cuts of the head by the field of view.

/// Smallest area of a cut that is reported, mm²: a strand of a mask, or an ear that touches the border, has less.
pub(super) const MIN_CUT_MM2: f64 = 400.0;
/// Tissue above this has no air in its voxel, HU. The last voxel before free air has, except for a few per cent of them.
pub(super) const WHOLE_TISSUE_HU: f64 = 0.0;
/// Where this share of a side's surface is whole tissue beside padding, the border of the scanned circle cuts it.
pub(super) const MIN_CUT_SHARE: f64 = 0.15;
/// Above this share of cut surface around the head, the skin is not in the field of view.
pub(super) const ALL_CUT_SHARE: f64 = 0.6;
/// A lowest face whose front lies farther behind the nose cuts the neck, mm.
pub(super) const CHIN_BEHIND_NOSE_MM: f64 = 50.0;
/// Depth behind the front of the lowest face in which the bone of a chin lies, mm.
pub(super) const CHIN_DEPTH_MM: f64 = 25.0;
/// Smallest area of bone of a cut chin, mm².
pub(super) const MIN_CHIN_MM2: f64 = 100.0;

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
