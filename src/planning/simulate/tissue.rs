use super::cartilage::place_cartilage;
use super::globes::{Globe, Known, Reach, WithGlobes, not_placed, place_globes};
use super::mouth::{Face, Mouth, find, not_parted};
use super::tuning::{BEHIND_BACK_MM, BEHIND_FRONT_MM, EMBED_REACH_MM, MOUTH_ROOM_MM, REGION_REACH_MM, REGION_SLACK_MM};
use super::{Anatomy, CutBone, Fields, SimulateError};
use crate::plan::{DentalArch, propose};
use prosopon_geometry::control::Control;
use prosopon_geometry::{Aabb, Implicit, Motion, Point, TriMesh, Warning};
use prosopon_tissue::mesh::{
    Domain, Embedding, MeshError, MeshReport, MeshSettings, MixedMesh, PartedSkin, Region, Slit, build_parted, embed,
    embed_parted, part_skin,
};

/// Settings of [`build_tissue`].
#[derive(Debug, Clone, PartialEq)]
pub struct TissueSettings {
    /// Edge lengths and layers of the mesh.
    pub mesh: MeshSettings,
    /// Box to mesh, LPS mm; chosen from the moving segments or the face when `None`.
    pub region: Option<Aabb>,
    /// Distinguishes fat from muscle by depth alone, also where CT values are known.
    pub tissue_by_depth: bool,
    /// Whether the lips part, and where.
    pub mouth: Mouth,
    /// Places cartilage in the nose by its landmarks.
    ///
    /// Off by default: the alae that it places turn the tip up further (see the tests of `cartilage.rs`).
    pub cartilage: bool,
    /// Places the globes of the eyes where moving bone reaches them: fixed bodies over which tissue glides.
    pub globes: bool,
}

impl TissueSettings {
    /// The same settings with the places that they name moved; the region becomes the box along the axes around the moved one.
    #[must_use]
    pub fn moved(&self, motion: &Motion) -> Self {
        Self {
            region: self.region.map(|region| region.moved(motion)),
            mouth: match &self.mouth {
                Mouth::Curve(points) => Mouth::Curve(points.iter().map(|p| motion * p).collect()),
                Mouth::Glued | Mouth::Auto => self.mouth.clone(),
            },
            ..self.clone()
        }
    }
}

impl Default for TissueSettings {
    fn default() -> Self {
        Self {
            mesh: MeshSettings::default(),
            region: None,
            tissue_by_depth: false,
            mouth: Mouth::default(),
            cartilage: false,
            globes: true,
        }
    }
}

/// The tissue of one face at rest.
#[derive(Debug)]
pub struct TissueModel {
    /// The mixed mesh; its node classes are those for uncut bone.
    pub mesh: MixedMesh,
    /// Quality of the mesh.
    pub report: MeshReport,
    /// Positions of the skin's vertices ([`TissueModel::skin`]) in the prisms' outer surface.
    pub embedding: Embedding,
    /// Where the teeth are, found on the surfaces; `None` when the cuts show it or it is not found.
    pub arch: Option<DentalArch>,
    /// The oral slit; `None` where the lips are joined.
    pub slit: Option<Slit>,
    /// The globes of the eyes; none where no bone that can move reaches them.
    pub globes: Vec<Globe>,
    /// The user's skin with its triangles cut along the slit; `None` where the lips are joined.
    pub parted: Option<PartedSkin>,
}

prosopon_geometry::flat!(TissueModel { mesh, report, embedding, arch, slit, globes, parted });

impl TissueModel {
    /// The skin that moves with the tissue: the user's, or that cut along the slit.
    ///
    /// The vertices of the user's skin come first, in their order.
    #[must_use]
    pub fn skin<'a>(&'a self, anatomy: &'a Anatomy) -> &'a TriMesh {
        self.parted.as_ref().map_or(&anatomy.skin, |parted| &parted.skin)
    }
}

