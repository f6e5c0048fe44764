//! Tuning numbers of attachment, meshes and solves.

use prosopon_geometry::Vector;

// Anatomy.

/// Bone farther outside the skin than this is an error and not an inaccuracy, mm.
pub(super) const OUTSIDE_MM: f64 = 2.0;
/// Share of vertices on the wrong side above which the surfaces cannot belong together.
pub(super) const REFUSED_SHARE: f64 = 0.3;

/// Spacing of the fields for ties and contact, in units of that for skin and bone: the cut bone comes from a lattice of similar
/// spacing, and on the rounded edges of a coarser field Newton's method needs two thirds of the iterations.
pub(super) const CONTACT_SPACING: f64 = 2.0;

// Region of the mesh.

/// Distance around the moving segments within which tissue follows them, along x, y and z, mm; beyond it the face stays at rest.
pub(super) const REGION_REACH_MM: Vector = Vector::new(45.0, 0.0, 60.0);
/// How far behind the front of the moving bone the region still reaches, mm.
pub(super) const BEHIND_FRONT_MM: f64 = 65.0;
/// Least distance that the region reaches behind the back of the moving bone, mm: bone that is set back must meet tissue there,
/// not a wall.
pub(super) const BEHIND_BACK_MM: f64 = 7.0;
/// Moving bone may extend beyond the region by this without a warning, mm: about an edge of the mesh.
pub(super) const REGION_SLACK_MM: f64 = 5.0;
/// A skin vertex farther than this from the prisms does not move with them, mm.
pub(super) const EMBED_REACH_MM: f64 = 2.0;

/// The mouth lies at least this far inside the region when lips are parted, mm: the tissue that is opened for meshing.
pub(super) const MOUTH_ROOM_MM: f64 = 10.0;

// Cartilage of the nose. Shapes are simple and come from anatomy, not from any result of a solve.

/// Thickness of the septum, mm: septal cartilage is 2 to 3 mm thick between its mucosae.
pub(super) const SEPTUM_MM: f64 = 2.5;
/// Share of an edge of the mesh by which the septum is thicker on each side: a quarter makes the plate about an edge thick, so
/// that the tetrahedra in it hang together.
pub(super) const SEPTUM_EDGE_SHARE: f64 = 0.25;
/// Distance of the septum's front angle from the tip of the nose, mm: skin, fat and the alar domes lie between.
pub(super) const BEHIND_TIP_MM: f64 = 8.0;
/// Depth of the septum behind the line from the nasal bones to the nasal spine, mm; farther behind the septum is bone.
pub(super) const BEHIND_APERTURE_MM: f64 = 8.0;
/// Gap between the septum and the anterior nasal spine, mm: a Le Fort I parts the septum from the maxilla and shortens it. A
/// septum on the spine would be a lever that turns the tip up when the jaw goes forward.
pub(super) const ABOVE_SPINE_MM: f64 = 5.0;
/// Depth below the skin layer in which alar cartilage lies, mm: the plate is about 1 mm thick under 1 to 2 mm of fat.
pub(super) const ALAR_DEPTH_MM: f64 = 3.5;
/// Extent of the alae in units of the distance from the tip of the nose to the subnasale, about 20 mm in adults: half of the
/// nose's width (35 mm), back behind the subnasale and up above the tip; all three are estimates.
pub(super) const ALAR_HALF_WIDTH: f64 = 0.85;
pub(super) const ALAR_BACK: f64 = 0.3;
pub(super) const ALAR_UP: f64 = 0.4;
/// Least and largest distance from the tip of the nose to the subnasale that is believed, mm.
pub(super) const NOSE_PROJECTION_MM: [f64; 2] = [8.0, 40.0];
/// Least length of the line from the anterior nasal spine to the nasal bones that is believed, mm.
pub(super) const APERTURE_MM: f64 = 12.0;
/// Least cosine between the normal of the septum and the head's x axis: beyond 25 degrees the landmarks cannot be right.
pub(super) const MIDPLANE_COSINE: f64 = 0.9;

// Globes.

/// Radius of a globe, mm: emmetropic eyes are 24 mm wide and long (Bekerman et al., J Ophthalmol 2014, 503645).
pub(super) const GLOBE_RADIUS_MM: f64 = 12.0;
/// Distance of its centre medially from the lateral rim at the frontozygomatic suture, mm: the rims are 97 mm apart, the pupils
/// 62 mm. It lies no farther back: a cornea stands 16 mm in front of the lateral rim, which at its height lies some
/// 4 mm behind the suture (Migliori and Gladstone, Am J Ophthalmol 98, 1984).
pub(super) const GLOBE_FROM_RIM_MM: f64 = 17.5;
/// Its height above the orbit's lowest point, as a share of that of the suture: half of an orbit of 35 mm against three quarters.
pub(super) const GLOBE_HEIGHT_SHARE: f64 = 0.67;
/// Least thickness of a closed lid, mm.
pub(super) const LID_MM: f64 = 3.0;
/// A globe is moved back below its lid by at most this, mm; beyond that the landmarks cannot be right.
pub(super) const MAX_SUNK_MM: f64 = 8.0;
/// Depth of bone inside a globe that is believed, mm: landmarks and thin walls of orbits are not known better.
pub(super) const GLOBE_BONE_MM: f64 = 4.0;
/// Globes that differ more in height or depth are reported, mm: orbits of one face differ by 1 to 3 mm.
pub(super) const UNEVEN_MM: f64 = 5.0;
/// Moving bone may come this much deeper into a globe than at rest before it is reported, mm: globes are placed no better.
pub(super) const PRESSED_MM: f64 = 1.0;
/// Least height of the lateral rim above the lowest point of the orbit that is believed, and the greatest distance upwards and
/// aside, mm.
pub(super) const LATERAL_RIM_MM: [f64; 2] = [12.0, 45.0];
/// Height of the orbits' lowest points above the occlusal plane, mm, rather less than usual.
pub(super) const ORBITS_ABOVE_TEETH_MM: f64 = 45.0;
/// The same above the anterior nasal spine, mm.
pub(super) const ORBITS_ABOVE_ANS_MM: f64 = 25.0;

