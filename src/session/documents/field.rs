use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::field::FieldReport;
use crate::session::FieldSettingsDocument;

/// What one distance field is like.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct FieldQualityDocument {
    /// Bricks of 8³ cells at the finest spacing.
    pub bricks: usize,
    /// Memory, bytes.
    pub memory_bytes: usize,
    /// Largest difference from the exact distance at sampled points within the band, mm.
    pub max_error_mm: f64,
    /// RMS difference at the same points, mm.
    pub rms_error_mm: f64,
    /// Number of those points.
    pub checked_points: usize,
    /// What is wrong with the surface and how it was dealt with.
    pub warnings: Vec<String>,
}

impl From<&FieldReport> for FieldQualityDocument {
    fn from(r: &FieldReport) -> Self {
        Self {
            bricks: r.bricks,
            memory_bytes: r.bytes,
            max_error_mm: r.max_error_mm,
            rms_error_mm: r.rms_error_mm,
            checked_points: r.checked_points,
            warnings: r.warnings.clone(),
        }
    }
}

/// The distance fields of a session.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct FieldDocument {
    /// Settings that they were built with.
    pub settings: FieldSettingsDocument,
    /// Field of the skin.
    pub skin: FieldQualityDocument,
    /// Field of the bone's outer envelope.
    pub bone: FieldQualityDocument,
    /// What was repaired.
    pub warnings: Vec<String>,
}
