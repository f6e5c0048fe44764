//! Tuning numbers of the solver, each with the reason for its value and the test or bench that shows its effect.
//!
//! None of them is a setting: callers choose accuracy and limits in [`SolveSettings`](super::SolveSettings). Where neither a test
//! nor a measurement is named, none is on record. Tests are those of `fem/tests` unless another file is named.

// Newton's method.

/// Iterations after which the condensed contact solve is no longer used: points that slip over a rim may cycle with it.
pub(super) const CONDENSED_ITERATIONS: usize = 6;
/// The condensed contact solve also stops once an iteration moves tissue by more than this share of the previous one.
pub(super) const CONDENSED_MAX_RATIO: f64 = 0.5;
/// A step has converged only when the estimated remaining displacement is below this share of the element size: 1e-3 mm for
/// elements of 4 mm. `stable_materials_take_over_only_on_request` compares two solutions to this tolerance.
pub(super) const DISPLACEMENT_TOLERANCE: f64 = 2.5e-4;
/// The same tolerance while multipliers are still to be updated, and for a step that is only displayed: 0.02 mm for 4 mm.
pub(super) const COARSE_DISPLACEMENT: f64 = 5e-3;
/// After a full Newton step shorter than this, mm, the tangent includes the whole curvature of the contact.
pub(super) const WHOLE_CURVATURE_BELOW_MM: f64 = 0.1;
/// After a full Newton step shorter than this, mm, the tangent includes a share of the curvature. Without it, Newton's method
/// gains a few per cent in each iteration where a point slides slowly over an edge of the bone.
pub(super) const PART_CURVATURE_BELOW_MM: f64 = 0.5;
/// That share: small enough that the tangent mostly remains positive definite.
pub(super) const PART_CURVATURE_SHARE: f64 = 0.75;
/// Iterations without the curvature of contact after one in which the exact tangent was not positive definite.
pub(super) const ITERATIONS_WITHOUT_CURVATURE: usize = 2;
/// A shorter share of the Newton step shows that the quadratic model was poor: the next tangent is projected.
pub(super) const POOR_STEP: f64 = 0.5;
/// Largest last Newton step of the skin at which an equilibrium for display is accepted, mm.
pub(super) const DISPLAY_STEP_MM: f64 = 0.02;
/// After a step below this share of the tolerance on displacements, the next Newton step tells how far the equilibrium is.
pub(super) const SHORT_STEP: f64 = 0.1;
/// Relative residual at which multipliers are updated: they converge to the contact pressure without an exact equilibrium.
pub(super) const COARSE_RESIDUAL: f64 = 1e-2;
/// Updates of the multipliers before contact fails.
pub(super) const MAX_MULTIPLIER_UPDATES: usize = 20;
/// The contact becomes stiffer when an update leaves more than this share of the penetration,
pub(super) const SLOW_PENETRATION: f64 = 0.25;
/// by this factor.
pub(super) const STIFFER: f64 = 4.0;
/// Bone near contact points moves at most this far in one substep, and no line search lets a point penetrate deeper, mm:
/// otherwise a point could come out on the other side of a thin wall (`tissue_does_not_pass_through_thin_bone`).
pub(super) const MAX_CONTACT_MOTION_MM: f64 = 2.0;
/// Tolerance of the linear system relative to the residual over the reactions: inexact Newton solves it only as accurately as
/// the next residual needs.
pub(super) const FORCING: f64 = 0.25;
/// Tolerance of the linear system relative to what is left until convergence.
pub(super) const FORCING_AT_END: f64 = 0.1;
/// Limits of the linear system's tolerance.
pub(super) const FORCING_RANGE: [f64; 2] = [1e-6, 0.05];
/// Tolerance of the linear system of the prediction of a step.
pub(super) const FORCING_OF_PREDICTION: f64 = 1e-2;
/// Round-off error of the energy at rest in units of shear modulus times volume.
pub(super) const ENERGY_NOISE: f64 = 1e-13;
/// Force floor in units of shear modulus times element size squared: a smaller reaction force is replaced by it in the
/// convergence test.
pub(super) const FORCE_FLOOR: f64 = 1e-3;

// Line search.

