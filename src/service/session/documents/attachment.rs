use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use prosopon_geometry::{Aabb, Point};
use prosopon_planning::evaluate::Part;
use prosopon_planning::simulate::{Attached, NodeClass, Paint};

/// What a node of the tissue at bone does: `tied` (moves with the nearest bone), `sliding` (on bone), `free` (touches nothing).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum NodeClassName {
    /// Moves with the nearest bone.
    Tied,
    /// Slides on bone.
    Sliding,
    /// Touches nothing.
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

/// A class painted on the nodes at bone in a box (`min_mm` and `max_mm`) or a ball (`centre_mm` and `radius_mm`), LPS mm.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PaintDocument {
    /// The class.
    pub class: NodeClassName,
    /// Smallest coordinates of a box …
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub min_mm: Option<[f64; 3]>,
    /// … and largest.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max_mm: Option<[f64; 3]>,
    /// Centre of a ball …
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub centre_mm: Option<[f64; 3]>,
    /// … and radius, above 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub radius_mm: Option<f64>,
}

impl PaintDocument {
    /// The painting; `None` when it is neither a box with its corners in order nor a ball.
    #[must_use]
    pub fn paint(&self) -> Option<Paint> {
        let part = match (self.min_mm, self.max_mm, self.centre_mm, self.radius_mm) {
            (Some(min), Some(max), None, None) if min.iter().zip(max).all(|(min, max)| *min < max) => {
                Part::Box(Aabb { min: min.into(), max: max.into() })
            }
            (None, None, Some(centre), Some(radius_mm)) if radius_mm > 0.0 => {
                Part::Ball { centre: Point::from(centre), radius_mm }
            }
            _ => return None,
        };
        Some(Paint { class: self.class.into(), part })
    }
}

/// How many nodes of the tissue mesh did what.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, ToSchema)]
pub struct AttachedDocument {
    /// Nodes tied to each segment; segment 0 stays.
    pub tied_nodes: BTreeMap<u32, usize>,
    /// Nodes that slid on bone.
    pub sliding_nodes: usize,
    /// Nodes at bone that touched nothing.
    pub free_nodes_at_bone: usize,
    /// Nodes held at the mesh's cuts.
    pub fixed_nodes: usize,
    /// Of all these, nodes whose class was painted.
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
