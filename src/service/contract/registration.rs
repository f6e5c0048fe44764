use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::motion_parts;
use prosopon_planning::evaluate::Registration;

/// Rigid motion of the prediction onto the reference, with the quality of the fit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct RegistrationDocument {
    /// Always 1.
    pub t: f64,
    /// Translation of the point at the origin, mm.
    pub translation_mm: [f64; 3],
    /// Rotation, unit quaternion x, y, z, w.
    pub quaternion_xyzw: [f64; 4],
    /// Angle of the rotation, degrees.
    #[serde(default)]
    pub angle_deg: f64,
    /// Vertices that the registration used: `given`, `unmoved` or `all`.
    ///
    /// `unmoved` are those that the plan does not move; `all` are trimmed.
    #[serde(default)]
    pub region: String,
    /// Number of vertices of that region.
    #[serde(default)]
    pub vertices: usize,
    /// Number of iterations.
    #[serde(default)]
    pub iterations: usize,
    /// Root mean square distance of the pairs that were kept, mm.
    #[serde(default)]
    pub residual_mm: f64,
    /// Median distance of all pairs of the region, mm.
    #[serde(default)]
    pub median_mm: f64,
    /// Share of the region's area whose pairs were kept, 0 to 1.
    #[serde(default)]
    pub overlap: f64,
    /// How well the shape of the region determines the motion, from 0 (it can slide) to 1.
    #[serde(default)]
    pub stiffness: f64,
}

impl RegistrationDocument {
    /// The document of a registration that used the vertices `region`.
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
