use super::{Anatomy, CutBone, Fields, SimulateError};
use crate::control::Control;
use crate::geometry::{Aabb, Implicit, Point, Vector};
use crate::mesh::{Attachment, Domain, Embedding, MeshReport, MeshSettings, MixedMesh, Region, build, embed, tie};

/// Settings of [`build_tissue`].
#[derive(Debug, Clone, PartialEq, Default)]
pub struct TissueSettings {
    /// The mesh.
    pub mesh: MeshSettings,
    /// Box to mesh, LPS mm; chosen from the moving segments or the face when `None`.
    pub region: Option<Aabb>,
}

/// The tissue of one face at rest.
#[derive(Debug)]
pub struct TissueModel {
    /// The mixed mesh; its node classes know only the uncut bone.
    pub mesh: MixedMesh,
    /// Its quality.
    pub report: MeshReport,
    /// The user's skin in the prisms' outer surface.
    pub embedding: Embedding,
}

/// How far a moved segment pulls tissue along, sideways, up and down, mm: beyond it the face stays where it is.
const REACH_MM: Vector = Vector::new(45.0, 0.0, 60.0);
/// How far behind the front of the moving bone the region still reaches, mm.
const BEHIND_FRONT_MM: f64 = 65.0;
/// A skin vertex farther than this from the prisms is not carried by them, mm.
const EMBED_REACH_MM: f64 = 2.0;

/// Meshes the tissue between skin and bone around `bone`'s segments (the front of the face when it has none).
///
/// # Errors
/// [`SimulateError::Mesh`].
pub fn build_tissue(
    anatomy: &Anatomy,
    fields: &Fields,
    bone: Option<&CutBone>,
    settings: &TissueSettings,
    control: &Control,
) -> Result<TissueModel, SimulateError> {
    let bounds = settings.region.unwrap_or_else(|| scene_box(anatomy, bone));
    let region = Region { bounds, half_spaces: Vec::new() };
    let domain = Domain {
        skin: &fields.skin,
        bone: &fields.bone_field,
        air: fields.air.as_ref().map(|a| a as &dyn Implicit),
        region: &region,
    };
    let (mesh, report) = build(&domain, &settings.mesh, &control.part(0.0, 0.95))?;
    let embedding = embed(&anatomy.skin, &mesh, EMBED_REACH_MM);
    control.report(1.0);
    Ok(TissueModel { mesh, report, embedding })
}

/// The part of the head that a plan for these segments can reach; the front half of the head without segments.
fn scene_box(anatomy: &Anatomy, bone: Option<&CutBone>) -> Aabb {
    let head = anatomy.skin.bounds().grown(5.0);
    match bone.and_then(CutBone::movable_bounds) {
        Some(moving) => {
            let mut scene = Aabb { min: moving.min - REACH_MM, max: moving.max + REACH_MM };
            scene.min.y = head.min.y;
            scene.max.y = moving.min.y + BEHIND_FRONT_MM;
            Aabb { min: scene.min.sup(&head.min), max: scene.max.inf(&head.max) }
        }
        None => Aabb { min: head.min, max: Point::new(head.max.x, head.center().y, head.max.z) },
    }
}

/// Which inner nodes are tied to bone, which slide.
#[derive(Debug, Clone, PartialEq)]
pub struct AttachmentRules {
    /// Boundary nodes nearer to bone than this at rest are tied, mm.
    pub tie_gap_mm: f64,
    /// Boxes (LPS mm) in which nodes slide instead: teeth, inside of the lips.
    pub sliding: Vec<Aabb>,
}

