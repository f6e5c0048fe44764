//! How inner nodes hang on bone: tied, gliding, sliding or free, by rule, then by painting.

mod beyond;
mod zones;

pub(super) use beyond::open_ends;

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::CutBone;
use super::globes::Globe;
use super::tuning::{FREE_CUT_MM, PAINT_REACH_MM, SEAM_MM, STRIPPED_MM, TIE_GAP_MM};
use crate::evaluate::MaskRegion;
use crate::plan::DentalArch;
use prosopon_geometry::{Implicit, Motion, Point, Warning};
use prosopon_tissue::mesh::{Attachment, MixedMesh};
use zones::{InZones, Zones};

/// Attachment of a node at bone.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NodeClass {
    /// Moves with the nearest bone.
    Tied,
    /// Glides on the nearest bone: held to its surface in both normal directions, free along it.
    Gliding,
    /// Slides on bone: pushed, but not pulled.
    Sliding,
    /// Neither tied nor in contact.
    Free,
}

/// What lies beyond the mesh where it ends inside tissue.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Beyond {
    /// A wall: the ends are fixed.
    Wall,
    /// Tissue: springs as stiff as 40 mm of muscle draw the ends to their places at rest.
    Tissue,
}

/// A class for all nodes at bone in a part of space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Paint {
    /// The class.
    pub class: NodeClass,
    /// The part of space, LPS mm.
    pub part: MaskRegion,
}

/// Classes painted on the skull's vertices; a node at bone takes that of the nearest within 5 mm.
#[derive(Debug, Clone, PartialEq)]
pub struct SkullPaint {
    /// The vertices, LPS mm.
    pub positions: Vec<Point>,
    /// Class of each; `None` leaves the rule's.
    pub classes: Vec<Option<NodeClass>>,
}

/// Rules for how tissue hangs on bone.
///
/// Tissue is tied to bone wherever it touches bone, except at teeth and gum and where bone is stripped for the saw. At the
/// borders of these zones gliding turns into being tied over an edge of the mesh.
#[derive(Debug, Clone, PartialEq)]
pub struct AttachmentRules {
    /// Boundary nodes nearer to bone than this at rest are tied, mm; 1.5 when absent.
    pub tie_gap_mm: Option<f64>,
    /// Class of nodes at teeth and gum, of bone that moves and of bone that stays.
    pub mucosa: NodeClass,
    /// Parts of space that replace the zone of teeth and gum.
    pub sliding: Option<Vec<MaskRegion>>,
    /// Class of nodes on stripped bone.
    pub stripped: NodeClass,
    /// Width of stripped bone beside a saw line, mm; 0 for none; 12, and 15 above a moving upper jaw, when absent.
    pub stripped_mm: Option<f64>,
    /// Class of nodes within 4 mm of a saw line.
    pub saw_line: NodeClass,
    /// Pull at which gliding tissue comes off bone, MPa; `None` when it never does.
    pub pull_off_mpa: Option<f64>,
    /// What lies beyond the mesh where it ends inside tissue.
    pub beyond: Beyond,
    /// Classes painted on the skull; they override the rules.
    pub skull: Option<SkullPaint>,
    /// Classes for parts of space; they override all the above, and the last part that holds a node wins.
    pub paint: Vec<Paint>,
}

impl AttachmentRules {
    /// The same rules with the parts of space that they name moved.
    #[must_use]
    pub fn moved(&self, motion: &Motion) -> Self {
        let moved = |part: &MaskRegion| part.moved(motion);
        let paint = |paint: &Paint| Paint { class: paint.class, part: moved(&paint.part) };
        let skull = |painted: &SkullPaint| SkullPaint {
            positions: painted.positions.iter().map(|p| motion * p).collect(),
            classes: painted.classes.clone(),
        };
        Self {
            sliding: self.sliding.as_ref().map(|parts| parts.iter().map(moved).collect()),
            skull: self.skull.as_ref().map(skull),
            paint: self.paint.iter().map(paint).collect(),
            ..self.clone()
        }
    }
}

