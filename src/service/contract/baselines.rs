use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::StatisticsDocument;
use prosopon_planning::evaluate::BaselineError;

/// Error of a simple prediction on the points that count for the prediction.
///
/// Each point lies in the same part of the face and has the same weight as in the prediction's statistics. A point whose closest
/// point lies on the reference's open border does not count.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct BaselineDocument {
    /// All points that count.
    pub whole: StatisticsDocument,
    /// Points in each part of the face.
    pub regions: BTreeMap<String, StatisticsDocument>,
}

impl From<&BaselineError> for BaselineDocument {
    fn from(b: &BaselineError) -> Self {
        Self {
            whole: (&b.whole).into(),
            regions: b.regions.iter().map(|(name, s)| ((*name).to_owned(), s.into())).collect(),
        }
    }
}

/// What two simple predictions would score against the same reference, after the same registration.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct BaselinesDocument {
    /// No prediction: the skin at rest.
    pub no_prediction: Option<BaselineDocument>,
    /// 0.7 of the nearest bone: each vertex of the skin moves by 0.7 of the displacement of the closest point (at rest) of all
    /// segments, the fixed ones included, averaged over the skin with a standard deviation of 5 mm.
    pub nearest_bone: Option<BaselineDocument>,
    /// Why a value is null; absent when none is.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub missing: Option<String>,
}
