//! Tuning numbers of the mesh.
//!
//! Lengths in edges are shares of the lattice's edge, [`MeshSettings::edge_mm`](super::MeshSettings::edge_mm); sines are those
//! of the dihedral angles of a tetrahedron. `invariants_tests` and `tests::a_head_is_meshed_as_promised` show the effect of all
//! of them on the shape, the volume and the skin of a mesh; where another test shows a number by itself, its doc names it.

// ---- building ----

/// Edge lengths tried in turn, as shares of the requested one. The next one is tried when elements stay inverted.
pub(super) const EDGE_SHARES: [f64; 4] = [1.0, 0.97, 0.93, 0.88];
/// Smallest cosine between a boundary face's normal and the skin's at which the face counts as facing the skin.
pub(super) const FACING_SKIN_COSINE: f64 = 0.3;
/// Number of passes of edge splitting, smoothing and prism repair under curved skin.
pub(super) const PASSES: usize = 4;
/// Largest number of tetrahedra in a mesh.
pub(super) const MAX_TETRAHEDRA: u64 = 2_000_000;

// ---- stuffing ----

/// A cut nearer to a vertex than this share of a long edge moves the vertex onto the surface.
pub(super) const SNAP_LONG: f64 = 0.24999;
/// The same for a short edge, between a corner and a centre.
pub(super) const SNAP_SHORT: f64 = 0.41189;
/// Thickness of the layer that is always meshed below the skin layer, edges.
/// Snapping takes up to 0.36 edges on either side (along a short edge); half an edge more keeps the rest connected.
pub(super) const CARVE_EDGES: f64 = 1.25;

// ---- refinement of the lattice in thin walls and at thin bone ----

/// Prisms take at most this share of a wall from either side, and leave at least [`WALL_MIDDLE_EDGES`] between them.
pub(super) const WALL_PRISM_SHARE: f64 = 0.25;
/// Tissue between the prisms of a wall, edges. That is one and a quarter edges of a refined cube, the same multiple as
/// [`CARVE_EDGES`] above bone. Shown by `refinement_marks::tests::a_thin_wall_gets_thin_prisms_and_refined_cubes`.
pub(super) const WALL_MIDDLE_EDGES: f64 = 0.65;
/// Smallest thickness of prisms in a wall, mm.
pub(super) const MIN_WALL_PRISM_MM: f64 = 0.3;
/// Walls whose part between the prisms is thinner than this many edges are meshed by refined cubes.
/// Shown by `tests::a_thin_wing_is_covered_with_prisms`.
pub(super) const RESOLVED_WALL_EDGES: f64 = 1.0;
/// Largest change of the prisms' thickness per distance along the skin.
pub(super) const THICKNESS_SLOPE: f64 = 0.12;
/// Bone or air is too thin for an edge of the lattice when the middle of the edge lies this many edges inside it while both
/// ends lie in tissue.
pub(super) const PIERCED_EDGES: f64 = 0.2;
/// Thin bone is searched for down to this many edges below the skin; deeper bone hardly affects the skin.
/// Shown by `refinement_marks::tests::thin_bone_near_the_skin_gets_refined_cubes`.
pub(super) const THIN_BONE_DEPTH_EDGES: f64 = 3.0;

// ---- thin tissue over bone and air ----

/// Where tissue below the skin layer is thinner than this many edges, there are no tetrahedra and prisms stand on the bone.
pub(super) const THINNEST_TISSUE_EDGES: f64 = 0.5;
/// Thinnest prism, mm. Where skin and bone are nearer, the prism extends into the bone.
pub(super) const THINNEST_PRISM_MM: f64 = 0.3;
/// Where bone protrudes from the skin by more than this, the skin layer has a hole, mm.
pub(super) const PROTRUSION_MM: f64 = 0.3;
/// Tetrahedra at pressed nodes with a smaller sine are removed, and splits may not create flatter ones; smoothing improves
/// those that remain.
pub(super) const FLATTEST_SINE: f64 = 0.14; // 8°
/// A neck of a pocket is narrower than twice this many edges.
/// Shown by `pockets::tests::a_pocket_behind_a_narrow_neck_goes_and_one_with_a_wide_mouth_stays`.
pub(super) const NECK_EDGES: f64 = 0.6;