impl Default for AttachmentRules {
    fn default() -> Self {
        Self {
            tie_gap_mm: None,
            mucosa: NodeClass::Gliding,
            sliding: None,
            stripped: NodeClass::Gliding,
            stripped_mm: None,
            saw_line: NodeClass::Free,
            pull_off_mpa: None,
            beyond: Beyond::Tissue,
            skull: None,
            paint: Vec::new(),
        }
    }
}

/// Numbers of nodes by attachment at the start of a solve.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Attached {
    /// Nodes tied to each segment.
    pub tied: BTreeMap<u32, usize>,
    /// Nodes that slide on bone.
    pub sliding: usize,
    /// Nodes that glide on each segment.
    pub gliding: BTreeMap<u32, usize>,
    /// Nodes at bone that are free.
    pub free_at_bone: usize,
    /// Nodes fixed where the mesh ends inside the tissue.
    pub fixed: usize,
    /// Of all these, nodes that were painted.
    pub painted: usize,
}

/// What attaching a mesh to bone gives.
#[derive(Debug, Default)]
pub(super) struct AttachResult {
    pub(super) warnings: Vec<Warning>,
    pub(super) attached: Attached,
    /// Share to which each gliding node is tied; see [`prosopon_tissue::fem::Boundary::tied_share`].
    pub(super) tied_share: Vec<f64>,
}

/// Where a node on a solid lies.
enum At {
    /// On bone.
    Bone(InZones),
    /// On a globe, and whether it glides there.
    Globe(bool),
}

/// Numbers of nodes that the rules do not tie.
#[derive(Debug, Clone, Copy, Default)]
struct Released {
    teeth: usize,
    stripped: usize,
    seam: usize,
    inner: usize,
    globes: usize,
}

