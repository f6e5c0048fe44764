use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::WaypointDocument;
use crate::evaluate::{ErrorMap, Statistics};
use crate::session::motion_parts;

/// Statistics of signed values, mm, weighted by area.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct StatisticsDocument {
    /// Vertices counted.
    pub count: usize,
    /// Signed mean.
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
    /// Share of area below 1 mm, 0 to 1.
    pub share_below_1_mm: f64,
    /// Share of area below 2 mm.
    pub share_below_2_mm: f64,
    /// Share of area below 3 mm.
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

/// One bar of a histogram.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct HistogramBin {
    /// Lower edge, mm; the first bar takes all below, the last all above.
    pub from_mm: f64,
    /// Share of area, 0 to 1.
    pub share: f64,
}

/// A signed error map without its values: negative where the prediction lies behind the reference.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ErrorDocument {
    /// What the prediction is compared with: `target`, or `job <id> step <k>`, or as asked for.
    pub reference: String,
    /// Which vertices count: `face` (inside the regions) or `all`.
    pub mask: String,
    /// Prediction against reference.
    pub whole: StatisticsDocument,
    /// Reference against prediction.
    pub backward: StatisticsDocument,
    /// Prediction against reference in each part of the face.
    pub regions: BTreeMap<String, StatisticsDocument>,
    /// Distribution of the signed error.
    pub histogram: Vec<HistogramBin>,
    /// Motion applied to the prediction before comparing (`t` is 1); absent when none was.
    pub registration: Option<WaypointDocument>,
}

impl ErrorDocument {
    /// The document of a map.
    #[must_use]
    pub fn new(reference: String, mask: &str, map: &ErrorMap) -> Self {
        let (translation_mm, quaternion_xyzw) = motion_parts(&map.registration);
        let moved = map.registration != crate::geometry::Motion::identity();
        Self {
            reference,
            mask: mask.to_owned(),
            whole: StatisticsDocument::from(&map.whole),
            backward: StatisticsDocument::from(&map.backward),
            regions: map.regions.iter().map(|(name, s)| ((*name).to_owned(), s.into())).collect(),
            histogram: map.histogram.iter().map(|&(from_mm, share)| HistogramBin { from_mm, share }).collect(),
            registration: moved.then_some(WaypointDocument { t: 1.0, translation_mm, quaternion_xyzw }),
        }
    }
}
