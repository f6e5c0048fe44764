use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::motion_parts;
use prosopon_planning::evaluate::Registration;

/// Rigid motion of the prediction onto the reference, and how well it fits.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct RegistrationDocument {
    /// Always 1.
    pub t: f64,
    /// Translation of the point at the origin, mm.
    pub translation_mm: [f64; 3],
    /// Rotation, unit quaternion x, y, z, w.
    pub quaternion_xyzw: [f64; 4],
    /// Angle of the rotation.
    #[serde(default)]
    pub angle_deg: f64,
    /// What the registration went by: `given`, `unmoved` (what the plan does not move), or `all` (trimmed).
    #[serde(default)]
    pub region: String,
    /// Vertices of that region.
    #[serde(default)]
    pub vertices: usize,
    /// Iterations.
    #[serde(default)]
    pub iterations: usize,
    /// Root mean square distance of the pairs that count, mm.
    #[serde(default)]
    pub residual_mm: f64,
    /// Median distance of all pairs of the region, mm.
    #[serde(default)]
    pub median_mm: f64,
    /// Share of the region's area whose pairs count, 0 to 1.
    #[serde(default)]
    pub overlap: f64,
    /// How firmly the region's shape holds the motion, 0 (it slides) to 1.
    #[serde(default)]
    pub stiffness: f64,
}

impl RegistrationDocument {
    /// The document of a registration that went by `region`.
    #[must_use]
    pub fn new(r: &Registration, region: &str) -> Self {
        let (translation_mm, quaternion_xyzw) = motion_parts(&r.motion);
        Self {
            t: 1.0,
            translation_mm,
            quaternion_xyzw,
            angle_deg: r.motion.rotation.angle().to_degrees(),
            region: region.to_owned(),
            vertices: r.vertices,
            iterations: r.iterations,
            residual_mm: r.residual_mm,
            median_mm: r.median_mm,
            overlap: r.overlap,
            stiffness: r.stiffness,
        }
    }
}