// Attachment.

/// Gap at rest below which nodes are tied by default, mm.
pub(super) const TIE_GAP_MM: f64 = 1.5;
/// Height of teeth and gum above and below the occlusal plane, mm: crowns of 9 to 10.5 mm (Wheeler's Dental Anatomy) and 3.5 to
/// 4.5 mm of attached gingiva at the incisors (Bowers, J Periodontol 34, 1963).
pub(super) const TEETH_AND_GUM_MM: f64 = 13.0;
/// Width of the zone beside a saw line in which the periosteum is stripped, mm. An incision in the vestibule and a saw need about
/// 10 to 15 mm of bare bone.
pub(super) const STRIPPED_MM: f64 = 12.0;
/// The same zone on fixed bone above a moving upper jaw, mm: a Le Fort I is sawn after the periosteum has been lifted off the
/// front of the maxilla up to the infraorbital foramen.
pub(super) const STRIPPED_ABOVE_MM: f64 = 15.0;
/// Width over which gliding turns into being tied at the border of a zone, mm: an edge of the default mesh, so that a millimetre
/// more or less of distance does not move a node from one class to the other.
pub(super) const BLEND_MM: f64 = 4.0;
/// Vertices of a segment nearer than this to another segment lie on the cut between them, beside half the kerf, mm: the surfaces
/// are that accurate at their rims.
pub(super) const ON_CUT_MM: f64 = 1.0;
/// Nodes this near to a saw line are free by default, mm, about an edge of the mesh: the mesh cannot resolve the sharp rims of a
/// cut, and Newton's method converges slowly where single nodes slip off them.
pub(super) const SEAM_MM: f64 = 4.0;
/// Fixed nodes where the mesh ends in depth are freed within this distance of a moving segment, mm, so that it does not push
/// against a wall that is not there.
pub(super) const FREE_CUT_MM: f64 = 20.0;
/// Length of the tissue beyond the mesh's ends, mm: about the distance from the chin's lower border to the hyoid, and from the
/// cheek to the ear.
pub(super) const BEYOND_MM: f64 = 40.0;
/// Ends farther than this from moving bone stay fixed, mm: tissue there hardly moves.
pub(super) const BEYOND_REACH_MM: f64 = 60.0;
/// A node farther than this from every vertex of the skull takes no class from it, mm.
pub(super) const PAINT_REACH_MM: f64 = 5.0;

// Tissue that is left out.

/// Samples of a path from which the largest displacement of bone is taken.
pub(super) const PATH_INSTANTS: usize = 32;
/// Sliding nodes nearer than this to a moving segment are taken to move as far as it does, mm.
pub(super) const PUSHED_MM: f64 = 3.0;
/// Stiffness of an incompressible sheet in tension, in units of its shear modulus.
pub(super) const SHEET_STIFFNESS: f64 = 4.0;
/// Tolerance of the estimate as a share of the bone's displacement.
pub(super) const REACH_ERROR: f64 = 1e-5;
/// Most iterations of conjugate gradients; an estimate that has not converged by then is too small only where it is small.
pub(super) const MAX_REACH_ITERATIONS: usize = 1000;

/// Displacement beside left-out tissue above which there is a warning, in units of `leave_out_below_mm`.
pub(super) const WARN_BORDER: f64 = 5.0;
/// Upper limit of that threshold, mm.
pub(super) const WARN_BORDER_MM: f64 = 0.25;
/// Share of the progress for setting up the equations.
pub(super) const SETUP_SHARE: f64 = 0.03;

// Skin.

/// Most sweeps of the smoothing; holes are about ten vertices wide.
pub(super) const MAX_SWEEPS: usize = 200;
/// Sweeps end when no vertex moves farther than this, mm.
pub(super) const CONVERGED_MM: f64 = 1e-4;
/// Share of the region's skin vertices on no prism from which the skin should be checked: folds and nostrils have less.
pub(super) const MAX_OFF_PRISMS_SHARE: f64 = 0.05;
/// Displacement beside left-out tissue above which the result should be checked, mm: about a third of a voxel, which is the
/// accuracy of the skin.
pub(super) const MAX_BORDER_MM: f64 = 0.5;

// Scenes.

/// Depth of a held point inside bone above which there is a warning, mm.
pub(super) const HELD_INSIDE_MM: f64 = 0.5;
