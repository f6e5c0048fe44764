use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::warning::Findings;
use super::{BaselinesDocument, RegistrationDocument, StatisticsDocument};
use prosopon_planning::evaluate::{ErrorMap, Statistics};

/// One bar of a histogram.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct HistogramBin {
    /// Lower edge, mm; the first bar includes all smaller values, the last all larger ones.
    pub from_mm: f64,
    /// Share of area, 0 to 1.
    pub share: f64,
}

/// Statistics of a signed error map; negative values lie behind the reference.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ErrorDocument {
    /// Reference: `target`, `job <id> step <k>`, or the name in the request.
    pub reference: String,
    /// Models of the prediction and of the reference, when the reference is a prediction too.
    ///
    /// The values are then a difference between two models and not a measure of accuracy.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub models: Option<[String; 2]>,
    /// Vertices that count: `face` (inside the regions), `all`, or `given`.
    pub mask: String,
    /// Prediction against reference.
    pub whole: StatisticsDocument,
    /// Reference against prediction.
    pub backward: StatisticsDocument,
    /// Prediction against reference in each part of the face.
    pub regions: BTreeMap<String, StatisticsDocument>,
    /// Reference against prediction in each part of the face.
    #[serde(default)]
    pub backward_regions: BTreeMap<String, StatisticsDocument>,
    /// `whole` after averaging the signed values over neighbourhoods of 5 mm; absent in old records.
    ///
    /// Noise of a scan adds to every distance and is averaged out, as is detail finer than that.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub smoothed: Option<StatisticsDocument>,
    /// Root mean square of what the averaging removes, mm: noise and detail.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub roughness_mm: Option<f64>,
    /// Distance of each vertex from its counterpart, when both surfaces have the same triangles.
    ///
    /// It includes the error along the surface, which the distance to the closest point does not.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub correspondence: Option<StatisticsDocument>,
    /// Number of vertices in the mask that lie beyond the open border of the reference and do not count.
    #[serde(default)]
    pub excluded: usize,
    /// Distribution of the signed error.
    pub histogram: Vec<HistogramBin>,
    /// Registration before the comparison; absent when there was none.
    pub registration: Option<RegistrationDocument>,
    /// What no prediction and 0.7 of the nearest bone would score on the same points.
    ///
    /// Absent in old records and for the steps of a job before its last.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub baselines: Option<BaselinesDocument>,
    /// Warnings and notes.
    #[serde(flatten)]
    pub findings: Findings,
}

impl ErrorDocument {
    /// The document of a map.
    #[must_use]
    pub fn new(reference: String, mask: &str, map: &ErrorMap) -> Self {
        let by_name = |regions: &[(&'static str, Statistics)]| {
            regions.iter().map(|(name, s)| ((*name).to_owned(), s.into())).collect::<BTreeMap<_, _>>()
        };
        Self {
            reference,
            models: None,
            mask: mask.to_owned(),
            whole: StatisticsDocument::from(&map.whole),
            backward: StatisticsDocument::from(&map.backward),
            regions: by_name(&map.regions),
            backward_regions: by_name(&map.backward_regions),
            smoothed: Some(StatisticsDocument::from(&map.smoothed)),
            roughness_mm: Some(map.roughness_mm),
            correspondence: map.correspondence.as_ref().map(|c| StatisticsDocument::from(&c.whole)),
            excluded: map.excluded,
            histogram: map.histogram.iter().map(|&(from_mm, share)| HistogramBin { from_mm, share }).collect(),
            registration: None,
            baselines: None,
            findings: map.warnings.iter().cloned().collect(),
        }
    }

    /// Title of a picture of the values.
    #[must_use]
    pub fn title(&self) -> String {
        match &self.models {
            Some([model, other]) if model == other => format!("Difference between two predictions, both {model}"),
            Some([model, other]) => format!("Difference between two models: {model} against {other}"),
            None if self.reference == "target" => "Signed error against target".to_owned(),
            None => "Signed difference from the reference".to_owned(),
        }
    }

    /// Names and values of the main statistics.
    #[must_use]
    pub fn lines(&self) -> Vec<(String, String)> {
        let signed = |v: f64| format!("{v:+.2} mm");
        let size = |v: f64| format!("{v:.2} mm");
        let share = |v: f64| format!("{:.1} %", 100.0 * v);
        let w = &self.whole;
        let mut lines = vec![
            ("mean (signed)", signed(w.mean_mm)),
            ("mean (absolute)", size(w.mean_abs_mm)),
            ("root mean square", size(w.rms_mm)),
            ("P50", size(w.p50_mm)),
            ("P90", size(w.p90_mm)),
            ("P95", size(w.p95_mm)),
            ("largest", size(w.max_mm)),
            ("L2 norm", size(w.l2_norm_mm)),
            ("below 1 mm", share(w.share_below_1_mm)),
            ("below 2 mm", share(w.share_below_2_mm)),
            ("below 3 mm", share(w.share_below_3_mm)),
            ("reference to prediction", size(self.backward.mean_abs_mm)),
        ];
        if let Some(r) = &self.registration {
            lines.push(("registration residual", size(r.residual_mm)));
            lines.push(("registration overlap", share(r.overlap)));
        }
        lines.into_iter().map(|(name, value)| (name.to_owned(), value)).collect()
    }

    /// Names and errors of the prediction and of the baselines that are known, for the regions and for all points that count.
    ///
    /// Each row has the region and, for the prediction, no prediction and 0.7 of the nearest bone, the statistics if known.
    #[must_use]
    pub fn beside_baselines(&self) -> Vec<(&str, [Option<&StatisticsDocument>; 3])> {
        let Some(baselines) = &self.baselines else { return Vec::new() };
        let both = [&baselines.no_prediction, &baselines.nearest_bone].map(Option::as_ref);
        if both.iter().all(Option::is_none) {
            return Vec::new();
        }
        let [none, bone] = both;
        let whole = ("counted", [Some(&self.whole), none.map(|b| &b.whole), bone.map(|b| &b.whole)]);
        let rows = self.regions.iter().map(|(name, s)| {
            (name.as_str(), [Some(s), none.and_then(|b| b.regions.get(name)), bone.and_then(|b| b.regions.get(name))])
        });
        std::iter::once(whole).chain(rows).collect()
    }
}
