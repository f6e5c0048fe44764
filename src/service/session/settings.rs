use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use prosopon_field::{EnvelopeSettings, FieldSettings, Method, MethodSettings, Tolerance};
use prosopon_geometry::{Aabb, Point};
use prosopon_planning::simulate::{FieldsSettings, TissueSettings};
use prosopon_tissue::mesh::MeshSettings;

/// Method of building a distance field.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum FieldMethod {
    /// Bricks of quadratic splines near the surface, coarse bricks elsewhere; smooth, as contact needs it.
    #[default]
    Adaptive,
    /// Octree, merged from the finest cells up (Wang 2009).
    Hybrid,
    /// Octree, divided from the root down (Frisken 2000).
    Frisken,
    /// Dense grid (Fuhrmann 2003).
    Uniform,
}

impl From<FieldMethod> for Method {
    fn from(method: FieldMethod) -> Self {
        match method {
            FieldMethod::Adaptive => Self::Adaptive,
            FieldMethod::Hybrid => Self::Hybrid,
            FieldMethod::Frisken => Self::Frisken,
            FieldMethod::Uniform => Self::Uniform,
        }
    }
}

/// Settings of the distance fields.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct FieldSettingsDocument {
    /// Method of building the fields.
    pub method: FieldMethod,
    /// Finest spacing, mm.
    pub spacing_mm: f64,
    /// Number of finest cells along the edge of the cube around each surface.
    ///
    /// Replaces `spacing_mm` when given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub resolution: Option<u32>,
    /// Tolerance of `hybrid` and `frisken`, mm; 1e-5 of the cube's edge when absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tolerance_mm: Option<f64>,
    /// Half-width of the band of full accuracy around the surface, mm.
    pub band_mm: f64,
    /// Extent of the grid beyond the surface, mm.
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
            resolution: None,
            tolerance_mm: None,
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
            field: MethodSettings {
                method: d.method.into(),
                field: FieldSettings { spacing_mm: d.spacing_mm, band_mm: d.band_mm, margin_mm: d.margin_mm },
                resolution: d.resolution,
                tolerance: d.tolerance_mm.map_or(MethodSettings::default().tolerance, Tolerance::Mm),
            },
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
    /// Edge length of the lattice, mm.
    pub edge_mm: f64,
    /// Tissue deeper than this below the skin is left out, mm.
    pub depth_mm: f64,
    /// Box to mesh; derived from the moving segments or the face when absent.
    pub region: Option<BoxDocument>,
    /// Whether depth alone separates fat from muscle, even when a CT shows the tissue.
    #[serde(default, skip_serializing_if = "is_false")]
    pub tissue_by_depth: bool,
}

fn is_false(value: &bool) -> bool {
    !value
}

impl Default for MeshSettingsDocument {
    fn default() -> Self {
        let mesh = MeshSettings::default();
        Self {
            skin_thickness_mm: mesh.skin_thickness_mm,
            edge_mm: mesh.edge_mm,
            depth_mm: mesh.depth_mm,
            region: None,
            tissue_by_depth: false,
        }
    }
}

impl From<&MeshSettingsDocument> for TissueSettings {
    fn from(d: &MeshSettingsDocument) -> Self {
        Self {
            mesh: MeshSettings { skin_thickness_mm: d.skin_thickness_mm, edge_mm: d.edge_mm, depth_mm: d.depth_mm },
            region: d.region.as_ref().map(Aabb::from),
            tissue_by_depth: d.tissue_by_depth,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_method_reaches_the_builders_and_older_records_are_read() {
        let of = |json| FieldsSettings::from(&serde_json::from_value::<FieldSettingsDocument>(json).unwrap()).field;
        let mut record = serde_json::to_value(FieldSettingsDocument::default()).unwrap();
        assert_eq!(of(record.clone()), MethodSettings::default());
        record["method"] = "hybrid".into();
        record["resolution"] = 128.into();
        record["tolerance_mm"] = 0.02.into();
        let hybrid = of(record);
        assert_eq!(
            (hybrid.method, hybrid.resolution, hybrid.tolerance),
            (Method::Hybrid, Some(128), Tolerance::Mm(0.02))
        );
    }
}
