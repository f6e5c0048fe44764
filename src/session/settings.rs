use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::field::{EnvelopeSettings, FieldSettings};
use crate::geometry::{Aabb, Point};
use crate::mesh::MeshSettings;
use crate::simulate::{FieldsSettings, TissueSettings};

/// How a distance field is built.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum FieldMethod {
    /// Fine near the surface, coarse elsewhere.
    #[default]
    Adaptive,
    /// Not in this version.
    Hybrid,
    /// Not in this version.
    Frisken,
    /// Not in this version.
    Uniform,
}

/// Settings of the distance fields.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct FieldSettingsDocument {
    /// Method.
    pub method: FieldMethod,
    /// Finest spacing, mm.
    pub spacing_mm: f64,
    /// Half-width of the band with full accuracy, mm.
    pub band_mm: f64,
    /// How far the grid reaches beyond the surface, mm.
    pub margin_mm: f64,
    /// Grid spacing of the bone envelope, mm.
    pub envelope_spacing_mm: f64,
    /// Openings of bone narrower than twice this are closed, mm.
    pub envelope_closing_mm: f64,
}

impl Default for FieldSettingsDocument {
    fn default() -> Self {
        let (field, envelope) = (FieldSettings::default(), EnvelopeSettings::default());
        Self {
            method: FieldMethod::Adaptive,
            spacing_mm: field.spacing_mm,
            band_mm: field.band_mm,
            margin_mm: field.margin_mm,
            envelope_spacing_mm: envelope.spacing_mm,
            envelope_closing_mm: envelope.closing_mm,
        }
    }
}

impl From<&FieldSettingsDocument> for FieldsSettings {
    fn from(d: &FieldSettingsDocument) -> Self {
        Self {
            field: FieldSettings { spacing_mm: d.spacing_mm, band_mm: d.band_mm, margin_mm: d.margin_mm },
            envelope: EnvelopeSettings {
                spacing_mm: d.envelope_spacing_mm,
                closing_mm: d.envelope_closing_mm,
                ..EnvelopeSettings::default()
            },
        }
    }
}

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

/// Settings of the tissue mesh.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct MeshSettingsDocument {
    /// Thickness of the skin layer, mm.
    pub skin_thickness_mm: f64,
    /// Edge of the lattice, mm.
    pub edge_mm: f64,
    /// Tissue deeper than this below the skin is left out, mm.
    pub depth_mm: f64,
    /// Box to mesh; chosen from the moving segments or the face when absent.
    pub region: Option<BoxDocument>,
}

impl Default for MeshSettingsDocument {
    fn default() -> Self {
        let mesh = MeshSettings::default();
        Self { skin_thickness_mm: mesh.skin_thickness_mm, edge_mm: mesh.edge_mm, depth_mm: mesh.depth_mm, region: None }
    }
}

impl From<&MeshSettingsDocument> for TissueSettings {
    fn from(d: &MeshSettingsDocument) -> Self {
        Self {
            mesh: MeshSettings { skin_thickness_mm: d.skin_thickness_mm, edge_mm: d.edge_mm, depth_mm: d.depth_mm },
            region: d.region.as_ref().map(Aabb::from),
        }
    }
}
