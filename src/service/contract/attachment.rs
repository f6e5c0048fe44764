use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::bounds::BoxDocument;
use super::check::Check;
use super::fault::{Fault, FaultKind};
use super::region::RegionRequest;
use prosopon_geometry::TriMesh;
use prosopon_planning::evaluate::MaskRegion;
use prosopon_planning::simulate::{Attached, AttachmentRules, Beyond, NodeClass, Paint, SkullPaint};

/// Boundary condition of a tissue node at bone: `tied`, `gliding`, `sliding` or `free`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum NodeClassName {
    /// The node moves with the nearest bone.
    Tied,
    /// The node is held to the bone's surface and moves freely along it, as mucosa on teeth.
    Gliding,
    /// The node slides on bone: bone pushes it and does not pull it.
    Sliding,
    /// The node has no contact.
    Free,
}

impl From<NodeClassName> for NodeClass {
    fn from(name: NodeClassName) -> Self {
        match name {
            NodeClassName::Tied => Self::Tied,
            NodeClassName::Gliding => Self::Gliding,
            NodeClassName::Sliding => Self::Sliding,
            NodeClassName::Free => Self::Free,
        }
    }
}

/// What lies beyond the mesh where it ends inside tissue.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum BeyondName {
    /// A wall: the mesh's ends are fixed.
    Wall,
    /// Tissue: springs as stiff as 40 mm of muscle draw the ends within 60 mm of moving bone to their places at rest.
    Tissue,
}

impl From<BeyondName> for Beyond {
    fn from(name: BeyondName) -> Self {
        match name {
            BeyondName::Wall => Self::Wall,
            BeyondName::Tissue => Self::Tissue,
        }
    }
}

/// A class for all nodes at bone in a box or a ball, LPS mm.
///
/// A box has `min_mm` and `max_mm`, a ball `centre_mm` and `radius_mm`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PaintDocument {
    /// The class of the nodes.
    pub class: NodeClassName,
    /// Smallest coordinates of a box, mm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub min_mm: Option<[f64; 3]>,
    /// Largest coordinates of a box, mm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max_mm: Option<[f64; 3]>,
    /// Centre of a ball, mm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub centre_mm: Option<[f64; 3]>,
    /// Radius of a ball, mm; above 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub radius_mm: Option<f64>,
}

impl PaintDocument {
    /// The painted part of space; `None` when it is neither a box with its corners in order nor a ball.
    #[must_use]
    pub fn paint(&self) -> Option<Paint> {
        let part = self.region().part("", &mut Check::default())?;
        Some(Paint { class: self.class.into(), part })
    }

    fn region(&self) -> RegionRequest {
        let Self { class: _, min_mm, max_mm, centre_mm, radius_mm } = *self;
        RegionRequest { min_mm, max_mm, centre_mm, radius_mm }
    }
}

/// Attachment of tissue nodes to bone: tied, gliding, sliding or free.
///
/// Absent members follow the default rule: nodes at bone are tied; they glide on teeth and gum and where periosteum is stripped
/// for the saw; they are free beside saw lines. At the borders of these zones gliding turns into being tied over 4 mm. The
/// report's `attached` counts the nodes of each class.
#[derive(Debug, Clone, Default, PartialEq, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Attachment {
    /// Boundary nodes closer to bone than this distance are tied, mm, 0 to 50.
    ///
    /// Chosen by the default rule when absent.
    #[serde(default)]
    pub tie_gap_mm: Option<f64>,
    /// Class of nodes at teeth and gum, of jaws that move and of jaws that stay; `gliding` when absent.
    ///
    /// The teeth are found by the landmark `occlusal_plane_z_mm`, else by the templates' cuts, else on the surfaces.
    #[serde(default)]
    pub mucosa: Option<NodeClassName>,
    /// Boxes that replace the zone of teeth and gum, LPS mm.
    #[serde(default)]
    pub sliding: Option<Vec<BoxDocument>>,
    /// Class of nodes on stripped bone; `gliding` when absent.
    #[serde(default)]
    pub stripped: Option<NodeClassName>,
    /// Width of stripped bone beside a saw line, mm, 0 to 50; 12, and 15 above a moving upper jaw, when absent.
    ///
    /// 0: no bone is stripped, and nodes beside saw lines are not freed.
    #[serde(default)]
    pub stripped_mm: Option<f64>,
    /// Class of nodes within 4 mm of a saw line; `free` when absent.
    #[serde(default)]
    pub saw_line: Option<NodeClassName>,
    /// Pull at which gliding tissue comes off bone, kPa, 0 to 1000; it never does when absent.
    ///
    /// Tissue that has come off is still pushed.
    #[serde(default)]
    pub pull_off_kpa: Option<f64>,
    /// What lies beyond the mesh where it ends inside tissue; `tissue` when absent.
    #[serde(default)]
    pub beyond: Option<BeyondName>,
    /// At most 1000 boxes and balls that override the rule for the nodes inside.
    ///
    /// Where several contain a node, the last one applies.
    #[serde(default)]
    pub paint: Vec<PaintDocument>,
    /// One class or `null` per skull vertex, in the vertex order of `GET …/skull`.
    ///
    /// A node takes the class of the nearest skull vertex within 5 mm. `paint` overrides it.
    #[serde(default)]
    pub skull_classes: Option<Vec<Option<NodeClassName>>>,
}

