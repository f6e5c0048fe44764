//! Tuning numbers of proposed landmarks: search ranges from textbook distances, checked on `prosopon bench proposals`.

// Upper jaw.

/// The Le Fort I plane is proposed this far above the anterior nasal spine, mm: above the palate.
pub(super) const ABOVE_SPINE_MM: f64 = 1.0;

/// The median front of the bone is taken over columns between these distances from the midline, without the septum, mm.
pub(super) const APERTURE_BESIDE_MM: [f64; 2] = [3.0, 9.0];
/// The nasal aperture is at least this deep and high, mm.
pub(super) const APERTURE_DEPTH_MM: f64 = 8.0;
pub(super) const APERTURE_HEIGHT_MM: f64 = 12.0;
/// Search heights for bone above and below the aperture, mm.
pub(super) const APERTURE_ABOVE_MM: f64 = 50.0;
pub(super) const APERTURE_BELOW_MM: f64 = 30.0;

// Midline.

/// Edge of a cell of the map, mm.
pub(super) const MIRROR_CELL_MM: f64 = 1.0;
/// Distance to either side over which the face is compared, mm.
pub(super) const MIRROR_REACH_MM: f64 = 50.0;

// Profile.

/// Half width of the strip whose foremost points make a profile, mm.
pub(super) const PROFILE_STRIP_MM: f64 = 3.0;
/// Step of a profile along z, mm.
pub(super) const PROFILE_STEP_MM: f64 = 1.0;
/// Depth within which a blunt extremum counts as flat, mm.
pub(super) const BLUNT_MM: f64 = 0.5;

// Orbit.

/// Search range of the lower rim, and distance of the orbit's middle, from the midline, mm.
pub(super) const ORBIT_RIM_MM: [f64; 2] = [26.0, 42.0];
pub(super) const ORBIT_MIDDLE_MM: f64 = 34.0;
/// Search range of the orbit above the anterior nasal spine, mm.
pub(super) const ORBIT_HEIGHTS_MM: [f64; 2] = [8.0, 70.0];
/// Bone farther than this behind the spine is the orbit's wall and not its rim, mm.
pub(super) const RIM_DEPTH_MM: f64 = 38.0;
/// An opening is at least this high, mm: a sinus that shows through thin bone is lower.
pub(super) const MIN_ORBIT_MM: f64 = 18.0;
/// The suture lies this share of the opening's height above its lower rim.
pub(super) const SUTURE_SHARE: f64 = 0.75;
/// The lateral rim lies within these distances from the midline, mm.
pub(super) const LATERAL_RIM_MM: [f64; 2] = [38.0, 64.0];

// Ear canal.

/// Search range of the canal's opening, lateral to the condyle's top, behind it and above it, mm.
pub(super) const CANAL_OUTSIDE_MM: [f64; 2] = [-6.0, 16.0];
pub(super) const CANAL_BEHIND_MM: [f64; 2] = [4.0, 32.0];
pub(super) const CANAL_ABOVE_MM: [f64; 2] = [-22.0, 14.0];
/// Usual position of the canal's middle, behind and above the condyle's top, mm.
pub(super) const USUAL_CANAL_MM: [f64; 2] = [14.0, -4.0];
/// Holes farther than this from the usual position are cells of the mastoid, mm.
pub(super) const MAX_CANAL_OFF_MM: f64 = 9.0;
/// Smallest and largest cross-section of a canal, mm².
pub(super) const CANAL_AREA_MM2: [f64; 2] = [12.0, 160.0];

// Lower jaw.

/// Search range of the ramus above the occlusal plane, mm.
pub(super) const RAMUS_HEIGHTS_MM: [f64; 2] = [4.0, 15.0];
/// Search range of the ramus behind the spine, mm.
pub(super) const RAMUS_DEPTHS_MM: [f64; 2] = [30.0, 130.0];
/// A ramus is no thicker than this, mm.
pub(super) const MAX_RAMUS_THICKNESS_MM: f64 = 17.0;
/// Shortest and longest ramus from front to back, mm.
pub(super) const RAMUS_LENGTH_MM: [f64; 2] = [15.0, 60.0];
/// The lingula lies this share of the ramus's length behind its front, and this far above the occlusal plane, mm.
pub(super) const LINGULA_SHARE: f64 = 0.6;
pub(super) const LINGULA_ABOVE_MM: f64 = 3.0;
/// Height below the lingula over which the medial face of the plate is taken, mm.
pub(super) const SPLIT_MM: f64 = 22.0;
/// The second molar lies this far in front of the ramus's front, mm.
pub(super) const MOLAR_AHEAD_MM: f64 = 14.0;
/// Half the edge of the square that holds the neck of the condyle, mm.
pub(super) const NECK_HALF_MM: f64 = 8.0;
/// Most bone of the condyle within that square at one level, mm²; more is the skull base.
pub(super) const MAX_CONDYLE_MM2: f64 = 190.0;
/// Largest lateral distance between the middles of the condyle and of the ramus, mm.
pub(super) const BESIDE_PLATE_MM: f64 = 2.5;
/// Least height of the condyle's top above the occlusal plane, and greatest above the middle of the ramus's search range, mm.
pub(super) const MIN_JOINT_MM: f64 = 24.0;
pub(super) const MAX_RAMUS_MM: f64 = 60.0;
/// Greatest depth of the jaw's angle below the occlusal plane, mm.
pub(super) const MAX_ANGLE_DEPTH_MM: f64 = 55.0;

/// Heights of the front of the lower teeth's bone above pogonion, mm.
pub(super) const ALVEOLUS_MM: [f64; 2] = [14.0, 34.0];
/// Height of the lower incisors' crowns, mm: the search for the deepest point above the chin ends below them.
pub(super) const LOWER_CROWN_MM: f64 = 8.0;

// Voxels.

/// Edge of a voxel, mm.
pub(super) const VOXEL_MM: f64 = 1.0;
/// Most voxels along an axis; bone beyond them is left out.
pub(super) const MAX_VOXELS: usize = 320;

// Proportions.

/// Half-width of the strip around the middle of the head in which the tip of the nose is looked for, mm.
pub(super) const NOSE_STRIP_MM: f64 = 20.0;
/// Adult distances below the tip of the nose, mm: Le Fort I cut, occlusal plane.
pub(super) const LE_FORT_1_BELOW_NOSE_MM: f64 = 16.0;
pub(super) const OCCLUSAL_BELOW_NOSE_MM: f64 = 37.0;

// Accuracy.

/// Accuracy of points without a measurement, mm.
pub(super) const UNKNOWN_MM: f64 = 8.0;