/// Largest share of the distance to the first inversion that a step may take.
pub(super) const INVERSION_MARGIN: f64 = 0.9;
/// A step towards an inversion is shortened at least to this share.
pub(super) const INVERSION_CUT: f64 = 0.95;
/// Constant of Armijo's sufficient-decrease condition.
pub(super) const SUFFICIENT_DECREASE: f64 = 1e-4;
/// Relative change of the energy below which rounding makes a comparison unsafe.
pub(super) const ENERGY_ROUND_OFF: f64 = 1e-9;
/// Where energies cannot be compared, a step is accepted when the slope has fallen to this share.
pub(super) const SLOPE_DECREASE: f64 = 0.9;
/// Largest multiple of a Newton step. At a saddle of the energy, where a point is about to leave a rim of the bone, the model's
/// step is far too short.
pub(super) const LONGEST_STEP: f64 = 1024.0;
/// Share of the slope below which a change of energy at the full step puts the minimum beyond twice that step. So it is where
/// gliding tissue turns round an edge of bone: its tangent leaves out most of the curvature that softens it (see [`BEND_SHARE`]).
pub(super) const SHALLOW: f64 = 0.75;
/// Largest multiple of such a step. With it, a node that turned round an edge took 8 iterations instead of 25 (`bimaxillary 5 and
/// -5` of `prosopon bench operations --part-lips`). The next steps remove what the other modes gain in error.
pub(super) const LONGEST_SHALLOW_STEP: f64 = 16.0;
/// Slopes below this multiple of the uncertainty of the energy do not tell how shallow it is.
pub(super) const LEAST_CERTAIN: f64 = 10.0;
/// Shortest share of a Newton step.
pub(super) const SHORTEST_STEP: f64 = 1e-5;

// Active sets of the quadratic model.

/// Points with a smaller gap may become active within one Newton step, mm.
pub(super) const NEAR_MM: f64 = 3.0;
/// Changes of the active set below one point in this many are left to the next iteration.
pub(super) const NEGLIGIBLE_CHANGES: usize = 50;
/// Largest number of active-set updates within one Newton step.
pub(super) const MAX_ACTIVE_SETS: usize = 8;
/// The condensed contact solve is trusted with the curvature of bodies while it differs by at most this from the whole model, mm.
pub(super) const TRUSTED_MM: f64 = 0.1;
/// Above this difference, mm, the factor alone shows that the condensed solve is not to be trusted.
pub(super) const DOUBTFUL_MM: f64 = 2.0 * TRUSTED_MM;

// Condensed contact.

/// Largest number of Newton iterations on the condensed energy.
pub(super) const CONDENSED_MAX_ROUNDS: usize = 40;
/// The iterations converge when no node moves farther than this share of the element size.
pub(super) const CONDENSED_TOLERANCE: f64 = 2.5e-4;
/// While points still move farther than this, mm, the curvature of the bodies is left out.
pub(super) const CONDENSED_CURVATURE_BELOW_MM: f64 = 1.0;
/// Largest movement of a point in one iteration, mm: in thin bone the gap is unreliable farther away.
pub(super) const CONDENSED_MAX_MOVE_MM: f64 = 1.0;
/// Largest number of conjugate gradient iterations in one Newton iteration with curvature.
pub(super) const CONDENSED_MAX_CG: usize = 40;
/// Relative reduction of the preconditioned residual norm, squared, at which these conjugate gradients end.
pub(super) const CONDENSED_CG_GOAL: f64 = 1e-6;
/// The curvature is dropped when a direction keeps less than this share of its stiffness: the energy is not convex there.
pub(super) const CONDENSED_CONVEX: f64 = 1e-3;
/// Relative rise of the condensed energy after which an iteration is repeated with half the step.
pub(super) const CONDENSED_RISE: f64 = 1e-9;
/// Largest number of updates of the multipliers in one condensed solve.
pub(super) const CONDENSED_MULTIPLIER_UPDATES: usize = 6;
/// Gaps and penetrations are reduced below this share of the tolerance.
pub(super) const CONDENSED_GAP_SHARE: f64 = 0.8;
/// Motion of bone between two condensed contact solves along a step, mm. A point that penetrates an edge deeper than this is
/// pushed out on the other face (`a_long_step_ends_where_short_ones_do_at_an_edge`).
pub(super) const TRACKING_STEP_MM: f64 = 0.25;
/// Along a step, contact has converged when no node moves farther than this, mm.
pub(super) const TRACKING_TOLERANCE_MM: f64 = 0.05;

// Contact.

