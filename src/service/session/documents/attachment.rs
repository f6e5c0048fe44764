use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use prosopon_geometry::{Aabb, Point};
use prosopon_planning::evaluate::MaskRegion;
use prosopon_planning::simulate::{Attached, NodeClass, Paint};

/// Boundary condition of a tissue node at bone: `tied`, `sliding` or `free`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum NodeClassName {
    /// The node moves with the nearest bone.
    Tied,
    /// The node slides on bone.
    Sliding,
    /// The node has no contact.
    Free,
}

impl From<NodeClassName> for NodeClass {
    fn from(name: NodeClassName) -> Self {
        match name {
            NodeClassName::Tied => Self::Tied,
            NodeClassName::Sliding => Self::Sliding,
            NodeClassName::Free => Self::Free,
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
        let part = match (self.min_mm, self.max_mm, self.centre_mm, self.radius_mm) {
            (Some(min), Some(max), None, None) if min.iter().zip(max).all(|(min, max)| *min < max) => {
                MaskRegion::Box(Aabb { min: min.into(), max: max.into() })
            }
            (None, None, Some(centre), Some(radius_mm)) if radius_mm > 0.0 => {
                MaskRegion::Ball { centre: Point::from(centre), radius_mm }
            }
            _ => return None,
        };
        Some(Paint { class: self.class.into(), part })
    }
}

/// Number of tissue nodes of each class.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, ToSchema)]
pub struct AttachedDocument {
    /// Number of nodes tied to each segment; segment 0 is fixed.
    pub tied_nodes: BTreeMap<u32, usize>,
    /// Number of nodes that slide on bone.
    pub sliding_nodes: usize,
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
            free_nodes_at_bone: a.free_at_bone,
            fixed_nodes: a.fixed,
            painted_nodes: a.painted,
        }
    }
}