/// Meshes the tissue between skin and bone around the segments that can move.
///
/// Without such segments the region is the front half of the head; `settings.region` overrides both.
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
    let needs_arch = bone.is_none_or(|b| b.osteotomy.arch.is_none());
    let reach = settings.globes.then(|| orbit_reach(bone, &bounds)).filter(|reach| !reach.parts.is_empty());
    let needs_proposal = needs_arch || settings.cartilage || reach.is_some();
    let proposal = needs_proposal.then(|| propose(&anatomy.skin, &anatomy.skull));
    control.check()?;
    let (globes, of_globes) = match (&proposal, &reach) {
        (Some(proposal), Some(reach)) => place_globes(anatomy, proposal, reach, &fields.skin, &fields.bone_field),
        (_, None) | (None, _) => Default::default(),
    };
    control.check()?;
    let bone_and_globes = WithGlobes { solid: &fields.bone_field, globes };
    let domain = Domain {
        skin: &fields.skin,
        bone: &bone_and_globes,
        air: fields.air.as_ref().map(|a| a as &dyn Implicit),
        soft_tissue: anatomy.soft_tissue.as_ref().filter(|_| !settings.tissue_by_depth),
        region: &region,
    };
    let air = domain.air;
    let (skin, skull, landmarks) = (&anatomy.skin, &anatomy.skull, anatomy.landmarks.as_slice());
    let (slit, warnings) = find(&Face { skin, skull, bone: domain.bone, air, landmarks }, &settings.mouth);
    let (slit, mut found) = inside(slit, warnings, &bounds);
    control.check()?;
    let part = control.stage(0.0, 0.95);
    let (built, slit) = match (build_parted(&domain, slit.as_ref(), &settings.mesh, &part), slit) {
        (Err(error @ MeshError::Inverted { .. }), Some(_)) => {
            found = vec![not_parted(&format!("the mesh along the slit failed: {error}"))];
            (build_parted(&domain, None, &settings.mesh, &part)?, None)
        }
        (Err(error @ MeshError::Inverted { .. }), None) if !bone_and_globes.globes.is_empty() => {
            let without = TissueSettings { globes: false, ..settings.clone() };
            let mut tissue = build_tissue(anatomy, fields, bone, &without, control)?;
            tissue.report.warnings.push(not_placed(&format!("the mesh around them failed: {error}")));
            return Ok(tissue);
        }
        (built, slit) => (built?, slit),
    };
    let (mut mesh, mut report) = built;
    report.warnings.extend(found);
    report.warnings.extend(of_globes);
    let parted = slit.as_ref().and_then(|slit| part_skin(&anatomy.skin, slit));
    let embedding = match (&parted, &slit) {
        (Some(parted), Some(slit)) => embed_parted(parted, &mesh, slit, EMBED_REACH_MM),
        _ => embed(&anatomy.skin, &mesh, EMBED_REACH_MM),
    };
    if let Some(parted) = &parted {
        let new = parted.skin.positions().len() - parted.own;
        let message = format!("the skin is cut along the mouth: {new} vertices follow the {} of its own", parted.own);
        report.warnings.push(Warning::info("mouth-skin-cut", message));
    }
    control.report(1.0);
    let arch = proposal.as_ref().filter(|_| needs_arch).and_then(|p| DentalArch::proposed(&anatomy.skull, p));
    if let Some(proposal) = proposal.filter(|_| settings.cartilage) {
        let placed = place_cartilage(&mut mesh, anatomy, &proposal, &fields.skin, &settings.mesh);
        report.cartilage = placed.tetrahedra;
        report.warnings.extend(placed.warning);
    }
    Ok(TissueModel { mesh, report, embedding, arch, slit, globes: bone_and_globes.globes, parted })
}

/// What can move near the orbits, in a mesh of this region.
fn orbit_reach(bone: Option<&CutBone>, region: &Aabb) -> Reach {
    let (parts, known) = match bone {
        None => (vec![*region], Known::Nothing),
        Some(bone) if bone.osteotomy.arch.is_none() => (bone.boxes_near_orbits(|_| true), Known::Segments),
        Some(bone) => (bone.boxes_near_orbits(|_| true), Known::NearOrbits),
    };
    Reach { parts, region: *region, known }
}

/// The slit, unless it leaves the region of the mesh.
fn inside(slit: Option<Slit>, mut warnings: Vec<Warning>, region: &Aabb) -> (Option<Slit>, Vec<Warning>) {
    let room = region.grown(-MOUTH_ROOM_MM);
    let leaves = |slit: &Slit| {
        !slit
            .knots()
            .iter()
            .all(|k| (room.min.x..=room.max.x).contains(&k.front.x) && (room.min.z..=room.max.z).contains(&k.front.z))
    };
    let slit = slit.filter(|slit| {
        let is_outside = leaves(slit);
        if is_outside {
            warnings = vec![not_parted("the mouth does not lie inside the region of the mesh")];
        }
        !is_outside
    });
    (slit, warnings)
}

/// Warning when the region of a mesh built without cuts does not enclose the segments `moving`.
///
/// The skin outside the region stays at rest. `None` when the region encloses the segments.
#[must_use]
pub fn region_warning(anatomy: &Anatomy, bone: &CutBone, moving: &[u32], settings: &TissueSettings) -> Option<Warning> {
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
        let message = format!(
            "the tissue mesh was not built for this operation: its region lacks {} of the moving bone, and skin there does \
             not move",
            lacks.join(", ")
        );
        Warning::unreliable("region-lacks-bone", message).act("Build a mesh for these cuts.")
    })
}

/// Box around the tissue that a plan for these segments can move; the front half of the head without segments.
fn scene_box(anatomy: &Anatomy, bone: Option<&CutBone>) -> Aabb {
    let head = anatomy.skin.bounds().grown(5.0);
    match bone.and_then(CutBone::movable_bounds) {
        Some(moving) => {
            let mut scene = Aabb { min: moving.min - REGION_REACH_MM, max: moving.max + REGION_REACH_MM };
            scene.min.y = head.min.y;
            scene.max.y = (moving.min.y + BEHIND_FRONT_MM).max(moving.max.y + BEHIND_BACK_MM);
            Aabb { min: scene.min.sup(&head.min), max: scene.max.inf(&head.max) }
        }
        None => Aabb { min: head.min, max: Point::new(head.max.x, head.center().y, head.max.z) },
    }
}