impl Attachment {
    /// Reports every value that is not allowed.
    pub(super) fn check(&self, check: &mut Check) {
        if let Some(gap) = self.tie_gap_mm {
            check.number("/attachment/tie_gap_mm", gap, 0.0, 50.0);
        }
        if let Some(width) = self.stripped_mm {
            check.number("/attachment/stripped_mm", width, 0.0, 50.0);
        }
        if let Some(pull) = self.pull_off_kpa {
            check.number("/attachment/pull_off_kpa", pull, 0.0, 1000.0);
        }
        for (i, bounds) in self.sliding.iter().flatten().enumerate() {
            check.bounds(&format!("/attachment/sliding/{i}"), *bounds);
        }
        check_paint(check, &self.paint);
    }

    /// Checks that the classes painted on the skull are as many as its vertices.
    ///
    /// # Errors
    /// [`FaultKind::InvalidRequest`] with both numbers.
    pub fn check_skull(&self, vertices: usize) -> Result<(), Fault> {
        match self.skull_classes.as_ref().map(Vec::len) {
            Some(found) if found != vertices => {
                let detail = format!(
                    "has {found} classes, but the skull has {vertices} vertices; give one class for each vertex"
                );
                Err(Fault::new(FaultKind::InvalidRequest, detail).at("/attachment/skull_classes"))
            }
            _ => Ok(()),
        }
    }

    /// The rules for the numerics.
    ///
    /// # Errors
    /// [`FaultKind::InvalidRequest`] when the number of painted vertices is not that of the `skull`.
    pub fn rules(&self, skull: &TriMesh) -> Result<AttachmentRules, Fault> {
        self.check_skull(skull.positions().len())?;
        let painted = self.skull_classes.as_ref().map(|classes| SkullPaint {
            positions: skull.positions().to_vec(),
            classes: classes.iter().map(|c| c.map(Into::into)).collect(),
        });
        let usual = AttachmentRules::default();
        let class = |name: Option<NodeClassName>, usual: NodeClass| name.map_or(usual, Into::into);
        Ok(AttachmentRules {
            tie_gap_mm: self.tie_gap_mm,
            mucosa: class(self.mucosa, usual.mucosa),
            stripped: class(self.stripped, usual.stripped),
            stripped_mm: self.stripped_mm,
            saw_line: class(self.saw_line, usual.saw_line),
            pull_off_mpa: self.pull_off_kpa.map(|kpa| 1e-3 * kpa),
            beyond: self.beyond.map_or(usual.beyond, Into::into),
            sliding: self.sliding.as_ref().map(|boxes| boxes.iter().map(|b| MaskRegion::Box(b.into())).collect()),
            skull: painted,
            paint: self.paint.iter().filter_map(PaintDocument::paint).collect(),
        })
    }
}

fn check_paint(check: &mut Check, paint: &[PaintDocument]) {
    const MOST: usize = 1000;
    if paint.len() > MOST {
        check.fault("/attachment/paint", format!("has {} parts, at most {MOST} are allowed", paint.len()));
    }
    for (i, p) in paint.iter().take(MOST).enumerate() {
        p.region().part(&format!("/attachment/paint/{i}"), check);
    }
}

/// Number of tissue nodes of each class.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, ToSchema)]
pub struct AttachedDocument {
    /// Number of nodes tied to each segment; segment 0 is fixed.
    pub tied_nodes: BTreeMap<u32, usize>,
    /// Number of nodes that slide on bone.
    pub sliding_nodes: usize,
    /// Number of nodes that glide on each segment.
    #[serde(default)]
    pub gliding_nodes: BTreeMap<u32, usize>,
    /// Number of nodes at bone without contact.
    pub free_nodes_at_bone: usize,
    /// Number of nodes fixed at the cut boundary of the mesh.
    pub fixed_nodes: usize,
    /// Number of all these nodes whose class was painted.
    pub painted_nodes: usize,
}

impl From<&Attached> for AttachedDocument {
    fn from(a: &Attached) -> Self {
        Self {
            tied_nodes: a.tied.clone(),
            sliding_nodes: a.sliding,
            gliding_nodes: a.gliding.clone(),
            free_nodes_at_bone: a.free_at_bone,
            fixed_nodes: a.fixed,
            painted_nodes: a.painted,
        }
    }
}
