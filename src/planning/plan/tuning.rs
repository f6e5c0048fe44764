//! Tuning numbers of cuts, paths and clearances.

// Limits of a cut.

/// Most points of a polyline.
pub(super) const MAX_POINTS: usize = 1000;
/// Most triangles of a cut's surface.
pub(super) const MAX_TRIANGLES: usize = 100_000;
/// Largest kerf, mm.
pub(super) const MAX_KERF_MM: f64 = 10.0;

// Pieces of bone.

/// Pieces below this volume are fragments, mm³: they join a neighbouring segment.
pub(super) const FRAGMENT_MM3: f64 = 100.0;
/// A piece of up to this volume is a fragment too when the kerf leaves less than [`FRAGMENT_MM3`] of it, mm³; of a larger piece
/// that is an error.
pub(super) const SAWN_FRAGMENT_MM3: f64 = 300.0;
/// Smallest thickness of a segment (volume over half its area) as a share of the grid spacing. A thinner one lies between two
/// cuts in the same place.
pub(super) const MIN_THICKNESS_SHARE: f64 = 0.2;

// Bridges.

/// Largest cross-section of a bridge that is parted, mm². A larger one is a joint without a cut, or a misplaced cut: the neck
/// of a condyle has 60 to 100 mm².
pub(super) const MAX_BRIDGE_MM2: f64 = 60.0;
/// Largest cross-section of all parted bridges together, mm².
pub(super) const MAX_BRIDGES_MM2: f64 = 250.0;

/// Flow above which the search stops: so much bone is not a bridge.
pub(super) const MAX_FLOW: u64 = 400_000;
/// Nodes more than `FINE_STEPS` grid steps from the cut are merged in blocks of `COARSE_BLOCK` nodes along each axis.
pub(super) const FINE_STEPS: u32 = 5;
pub(super) const COARSE_BLOCK: usize = 3;
/// Extra cost of an edge beside the cut, where one far away costs 1; it decays exponentially over `FALL_OFF_MM`, mm. Thin walls
/// beside the cut are not what holds the bone together.
pub(super) const EXTRA_COST: f64 = 7.0;
pub(super) const FALL_OFF_MM: f64 = 8.0;

// Teeth.

/// Height of a tooth's crown, mm: incisors have 9 to 10.5 mm, molars 7 mm (Wheeler's Dental Anatomy).
pub(super) const CROWN_MM: f64 = 9.0;
/// The second molar ends about this far behind the incisors, mm.
pub(super) const ARCH_DEPTH_MM: f64 = 50.0;
/// Half the width over the cheek side of the molars, with the gum, mm.
pub(super) const ARCH_HALF_WIDTH_MM: f64 = 38.0;
/// The zone of teeth also reaches this far in front of the foremost bone, mm: the surface of tissue beside it.
pub(super) const BEFORE_ARCH_MM: f64 = 10.0;
/// Half the width of the front teeth in which their foremost point is looked for, mm: both central incisors and a shift.
pub(super) const FRONT_HALF_WIDTH_MM: f64 = 12.0;
/// A segment carries teeth when at least this much of its surface lies at them, mm²: four incisors have about 300 mm² on each
/// side. A ramus that ends behind the molars has less.
pub(super) const TOOTHED_MM2: f64 = 600.0;

// Names of segments.

/// Distance from the midline beyond which a segment belongs to one side, mm; of a sagittal split it is then a ramus.
pub(super) const ASIDE_MM: f64 = 18.0;

// Paths.

/// Evenly spaced samples along a path, in addition to its waypoints.
pub(super) const PATH_SAMPLES: usize = 10;
/// At most about this many vertices of a segment are tested against other bone.
pub(super) const PROBES: usize = 6000;
/// Displacements above this are unusual, mm: bone is hardly ever moved further.
pub(super) const MAX_USUAL_MOVE_MM: f64 = 20.0;
/// Rotations above this are unusual, degrees: bone is hardly ever turned further.
pub(super) const MAX_USUAL_TURN_DEG: f64 = 20.0;
/// Overlap at the end below this depth (mm) or this volume (mm³) is not reported: it is within the accuracy of the surfaces.
pub(super) const BONE_OVERLAP_MM: f64 = 1.0;
pub(super) const BONE_OVERLAP_MM3: f64 = 100.0;
/// Overlap at the end of up to this depth needs no check, mm: a saw and a file remove as much.
pub(super) const MAX_SAWN_OVERLAP_MM: f64 = 2.0;
/// Mean gap between cut faces above which a graft is needed, mm.
pub(super) const WIDE_GAP_MM: f64 = 5.0;

/// Largest rotation by which the mandible follows the upper jaw, radian (46°).
pub(super) const MAX_AUTOROTATION_RAD: f64 = 0.8;

// Gaps and overlaps.

/// Farthest distance at which a cut face counts as the opposite side of a gap, mm.
pub(super) const FAR_FACE_MM: f64 = 30.0;
/// At rest a cut face is no farther from its counterpart than the kerf plus this share of the mean edge length.
pub(super) const TOUCH_SHARE: f64 = 0.1;
/// Least cosine between the normal of a cut face and the reversed normal of its counterpart.
pub(super) const MIN_FACING: f64 = 0.7;

/// Edge of the smallest cells as a share of the solid's extent. At edges of a solid, where a cell sees only one of two faces,
/// larger cells count too much.
pub(super) const CELL_EDGE_SHARE: f64 = 1.0 / 64.0;
/// Least and greatest edge of the smallest cells, mm.
pub(super) const CELL_EDGE_MM: [f64; 2] = [0.125, 1.0];
/// Samples along the edge of a smallest cell.
pub(super) const CELL_SAMPLES: usize = 6;