/// Penalty stiffness in units of the tissue's confined modulus over its mean thickness: a layer compressed by a third of its
/// thickness penetrates bone by about 0.01 of the thickness before the multipliers take over. The result does not depend on it
/// (`a_stiffer_contact_gives_the_same_answer`).
pub(super) const CONTACT_STIFFNESS: f64 = 30.0;
/// Contact points evaluated by one task.
pub(super) const CONTACT_POINTS_PER_TASK: usize = 64;
/// Contact points farther from a body than this do not limit the substep, mm.
pub(super) const CONTACT_REACH_MM: f64 = 10.0;
/// Shorter paths cannot pass through bone, mm; longer ones are sampled in steps of this length.
pub(super) const PASSAGE_SAMPLE_MM: f64 = 0.2;
/// Samples of a path may lie inside bone by this share of their distance.
pub(super) const PASSAGE_DEPTH_SHARE: f64 = 0.25;
/// When bone moves no farther than this in a substep, mm, and tissue still passes through, the bone is too thin to hold it. When
/// it moves farther, the substep is shortened (`tissue_does_not_pass_through_thin_bone`).
pub(super) const PASSAGE_MOTION_MM: f64 = 0.25;
/// Cosine between two normals below which the body pushes the other way: over a rim the normal turns by a right angle.
pub(super) const OPPOSITE_COSINE: f64 = -0.3;
/// Offsets from the middle of a path, in path lengths, at which a detour round a rim is tried
/// (`a_path_round_a_rim_is_distinguished_from_one_through_bone`).
pub(super) const DETOURS: [f64; 3] = [0.25, 0.5, 1.0];
/// Length of the sum of two unit normals below which they have no common outward direction.
pub(super) const LEAST_NORMAL_SUM: f64 = 0.1;
/// Largest number of steps in the search for the surface from a point inside.
pub(super) const OVERLAP_STEPS: usize = 100;
/// Shortest of these steps, mm (`overlap_within_thin_bone_is_pushed_towards_the_tissue`).
pub(super) const OVERLAP_STEP_MM: f64 = 0.01;
/// The surface counts as the one on the tissue's side up to this many depths of the point.
pub(super) const OVERLAP_SEARCH_DEPTHS: f64 = 3.0;

// Springs.

/// Stiffness of gliding in units of that of contact: tissue that bone pulls by a quarter of its thickness moves off it by less
/// than a hundredth of a millimetre before multipliers are needed (`gliding_on_a_plane_is_held_along_the_normal_and_free_along_it`).
pub(super) const SPRING_STIFFNESS: f64 = 10.0;
/// Nodes with springs evaluated by one task.
pub(super) const SPRINGS_PER_TASK: usize = 64;
/// Iterations that bring a gliding node back to its distance: each squares the error, which begins below a tenth of the radius.
pub(super) const RETRACTIONS: usize = 4;
/// Radius over which the distance from bone is averaged for gliding, in element sizes: tissue cannot follow relief finer than its
/// elements, such as the gaps between teeth, and Newton's method would have to climb every bump.
pub(super) const SMOOTHING: f64 = 1.0;
/// Share of a node's stiffness from the elements that the curvature of the body it glides on may take away in a tangent.
pub(super) const BEND_SHARE: f64 = 0.3;
/// Largest share to which a gliding node is tied: its hold is then a hundred times as stiff as the tissue, so that it moves by a
/// hundredth of the slip.
pub(super) const TIED_SHARE: f64 = 0.99;
/// Updates after which gliding nodes are no longer let go in one equilibrium.
pub(super) const MAX_PULL_OFFS: usize = 10;

// Contact of tissue with tissue.

/// Penalty stiffness in units of the tissue's confined modulus over its element size. The result hardly depends on it: lips
/// pressed to 0.01 MPa penetrate each other by a few micrometres before the multipliers take over.
pub(super) const FACING_STIFFNESS: f64 = 100.0;
/// A triangle carries the square of this number of points. Fewer do not resolve the shape functions of the other side
/// (`a_uniform_pressure_passes_through_unlike_meshes`).
pub(super) const FACING_POINTS_PER_EDGE: usize = 4;
/// Triangles can touch when the cosine between their normals is below this: the sides of an opened slit, seen past its end, do
/// not.
pub(super) const FACING_COSINE: f64 = 0.0;
/// The corners of a triangle may lie deeper than its points by about this factor
/// (`lips_close_open_and_slide_without_overlap_and_in_balance`: up to 3.5); on sharp ridges by more
/// (`a_groove_closes_on_its_shoulders`).
pub(super) const DEPTH_BETWEEN_POINTS: f64 = 2.0;
/// Largest stiffness with which an edge or corner holds a point aside, in units of the contact stiffness.
pub(super) const STIFFEST_EDGE: f64 = 10.0;
/// Nearer than this to an edge or corner, mm, the direction to it is rounding.
pub(super) const COINCIDENT_MM: f64 = 1e-9;
/// Triangles of facing tissue evaluated by one task.
pub(super) const FACING_TRIANGLES_PER_TASK: usize = 16;
/// Held nodes of a mesh with facing tissue move at most this far in one substep, mm: tissue that penetrates deeper than
/// [`NEAR_MM`] is no longer found.
pub(super) const MAX_FACING_MOTION_MM: f64 = 2.0;

