use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use prosopon_contract::ErrorDocument;

/// A signed error map: statistics and, on request, the value of every vertex.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct CompareView {
    /// Statistics of the error.
    #[serde(flatten)]
    pub content: ErrorDocument,
    /// Signed error of every prediction vertex, mm; `null` for vertices that do not count.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub values_mm: Option<Vec<Option<f32>>>,
    /// Distance of every prediction vertex from its counterpart, mm.
    ///
    /// Present if both surfaces have the same triangles.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub correspondence_mm: Option<Vec<Option<f32>>>,
}

/// A signed error map with the value of every vertex.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ErrorView {
    /// Statistics of the error.
    #[serde(flatten)]
    pub content: ErrorDocument,
    /// Signed error of every vertex of the deformed skin, mm; `null` for vertices without an error.
    pub values_mm: Vec<Option<f32>>,
    /// Distance of every vertex from its counterpart, mm.
    ///
    /// Present if the error was computed on demand against a surface with the same triangles.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub correspondence_mm: Option<Vec<Option<f32>>>,
}

/// Replaces values that are not finite by `None`, since JSON has no NaN.
pub(in crate::http) fn finite(values: Vec<f32>) -> Vec<Option<f32>> {
    values.into_iter().map(|v| v.is_finite().then_some(v)).collect()
}
