use super::{Anatomy, CutBone, Fields, SimulateError};
use prosopon_geometry::control::Control;
use prosopon_geometry::{Aabb, Implicit, Point, Vector};
use prosopon_tissue::mesh::{Domain, Embedding, MeshReport, MeshSettings, MixedMesh, Region, build, embed};

/// Settings of [`build_tissue`].
#[derive(Debug, Clone, PartialEq, Default)]
pub struct TissueSettings {
    /// The mesh.
    pub mesh: MeshSettings,
    /// Box to mesh, LPS mm; chosen from the moving segments or the face when `None`.
    pub region: Option<Aabb>,
    /// Tells fat from muscle by depth alone, also where a CT tells.
    pub tissue_by_depth: bool,
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
/// How far behind its back the region reaches at least, mm: bone that is set back must find tissue there, no wall.
const BEHIND_BACK_MM: f64 = 7.0;
/// Bone may stick out of a region by so much, mm: about an edge of the mesh.
const REGION_SLACK_MM: f64 = 5.0;
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
        soft_tissue: anatomy.soft_tissue.as_ref().filter(|_| !settings.tissue_by_depth),
        region: &region,
    };
    let (mesh, report) = build(&domain, &settings.mesh, &control.stage(0.0, 0.95))?;
    let embedding = embed(&anatomy.skin, &mesh, EMBED_REACH_MM);
    control.report(1.0);
    Ok(TissueModel { mesh, report, embedding })
}

/// What a region that was not chosen for the `moving` segments lacks of them: the skin there stays where it is. `None` where it has all.
#[must_use]
pub fn region_warning(anatomy: &Anatomy, bone: &CutBone, moving: &[u32], settings: &TissueSettings) -> Option<String> {
    let region = settings.region.unwrap_or_else(|| scene_box(anatomy, None));
    let segments = bone.osteotomy.segments.iter().filter(|s| moving.contains(&s.id));
    let moving = Aabb::of(segments.flat_map(|s| s.surface.positions()))?;
    let (below, above) = (region.min - moving.min, moving.max - region.max);
    let sides = [
        (below.x, "on the patient's right"),
        (above.x, "on the patient's left"),
        (below.y, "in front"),
        (above.y, "behind"),
        (below.z, "below"),
        (above.z, "above"),
    ];
    let lacks = sides.iter().filter(|(mm, _)| *mm > REGION_SLACK_MM).map(|(mm, side)| format!("{mm:.0} mm {side}"));
    let lacks: Vec<String> = lacks.collect();
    (!lacks.is_empty()).then(|| {
        format!(
            "the tissue mesh was not built for this operation: its region lacks {} of the bone that moves; skin there stays in place",
            lacks.join(", ")
        )
    })
}

/// The part of the head that a plan for these segments can reach; the front half of the head without segments.
fn scene_box(anatomy: &Anatomy, bone: Option<&CutBone>) -> Aabb {
    let head = anatomy.skin.bounds().grown(5.0);
    match bone.and_then(CutBone::movable_bounds) {
        Some(moving) => {
            let mut scene = Aabb { min: moving.min - REACH_MM, max: moving.max + REACH_MM };
            scene.min.y = head.min.y;
            scene.max.y = (moving.min.y + BEHIND_FRONT_MM).max(moving.max.y + BEHIND_BACK_MM);
            Aabb { min: scene.min.sup(&head.min), max: scene.max.inf(&head.max) }
        }
        None => Aabb { min: head.min, max: Point::new(head.max.x, head.center().y, head.max.z) },
    }
}
