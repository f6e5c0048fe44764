use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::bounds::BoxDocument;
use super::check::{Check, REACH_MM};
use prosopon_geometry::Point;
use prosopon_planning::evaluate::MaskRegion;

/// A region of space: a box (`min_mm` and `max_mm`) or a ball (`centre_mm` and `radius_mm`).
#[derive(Debug, Clone, Copy, Default, PartialEq, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct RegionRequest {
    /// Smallest coordinates of a box, LPS mm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub min_mm: Option<[f64; 3]>,
    /// Largest coordinates of a box, LPS mm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max_mm: Option<[f64; 3]>,
    /// Centre of a ball, LPS mm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub centre_mm: Option<[f64; 3]>,
    /// Radius of a ball, mm, at least 0.1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub radius_mm: Option<f64>,
}

impl RegionRequest {
    /// The part of space; reports a fault at `pointer` and gives `None` when it is neither a box nor a ball.
    pub fn part(&self, pointer: &str, check: &mut Check) -> Option<MaskRegion> {
        match (self.min_mm, self.max_mm, self.centre_mm, self.radius_mm) {
            (Some(min_mm), Some(max_mm), None, None) => {
                Some(MaskRegion::Box((&check.bounds(pointer, BoxDocument { min_mm, max_mm })).into()))
            }
            (None, None, Some(centre), Some(radius_mm)) => {
                let centre = Point::from(check.vector(&format!("{pointer}/centre_mm"), centre));
                check.number(&format!("{pointer}/radius_mm"), radius_mm, 0.1, REACH_MM);
                Some(MaskRegion::Ball { centre, radius_mm })
            }
            _ => {
                check.fault(pointer, "must have min_mm and max_mm, or centre_mm and radius_mm");
                None
            }
        }
    }
}