/// Sets the attachment of the mesh's nodes for one osteotomy; `moving` are the segments that the plan moves. `arch` is used where
/// the osteotomy does not show where the teeth are.
pub(super) fn attach(
    mesh: &mut MixedMesh,
    bone: &CutBone,
    moving: &[u32],
    arch: Option<&DentalArch>,
    rules: &AttachmentRules,
) -> AttachResult {
    let near = Nearness { solids: bone.solids(), moving };
    let arch = bone.osteotomy.arch.as_ref().or(arch);
    let zones = Zones::new(bone, moving, arch, rules.sliding.as_deref(), rules.stripped_mm);
    let mut tied_share = vec![0.0; mesh.positions.len()];
    let mut released = Released::default();
    let gap = rules.tie_gap_mm.unwrap_or(TIE_GAP_MM);
    let touching: Vec<usize> =
        (0..mesh.positions.len()).filter(|n| mesh.attachment[*n] == Attachment::Sliding).collect();
    let found: Vec<Option<(u32, At)>> = (touching.par_iter())
        .map(|node| {
            let p = &mesh.positions[*node];
            let (distance, own) = near.nearest(p)?;
            let at =
                |globe: Option<&Globe>| globe.map_or_else(|| At::Bone(zones.of(p, own)), |g| At::Globe(g.glides_at(p)));
            (distance <= gap).then(|| (own, at(bone.globe_at(p, own))))
        })
        .collect();
    for (node, found) in touching.into_iter().zip(found) {
        let Some((own, at)) = found else { continue };
        let at = match at {
            At::Bone(at) => at,
            At::Globe(glides) => {
                released.globes += usize::from(glides);
                mesh.attachment[node] = if glides { Attachment::Gliding(own) } else { Attachment::Tied(own) };
                continue;
            }
        };
        let is_seam = zones.has_saw_lines() && at.to_line_mm < SEAM_MM;
        let (class, share) = if is_seam && rules.stripped_mm != Some(0.0) {
            released.seam += 1;
            (rules.saw_line, 0.0)
        } else if at.at_teeth <= at.stripped && at.at_teeth < 1.0 {
            released.teeth += 1;
            (rules.mucosa, at.at_teeth)
        } else if at.stripped < 1.0 {
            released.stripped += 1;
            (rules.stripped, at.stripped)
        } else {
            (NodeClass::Tied, 1.0)
        };
        // Only gliding has a blend; the other classes begin in its middle.
        mesh.attachment[node] = match class {
            NodeClass::Gliding => Attachment::Gliding(own),
            NodeClass::Sliding if share < 0.5 => Attachment::Sliding,
            NodeClass::Free if share < 0.5 => Attachment::Free,
            NodeClass::Tied | NodeClass::Sliding | NodeClass::Free => Attachment::Tied(own),
        };
        tied_share[node] = if class == NodeClass::Gliding { share } else { 0.0 };
    }
    released.inner = free_inner_cut(mesh, &near);
    let mut warnings = released.warnings(rules);
    if arch.is_none() && rules.sliding.is_none() && rules.mucosa != NodeClass::Tied {
        let message = "it is not known where the teeth are: tissue is tied to them like to other bone";
        warnings.push(Warning::check("teeth-not-found", message).act("Set the landmark `occlusal_plane_z_mm`."));
    }
    let painted = painted(mesh, rules);
    if painted.is_empty() && (rules.skull.is_some() || !rules.paint.is_empty()) {
        let message = "the painted classes apply to no node: no node at bone lies where they were painted";
        warnings.push(Warning::check("paint-without-nodes", message).act("Paint where the tissue touches bone."));
    }
    for (node, class) in &painted {
        let own = near.nearest(&mesh.positions[*node]).map(|(_, own)| own);
        mesh.attachment[*node] = match (class, own) {
            (NodeClass::Tied, Some(own)) => Attachment::Tied(own),
            (NodeClass::Gliding, Some(own)) => Attachment::Gliding(own),
            (NodeClass::Sliding, _) => Attachment::Sliding,
            (NodeClass::Free, _) | (NodeClass::Tied | NodeClass::Gliding, None) => Attachment::Free,
        };
        tied_share[*node] = 0.0;
    }
    let attached = count(mesh, painted.len());
    AttachResult { warnings, attached, tied_share }
}

/// Whether a segment in `moving` ties, carries or can push a node of an attached mesh.
pub(super) fn is_moved(mesh: &MixedMesh, bone: &CutBone, moving: &[u32]) -> bool {
    let near = Nearness { solids: bone.solids(), moving };
    let is_moved = |(node, attachment): (usize, &Attachment)| match attachment {
        Attachment::Tied(segment) | Attachment::Gliding(segment) => moving.contains(segment),
        Attachment::Sliding => near.nearest(&mesh.positions[node]).is_some_and(|(_, own)| moving.contains(&own)),
        Attachment::Free | Attachment::Fixed => false,
    };
    mesh.attachment.par_iter().enumerate().any(is_moved)
}

impl Released {
    fn warnings(&self, rules: &AttachmentRules) -> Vec<Warning> {
        let how = |class: NodeClass| match class {
            NodeClass::Tied => "are tied",
            NodeClass::Gliding => "glide on bone",
            NodeClass::Sliding => "slide on bone",
            NodeClass::Free => "are free",
        };
        let stripped_mm = rules.stripped_mm.unwrap_or(STRIPPED_MM);
        let all = [
            (self.teeth, "mucosa-nodes", format!("at teeth and gum {}", how(rules.mucosa))),
            (
                self.stripped,
                "stripped-nodes",
                format!("within {stripped_mm} mm of a saw line, where periosteum is stripped, {}", how(rules.stripped)),
            ),
            (self.seam, "saw-line-nodes", format!("within {SEAM_MM} mm of a saw line {}", how(rules.saw_line))),
            (self.globes, "globe-nodes", "at the front of the globes of the eyes glide on them".to_owned()),
            (
                self.inner,
                "inner-cut-nodes",
                format!("of the inner cut within {FREE_CUT_MM} mm of moving bone are free"),
            ),
        ];
        all.into_iter()
            .filter(|(n, ..)| *n > 0)
            .map(|(n, code, what)| Warning::info(code, format!("{n} nodes {what}")))
            .collect()
    }
}

