use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use prosopon_geometry::{Aabb, Point};

/// An axis-aligned box, LPS mm.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct BoxDocument {
    /// Smallest coordinates.
    pub min_mm: [f64; 3],
    /// Largest coordinates.
    pub max_mm: [f64; 3],
}

impl From<&BoxDocument> for Aabb {
    fn from(b: &BoxDocument) -> Self {
        Self { min: Point::from(b.min_mm), max: Point::from(b.max_mm) }
    }
}