// Substeps.

/// Smaller motions of a segment along an axis in which its nodes are held are rounding, mm.
pub(super) const HELD_TOLERANCE_MM: f64 = 1e-9;
/// A substep may exceed [`MAX_CONTACT_MOTION_MM`] by this factor: a step of twice the limit is not cut in three.
pub(super) const CONTACT_MOTION_MARGIN: f64 = 1.01;
/// Largest number of times that a substep is solved again without contact at points that would pass to the other side of bone.
pub(super) const MAX_RELEASES: usize = 6;
/// Wasted iterations after which a step fails. A step that advances so slowly seldom converges, and the reason helps the caller
/// more than waiting.
pub(super) const MAX_WASTED: usize = 90;
/// Shortened substeps after which a step fails, for the same reason.
pub(super) const MAX_HALVINGS: usize = 24;

// Linear systems.

/// Iterations with an older factor beyond which a new one is cheaper: a factorisation costs about as much as 15 solves.
pub(super) const MAX_WITH_OLD: usize = 12;
/// Iterations that an older factor may cost in total beyond those of a new one. It equals the cost of a factorisation (27
/// iterations on 153 657 unknowns): waiting until the loss equals the price costs at most twice the optimum known in hindsight.
pub(super) const MAX_EXTRA_ITERATIONS: usize = 27;
/// Iterations with a new factor beyond which single precision counts as too coarse for the matrix.
pub(super) const MAX_WITH_NEW: usize = 25;
/// Iterations after which the rate of convergence is extrapolated to the limit.
pub(super) const ITERATIONS_FOR_RATE: usize = 3;
/// Largest number of iterations of relaxation.
pub(super) const MAX_RELAXATIONS: usize = 20_000;
/// Relative tolerance of relaxation: block Jacobi gives a poor estimate of the remaining error.
pub(super) const RELAXATION_TOLERANCE: f64 = 1e-9;
/// Nodes whose compliance is computed together: smaller groups spare nodes with late rows the work of the early ones.
pub(super) const COMPLIANCE_GROUP: usize = 32;
/// Nodes of a contact point on bone: terms of tissue on tissue have more.
pub(super) const POINT_NODES: usize = 3;
/// With more terms than this for each node, contact of tissue with tissue is corrected by nodes: its triangles carry many points,
/// and a Cholesky factor of all their terms would cost more than one of their nodes' unknowns.
pub(super) const TERMS_PER_NODE: usize = 2;
/// Unknowns above which faer splits its dense work in two. The split is fixed, so that the bits do not depend on the number of
/// threads (`any_number_of_threads_gives_the_same_bits`).
pub(super) const PARALLEL_FROM: usize = 3000;
/// Subtrees of the elimination tree are divided until none holds more than this share of the factor's entries
/// (`solves_agree_with_faer_and_do_not_depend_on_threads` in `triangular.rs`).
pub(super) const LARGEST_SUBTREE: f64 = 1.0 / 8.0;
/// Rows below a supernode's diagonal block from which its work is shared by two threads.
pub(super) const SHARED_ROWS: usize = 1024;

// Assembly.

/// Generalised nodes whose forces are summed by one task.
pub(super) const NODES_PER_TASK: usize = 256;
/// Elements whose material is tested for ellipticity in one task: a fraction of a millisecond.
pub(super) const ELEMENTS_PER_TASK: usize = 256;
/// Parts of the matrix that are filled in parallel.
pub(super) const MATRIX_PARTS: usize = 8;
/// Values of element matrices held at once: about 16 MB.
pub(super) const BUFFERED_VALUES: usize = 1 << 21;

// C1 surface at rest; `gentle_skin_is_left_alone_and_sharp_creases_are_mended` in `element/rest_shape.rs` shows their effect.