// ---- parts ----

/// A part with prisms but fewer elements than this share of the largest part is dropped too, because it would float.
pub(super) const MIN_PART_SHARE: f64 = 0.01;
/// Pieces of up to this many tetrahedra that are attached by a single face are dropped.
/// Such pieces are soft and fold under the first load.
pub(super) const MAX_DETACHED: usize = 50;

// ---- smoothing ----

/// Smoothing skips tetrahedra whose smallest sine is above this.
pub(super) const GOOD_SINE: f64 = 0.34; // 20°
/// Rounds of averaging and of the pattern search on the nodes of bad tetrahedra.
pub(super) const SMOOTHING_ROUNDS: usize = 4;
/// Steps of the pattern search on the nodes of bad tetrahedra, edges.
pub(super) const SMOOTHING_STEPS: [f64; 4] = [0.16, 0.08, 0.04, 0.02];

// ---- prisms ----

/// Prisms are improved until their scaled Jacobian is above this.
pub(super) const WANTED_JACOBIAN: f64 = 0.35;
/// Prisms still below this scaled Jacobian are left out.
pub(super) const WORST_JACOBIAN: f64 = 0.1;
/// Largest distance of the barycentre of a prism's outer triangle from the skin, mm. Prisms farther off are left out.
pub(super) const MAX_SKIN_DISTANCE_MM: f64 = 0.3;
/// The smallest sine of a tetrahedron may not fall below this when a prism's inner node moves.
pub(super) const REPAIR_SINE_FLOOR: f64 = 0.2;
/// A move must better the worst scaled Jacobian by more than this.
pub(super) const BETTER: f64 = 1e-4;
/// Rounds of repair after which a skin is judged,
pub(super) const ROUGH_AFTER_ROUNDS: usize = 2;
/// and the share of the layer's nodes that may still lie beside badly shaped prisms then: 3 % on the phantom, 6 % on `ct_head`, 94 % on
/// a ball with 5 mm of noise.
pub(super) const ROUGH_SHARE: f64 = 0.5;
/// Most rounds of repair over the nodes of bad prisms.
pub(super) const REPAIR_ROUNDS: usize = 12;
/// Steps of the pattern search on the nodes of bad prisms, edges.
pub(super) const REPAIR_STEPS: [f64; 4] = [0.2, 0.1, 0.05, 0.02];

// ---- outer triangles on the skin ----

/// Largest distance of an edge's midpoint or an outer triangle's barycentre from the skin, mm.
/// It is below the guaranteed [`MAX_SKIN_DISTANCE_MM`] because the later repair moves nodes.
/// Shown by `refine::tests::curved_skin_gets_finer_tops_that_conform`.
pub(super) const TARGET_SKIN_DISTANCE_MM: f64 = 0.22;
/// A prism's scaled Jacobian may not fall below this when an outer node moves onto the skin, unless it was lower before.
pub(super) const FIT_JACOBIAN_FLOOR: f64 = 0.25;
/// Rounds over the nodes of outer triangles that are off the skin.
pub(super) const FIT_ROUNDS: usize = 6;
/// Steps of the search for a better place of an outer node, edges.
pub(super) const FIT_STEPS: [f64; 3] = [0.3, 0.15, 0.06];
/// Edges shorter than this many lattice edges, in a prism's outer or inner triangle, are not split.
pub(super) const SHORTEST_SPLIT_EDGES: f64 = 0.25;
/// Rounds of independent splits; each triangle takes part once a round.
pub(super) const SPLIT_ROUNDS: usize = 8;
/// A midpoint moved to its surface may reduce the smallest sine at most by this factor, compared with the straight midpoint.
pub(super) const SPLIT_SINE_SHARE: f64 = 0.9;
/// Splits may not create prisms worse than this scaled Jacobian, nor reduce it below [`SPLIT_JACOBIAN_SHARE`] times the old
/// value.
pub(super) const SPLIT_JACOBIAN_FLOOR: f64 = 0.2;
/// See [`SPLIT_JACOBIAN_FLOOR`].
pub(super) const SPLIT_JACOBIAN_SHARE: f64 = 0.7;

