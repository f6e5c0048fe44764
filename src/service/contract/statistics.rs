use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use prosopon_planning::evaluate::Statistics;

/// Statistics of signed values, mm.
///
/// Each vertex is weighted by its area (a third of the triangles around it), except in `count`, `max_mm` and `l2_norm_mm`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct StatisticsDocument {
    /// Number of vertices.
    pub count: usize,
    /// Mean of the signed values.
    pub mean_mm: f64,
    /// Mean of absolute values.
    pub mean_abs_mm: f64,
    /// Root mean square.
    pub rms_mm: f64,
    /// Median of absolute values.
    pub p50_mm: f64,
    /// 90th percentile of absolute values.
    pub p90_mm: f64,
    /// 95th percentile of absolute values.
    pub p95_mm: f64,
    /// Largest absolute value.
    pub max_mm: f64,
    /// Square root of the sum of squares over the vertices, not weighted (Wang 2009, Figure 18).
    pub l2_norm_mm: f64,
    /// Variance of the signed values, mm².
    pub variance_mm2: f64,
    /// Share of area with an absolute value below 1 mm, 0 to 1.
    pub share_below_1_mm: f64,
    /// Share of area with an absolute value below 2 mm, 0 to 1.
    pub share_below_2_mm: f64,
    /// Share of area with an absolute value below 3 mm, 0 to 1.
    pub share_below_3_mm: f64,
}

impl From<&Statistics> for StatisticsDocument {
    fn from(s: &Statistics) -> Self {
        let [share_below_1_mm, share_below_2_mm, share_below_3_mm] = s.share_below;
        Self {
            count: s.count,
            mean_mm: s.mean,
            mean_abs_mm: s.mean_abs,
            rms_mm: s.rms,
            p50_mm: s.p50,
            p90_mm: s.p90,
            p95_mm: s.p95,
            max_mm: s.max,
            l2_norm_mm: s.l2_norm,
            variance_mm2: s.variance,
            share_below_1_mm,
            share_below_2_mm,
            share_below_3_mm,
        }
    }
}