/// A normal is tilted when its cosine with a triangle's normal is below this.
pub(super) const LEAST_COSINE: f64 = 0.3;
/// Smallest Jacobian determinant accepted at a quadrature point, relative to the smallest one of the linear wedge at the same
/// points.
pub(super) const LEAST_JACOBIAN: f64 = 0.05;
/// Factor by which rest tangents are shortened.
pub(super) const SHORTER_TANGENT: f64 = 0.8;
/// Largest number of times: much shorter tangents would make stiff, narrow bends.
pub(super) const TANGENT_ROUNDS: usize = 8;
/// Cosine below which a tangent is at right angles to an axis; above 1 minus this it is along the axis.
pub(super) const ALIGNED: f64 = 1e-6;

// Thresholds of warnings.

/// Poisson ratio above which standard linear elements are reported as too stiff. At 0.49, cells of 4 mm over a patch that is
/// moved by 4 mm are 0.8 to 1.1 mm off (`prosopon bench stability`); at 0.499 the tip of Cook's membrane moves a third of the
/// correct distance (`cooks_membrane_bends_as_in_other_solvers_and_does_not_lock_when_smoothed`).
pub(super) const LOCKED_POISSON: f64 = 0.48;
/// Up to this ratio, the paper's of skin and fat, that is a note: the error is that of the default. Beyond it the error grows to
/// 1.1 mm (P95) at 0.4999, and someone should look.
pub(super) const USUAL_POISSON: f64 = 0.4901;
/// The same limit for smoothed elements: at 0.4999 that scene is 0.5 mm off; at 0.49 it is 0.3 mm off, which is the error of the
/// mesh.
pub(super) const LOCKED_POISSON_SMOOTHED: f64 = 0.4995;
/// Range of shear moduli, MPa, outside which the unit is probably wrong: soft tissues of the face have small-strain shear moduli
/// of 0.3 kPa (fat) to 1 MPa (skin along its fibres).
pub(super) const EXPECTED_SHEAR_MPA: [f64; 2] = [1e-5, 30.0];
/// Strain that a linear model may neglect before a warning. The neglected strain is half the square of the largest stretch of
/// `F - I`: 0.02 for a rotation by 11.5° or a stretch of 0.2
/// (`too_large_rotations_of_a_linear_model_and_locking_elements_are_reported`).
pub(super) const LEFT_OUT_STRAIN: f64 = 0.02;
/// Share of the tissue that may exceed it.
pub(super) const LEFT_OUT_SHARE: f64 = 0.01;
/// Volume ratio below which an element is reported: soft tissue is nearly incompressible.
pub(super) const SQUEEZED: f64 = 0.3;
/// Shortened substeps in one step up to which the report only states them: a quarter of [`MAX_HALVINGS`].
pub(super) const FEW_HALVINGS: usize = 6;
/// Smallest overlap at rest that is reported, mm.
pub(super) const REPORTED_OVERLAP_MM: f64 = 0.1;
/// Deeper overlap at rest should be looked at, mm.
pub(super) const DEEP_OVERLAP_MM: f64 = 2.0;
/// Smaller depths of free tissue in bone are attributed to the mesh and ignored, mm.
pub(super) const IGNORED_DEPTH_MM: f64 = 0.05;
/// Smaller depths of free tissue in bone are not reported, mm: about the gap that an edge of a mesh leaves open.
pub(super) const REPORTED_DEPTH_MM: f64 = 0.5;
/// Free tissue deeper in bone should be looked at, mm: it is 1.5 mm on the default plan of the phantom, 2.7 mm on that of `ct_head`.
pub(super) const DEEP_FREE_TISSUE_MM: f64 = 2.0;

/// Tetrahedra of a patch: about one volume constraint for each node of the lattice, which has 6 to 12 tetrahedra a node. On
/// Cook's membrane over a body-centred lattice, small strain, patches of 6 are 1 % stiffer and patches of 12 fill the factor by
/// 5 % more.
pub(super) const PATCH_SIZE: usize = 8;
/// Largest number of tetrahedra of a patch that takes in a small neighbour.
pub(super) const PATCH_MOST: usize = 12;
/// Share of the isochoric energy of tetrahedra that is taken at a patch's mean strain: Cook's membrane at Poisson ratios 0.45,
/// 0.49 and 0.499 is then 2 % too stiff (`cooks_membrane_does_not_lock_with_patches`).
pub(super) const PATCH_SHARE: f64 = 0.85;
/// Bulk modulus that goes with the rest of that energy, in shear moduli (a Poisson ratio of 0.35). An isochoric energy alone
/// loses its stiffness at large stretch in modes that a mean does not see: a bar would stop at 80 % of its path
/// (`patches_go_as_far_as_plain_elements_when_stretched_and_bent`).
pub(super) const PATCH_BULK: f64 = 3.0;