// ---- tissue and report ----

/// Tissue below this value is fat, HU: the midpoint between fat and muscle.
/// Shown by `tests::a_ct_tells_fat_from_muscle_and_depth_does_where_it_says_nothing`.
pub(super) const FAT_BELOW_HU: f64 = -25.0;
/// Share of the distance from bone to skin that is muscle where the CT gives no value.
pub(super) const MUSCLE_SHARE: f64 = 0.4;
/// Edge of the cells that sample the domain's volume, mm; longer when there would be more than [`MAX_SAMPLE_CELLS`].
/// Shown by `volume::tests::shell_of_a_ball`.
pub(super) const SAMPLE_CELL_MM: f64 = 1.0;
/// Largest number of cells that sample the domain's volume.
pub(super) const MAX_SAMPLE_CELLS: f64 = 16e6;
/// Pockets with less than this share of the mesh's volume are a fact for the report; larger ones deserve a look.
pub(super) const MINOR_POCKET_SHARE: f64 = 0.05;
/// The same for prisms that were left out, as a share of all prisms.
pub(super) const MINOR_PRISM_SHARE: f64 = 0.01;
/// The same for elements of loose parts, as a share of all elements.
pub(super) const MINOR_PART_SHARE: f64 = 0.01;

// ---- oral slit ----

/// Half opening of the slit while it is meshed, edges. With the prisms of both lips the gap in the lattice is then wider than an
/// edge. Shown by `slit::tests::lips_are_meshed_apart`.
pub(super) const OPENING_EDGES: f64 = 0.4;
/// Height over the slit up to which the opening moves tissue, in half openings. The map then stretches by at most a third.
pub(super) const OPENING_REACH: f64 = 6.0;
/// Slope of the half opening towards its ends: walls meet there at 53°, which prisms can line, and closing shears tissue there
/// by a half.
pub(super) const OPENING_TAPER: f64 = 0.5;
/// The slit is fully open up to this far behind the lips, mm, so that inaccurate bone does not leave them joined there.
pub(super) const PAST_BACK_MM: f64 = 0.5;
/// Width of the rounded edges between skin and red margins, mm; each takes off a quarter of it. Sharper ones would need prisms
/// much shorter than a default edge, as the skin's natural roundness has the same size.
pub(super) const LIP_FILLET_MM: f64 = 1.2;
/// Outer nodes within this distance of the slit face the other lip, mm: all of the red margin and most of its rounded edge.
pub(super) const FACING_GAP_MM: f64 = 0.25;
/// Narrowest mouth that is parted, mm: five edges of the default mesh.
pub(super) const MIN_SLIT_WIDTH_MM: f64 = 20.0;
/// Least and greatest thickness of the lips along the slit, mm.
pub(super) const MIN_SLIT_DEPTH_MM: f64 = 2.0;
/// See [`MIN_SLIT_DEPTH_MM`].
pub(super) const MAX_SLIT_DEPTH_MM: f64 = 40.0;
/// Greatest slope of a slit seen from in front; steeper ones would not open along z.
pub(super) const MAX_SLIT_BEND: f64 = 1.0;
/// Skin up to this far in front of the slit's curve is parted too, mm: the curve may lie in a crease.
pub(super) const BEFORE_FRONT_MM: f64 = 4.0;
/// New vertices of the skin keep this share of an edge away from its ends.
pub(super) const SPLIT_END_SHARE: f64 = 0.02;
/// A tetrahedron with a smaller sine after the slit is closed counts as inverted: it would fold under the first load. (2°)
pub(super) const FLATTEST_CLOSED_SINE: f64 = 0.035;