/// Distances to segments.
struct Nearness<'a> {
    solids: Vec<(u32, &'a dyn Implicit)>,
    moving: &'a [u32],
}

impl Nearness<'_> {
    /// Distance from `p` to the nearest moving segment, mm; infinite when none moves.
    fn to_moving(&self, p: &Point) -> f64 {
        let chosen = self.solids.iter().filter(|(id, _)| self.moving.contains(id));
        chosen.map(|(_, solid)| solid.value(p)).fold(f64::INFINITY, f64::min)
    }

    /// Distance to the nearest segment, mm, and its number; of equally near ones the first.
    fn nearest(&self, p: &Point) -> Option<(f64, u32)> {
        let all = self.solids.iter().map(|(id, solid)| (solid.value(p), *id));
        all.min_by(|a, b| a.0.total_cmp(&b.0))
    }
}

/// Frees fixed nodes where the mesh ends in depth near moving bone; returns their number.
fn free_inner_cut(mesh: &mut MixedMesh, near: &Nearness<'_>) -> usize {
    let mut freed = 0;
    for &node in &mesh.depth_cut_nodes {
        let node = node as usize;
        if mesh.attachment[node] == Attachment::Fixed && near.to_moving(&mesh.positions[node]) < FREE_CUT_MM {
            mesh.attachment[node] = Attachment::Free;
            freed += 1;
        }
    }
    freed
}

/// Nodes of faces on bone that are not fixed, ascending.
fn at_bone(mesh: &MixedMesh) -> Vec<usize> {
    let mut nodes: Vec<usize> = mesh.bone_faces.iter().flatten().map(|n| *n as usize).collect();
    nodes.sort_unstable();
    nodes.dedup();
    nodes.retain(|n| mesh.attachment[*n] != Attachment::Fixed);
    nodes
}

/// Painted nodes with their class, ascending.
fn painted(mesh: &MixedMesh, rules: &AttachmentRules) -> Vec<(usize, NodeClass)> {
    if rules.skull.is_none() && rules.paint.is_empty() {
        return Vec::new();
    }
    let of_skull = |p: &Point| {
        let skull = rules.skull.as_ref()?;
        let off = skull.positions.iter().map(|q| (q - p).norm_squared()).enumerate();
        let (vertex, squared) = off.min_by(|a, b| a.1.total_cmp(&b.1))?;
        if squared > PAINT_REACH_MM * PAINT_REACH_MM { None } else { *skull.classes.get(vertex)? }
    };
    let of = |node: usize| {
        let p = &mesh.positions[node];
        let part = rules.paint.iter().rev().find(|paint| paint.part.contains(p)).map(|paint| paint.class);
        Some((node, part.or_else(|| of_skull(p))?))
    };
    at_bone(mesh).into_par_iter().filter_map(of).collect()
}

fn count(mesh: &MixedMesh, painted: usize) -> Attached {
    let mut out = Attached { painted, ..Attached::default() };
    for attachment in &mesh.attachment {
        match attachment {
            Attachment::Tied(segment) => *out.tied.entry(*segment).or_insert(0) += 1,
            Attachment::Sliding => out.sliding += 1,
            Attachment::Gliding(segment) => *out.gliding.entry(*segment).or_insert(0) += 1,
            Attachment::Fixed => out.fixed += 1,
            Attachment::Free => {}
        }
    }
    out.free_at_bone = at_bone(mesh).into_iter().filter(|n| mesh.attachment[*n] == Attachment::Free).count();
    out
}

#[cfg(test)]
mod tests;