/// Nodes on a moving segment nearer than this to bone that stays slide: there the periosteum is stripped for the saw, and a
/// tied node would be torn, mm.
const STRIPPED_MM: f64 = 6.0;
/// Nodes on bone that stays slide up to this far from a moving segment, mm: a Le Fort I is sawn after the periosteum has been
/// lifted off the front of the maxilla up to the infraorbital foramen. Not so at the teeth below.
const STRIPPED_ABOVE_MM: f64 = 15.0;
/// Nodes this near to a saw line, between moving bone and bone that stays, touch nothing, mm: about an edge of the mesh cannot
/// resolve contact with the sharp rims of a cut, and Newton's method creeps where single nodes slip off them.
const SEAM_MM: f64 = 4.0;
/// Nodes on the mesh's inner cut nearer than this to a moving segment are freed, so that it does not push against a wall
/// that is not there, mm.
const FREE_CUT_MM: f64 = 20.0;
/// Height of the tooth crowns above and below the lower border of an upper jaw segment, mm.
const CROWN_MM: f64 = 9.0;

impl AttachmentRules {
    /// The default rule: tissue is tied to bone wherever it touches it, but slides on the teeth around the lower border of
    /// each of the segments `moving`.
    #[must_use]
    pub fn standard(bone: &CutBone, moving: &[u32]) -> Self {
        let teeth = |b: Aabb| Aabb {
            min: Point::new(b.min.x - CROWN_MM, b.min.y - CROWN_MM, b.min.z - CROWN_MM),
            max: Point::new(b.max.x + CROWN_MM, b.max.y + CROWN_MM, b.min.z + CROWN_MM),
        };
        let segments = bone.osteotomy.segments.iter().filter(|s| moving.contains(&s.id));
        Self { tie_gap_mm: 1.5, sliding: segments.map(|s| teeth(s.surface.bounds())).collect() }
    }
}

/// Node classes for one osteotomy: `moving` are the segments that the plan moves.
pub(super) fn attach(mesh: &mut MixedMesh, bone: &CutBone, moving: &[u32], rules: &AttachmentRules) -> Vec<String> {
    let solids = bone.solids();
    tie(mesh, &solids, rules.tie_gap_mm, &rules.sliding);
    let nearest = |p: &Point, moves: bool| {
        let chosen = solids.iter().filter(|(id, _)| moving.contains(id) == moves);
        chosen.map(|(_, solid)| solid.value(p)).fold(f64::INFINITY, f64::min)
    };
    let mut stripped = 0;
    for (node, p) in mesh.positions.iter().enumerate() {
        let reach = match mesh.attachment[node] {
            Attachment::Tied(segment) if moving.contains(&segment) => nearest(p, false) < STRIPPED_MM,
            Attachment::Tied(_) if rules.sliding.iter().any(|teeth| p.z < teeth.max.z) => {
                nearest(p, true) < STRIPPED_MM
            }
            Attachment::Tied(_) => nearest(p, true) < STRIPPED_ABOVE_MM,
            Attachment::Free | Attachment::Sliding | Attachment::Fixed => false,
        };
        if reach {
            mesh.attachment[node] = Attachment::Sliding;
            stripped += 1;
        }
    }
    let mut seam = 0;
    for (node, p) in mesh.positions.iter().enumerate() {
        if mesh.attachment[node] == Attachment::Sliding && nearest(p, true).max(nearest(p, false)) < SEAM_MM {
            mesh.attachment[node] = Attachment::Free;
            seam += 1;
        }
    }
    let mut freed = 0;
    for &node in &mesh.depth_cut_nodes {
        let node = node as usize;
        if mesh.attachment[node] == Attachment::Fixed && nearest(&mesh.positions[node], true) < FREE_CUT_MM {
            mesh.attachment[node] = Attachment::Free;
            freed += 1;
        }
    }
    let mut notes = Vec::new();
    if stripped > 0 {
        notes.push(format!(
            "{stripped} nodes slide instead of being tied where periosteum is stripped: within {STRIPPED_MM} mm of a saw line on the \
             moved bone, {STRIPPED_ABOVE_MM} mm on the bone that stays"
        ));
    }
    if seam > 0 {
        notes.push(format!(
            "{seam} nodes within {SEAM_MM} mm of a saw line are free: contact with the rims of the cuts is not modelled"
        ));
    }
    if freed > 0 {
        notes.push(format!("{freed} nodes of the inner cut within {FREE_CUT_MM} mm of moving bone are free"));
    }
    notes
}
