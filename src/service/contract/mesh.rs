use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use uuid::Uuid;

use super::bounds::BoxDocument;
use super::check::Check;
use super::cut::CutDocument;
use super::fault::Fault;
use super::warning::Findings;
use prosopon_geometry::{Aabb, Point};
use prosopon_planning::simulate::{Mouth, TissueSettings};
use prosopon_tissue::mesh::{MeshReport, MeshSettings};

/// Width of the curve between the lips, mm; adults have 40 to 60 mm between the corners of the mouth.
const MOUTH_WIDTH_MM: [f64; 2] = [10.0, 100.0];
/// Most points of the curve between the lips.
const MAX_CURVE_POINTS: usize = 200;

/// Whether the lips part, and where.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum MouthDocument {
    /// The lips are joined.
    #[default]
    Glued,
    /// The lips part along the crease between them, if it is found.
    Auto,
    /// The lips part along this curve on the skin, from one corner of the mouth to the other: 3 to 200 points, LPS mm.
    Curve(Vec<[f64; 3]>),
}

impl MouthDocument {
    fn is_default(&self) -> bool {
        *self == Self::default()
    }

    fn check(&self, check: &mut Check) {
        let Self::Curve(points) = self else { return };
        for (index, p) in points.iter().enumerate() {
            check.vector(&format!("/mouth/curve/{index}"), *p);
        }
        if !(3..=MAX_CURVE_POINTS).contains(&points.len()) {
            check.fault("/mouth/curve", format!("has {} points, allowed are 3 to {MAX_CURVE_POINTS}", points.len()));
        }
        let width_mm = points.first().zip(points.last()).map_or(0.0, |(a, b)| (b[0] - a[0]).abs());
        let [least, most] = MOUTH_WIDTH_MM;
        if points.len() > 2 && width_mm.is_finite() && !(least..=most).contains(&width_mm) {
            let what = format!("is {width_mm:.3} wide, allowed are {least} to {most} mm; coordinates are in mm");
            check.fault("/mouth/curve", what);
        }
        let rises = points.windows(2).all(|w| w[1][0] > w[0][0]);
        let falls = points.windows(2).all(|w| w[1][0] < w[0][0]);
        if !rises && !falls {
            check.fault(
                "/mouth/curve",
                "must run from one corner of the mouth to the other, x always rising or falling",
            );
        }
    }
}

impl From<&MouthDocument> for Mouth {
    fn from(mouth: &MouthDocument) -> Self {
        match mouth {
            MouthDocument::Glued => Self::Glued,
            MouthDocument::Auto => Self::Auto,
            MouthDocument::Curve(points) => Self::Curve(points.iter().copied().map(Point::from).collect()),
        }
    }
}

/// Request for a tissue mesh, which is also kept with the mesh; absent members take their defaults.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct MeshRequest {
    /// Thickness of the skin layer, mm, 0.1 to 10; 1.5 by default.
    pub skin_thickness_mm: f64,
    /// Edge length of the lattice, mm, 0.5 to 20; 4 by default.
    pub edge_mm: f64,
    /// Depth below the skin beyond which tissue is left out, mm, at least `skin_thickness_mm` plus two edges, at most 200.
    pub depth_mm: f64,
    /// Box to mesh; when absent it is chosen from the segments of `osteotomy`, or else it is the front of the face.
    ///
    /// In a head that lies turned in the scanner, the box along the head's own axes that holds it is meshed, which is larger.
    pub region: Option<BoxDocument>,
    /// Whether depth alone separates fat from muscle even when a CT could; muscle is then the 40 % next to bone.
    #[serde(skip_serializing_if = "is_false")]
    pub tissue_by_depth: bool,
    /// Whether the lips part: `glued` (default), `auto`, or `{"curve": [[x, y, z], …]}`, mm.
    #[serde(skip_serializing_if = "MouthDocument::is_default")]
    pub mouth: MouthDocument,
    /// Whether the nose has cartilage, placed by its landmarks; false by default.
    #[serde(skip_serializing_if = "is_false")]
    pub cartilage: bool,
    /// Whether the globes of the eyes stay where moving bone reaches them, placed by the landmarks `orbitale_*` and
    /// `frontomalare_*`; true by default. A mesh without `osteotomy` has them wherever it reaches them.
    #[serde(skip_serializing_if = "is_true")]
    pub globes: bool,
    /// Id of the osteotomy whose segments will move.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub osteotomy: Option<Uuid>,
}

fn is_false(value: &bool) -> bool {
    !value
}

fn is_true(value: &bool) -> bool {
    *value
}

impl Default for MeshRequest {
    fn default() -> Self {
        let MeshSettings { skin_thickness_mm, edge_mm, depth_mm, .. } = MeshSettings::default();
        Self {
            skin_thickness_mm,
            edge_mm,
            depth_mm,
            region: None,
            tissue_by_depth: false,
            mouth: MouthDocument::Glued,
            cartilage: false,
            globes: true,
            osteotomy: None,
        }
    }
}

impl MeshRequest {
    /// The request, checked.
    ///
    /// # Errors
    /// A fault that lists every value that is not allowed.
    pub fn checked(self) -> Result<Self, Fault> {
        let mut check = Check::default();
        let skin_thickness_mm = check.number("/skin_thickness_mm", self.skin_thickness_mm, 0.1, 10.0);
        let edge_mm = check.number("/edge_mm", self.edge_mm, 0.5, 20.0);
        let least = MeshSettings { skin_thickness_mm, edge_mm, ..MeshSettings::default() }.least_depth_mm();
        check.number("/depth_mm", self.depth_mm, least, 200.0);
        if let Some(region) = self.region {
            check.bounds("/region", region);
        }
        self.mouth.check(&mut check);
        check.finish()?;
        Ok(self)
    }

    /// Whether both give the same mesh for the same cuts.
    #[must_use]
    pub fn meshes_like(&self, other: &Self) -> bool {
        Self { osteotomy: None, ..self.clone() } == Self { osteotomy: None, ..other.clone() }
    }
}

impl From<&MeshRequest> for TissueSettings {
    fn from(r: &MeshRequest) -> Self {
        Self {
            mesh: MeshSettings { skin_thickness_mm: r.skin_thickness_mm, edge_mm: r.edge_mm, depth_mm: r.depth_mm },
            region: r.region.as_ref().map(Aabb::from),
            tissue_by_depth: r.tissue_by_depth,
            mouth: (&r.mouth).into(),
            cartilage: r.cartilage,
            globes: r.globes,
        }
    }
}

/// Report of the tissue mesh of a session.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct MeshDocument {
    /// Settings that the mesh was built with.
    pub settings: MeshRequest,
    /// Osteotomy whose segments determined the region.
    ///
    /// Absent when the region is the front of the face or a box.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub osteotomy: Option<String>,
    /// Cuts of the osteotomy; only in the stored form.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cuts: Option<Vec<CutDocument>>,
    /// Number of tetrahedra.
    pub tetrahedra: usize,
    /// Number of prisms.
    pub prisms: usize,
    /// Number of nodes.
    pub nodes: usize,
    /// Number of inverted elements.
    pub inverted: usize,
    /// Smallest dihedral angle of a tetrahedron, degrees.
    pub min_dihedral_deg: f64,
    /// Largest dihedral angle of a tetrahedron, degrees.
    pub max_dihedral_deg: f64,
    /// Smallest scaled Jacobian of a prism, 0 to 1.
    pub min_scaled_jacobian: f64,
    /// Relative difference of the mesh's volume from that of the domain.
    pub volume_error: f64,
    /// Largest distance of a prism's outer vertex or barycentre from the skin, mm.
    pub max_skin_distance_mm: f64,
    /// Number of outer edges with more than two boundary faces.
    pub non_manifold_edges: usize,
    /// Share of muscle in the volume below the skin layer before cartilage is placed, 0 to 1; the rest is fat.
    #[serde(default)]
    pub muscle_share: f64,
    /// Number of tetrahedra of nasal cartilage.
    #[serde(default)]
    pub cartilage: usize,
    /// Whether the CT separated fat from muscle; otherwise depth did.
    #[serde(default)]
    pub tissue_from_ct: bool,
    /// Warnings and notes.
    #[serde(flatten)]
    pub findings: Findings,
}

impl MeshDocument {
    /// The document of a mesh without its cuts.
    #[must_use]
    pub fn new(settings: MeshRequest, osteotomy: Option<String>, r: &MeshReport) -> Self {
        Self {
            settings,
            osteotomy,
            cuts: None,
            tetrahedra: r.tetrahedra,
            prisms: r.prisms,
            nodes: r.nodes,
            inverted: r.inverted,
            min_dihedral_deg: r.min_dihedral_deg,
            max_dihedral_deg: r.max_dihedral_deg,
            min_scaled_jacobian: r.min_scaled_jacobian,
            volume_error: r.volume_error,
            max_skin_distance_mm: r.max_skin_distance_mm,
            non_manifold_edges: r.nonmanifold_edges,
            muscle_share: r.muscle_share,
            cartilage: r.cartilage,
            tissue_from_ct: r.tissue_from_ct,
            findings: r.warnings.iter().cloned().collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mouth_has_three_forms_and_no_form_changes_a_request_without_it() {
        let read = |text: &str| serde_json::from_str::<MeshRequest>(text);
        let mouth = |text: &str| read(text).map(|r| r.mouth).ok();
        assert_eq!(mouth(r#"{"mouth": "glued"}"#), Some(MouthDocument::Glued));
        assert_eq!(mouth(r#"{"mouth": "auto"}"#), Some(MouthDocument::Auto));
        let curve = r#"{"mouth": {"curve": [[-20, -90, 1], [0, -95, 2], [20, -90, 1]]}}"#;
        let points = vec![[-20.0, -90.0, 1.0], [0.0, -95.0, 2.0], [20.0, -90.0, 1.0]];
        assert_eq!(mouth(curve), Some(MouthDocument::Curve(points)));
        assert_eq!(mouth(r#"{"mouth": "open"}"#), None);
        assert!(!serde_json::to_string(&MeshRequest::default()).is_ok_and(|text| text.contains("mouth")));
        assert!(read(curve).is_ok_and(|r| r.checked().is_ok()));
    }

    #[test]
    fn a_curve_that_turns_back_or_is_too_short_is_refused() {
        let pointers = |points: Vec<[f64; 3]>| {
            let request = MeshRequest { mouth: MouthDocument::Curve(points), ..MeshRequest::default() };
            let faults = request.checked().map_or_else(|fault| fault.errors, |_| Vec::new());
            faults.into_iter().map(|f| f.pointer).collect::<Vec<_>>()
        };
        assert_eq!(pointers(vec![[0.0; 3], [9.0, 0.0, 0.0]]), ["/mouth/curve"]);
        assert_eq!(pointers(vec![[0.0; 3], [20.0, 0.0, 0.0], [18.0, 0.0, 0.0]]), ["/mouth/curve"]);
        // Metres.
        assert_eq!(pointers(vec![[0.0; 3], [0.025, 0.0, 0.0], [0.05, 0.0, 0.0]]), ["/mouth/curve"]);
        assert_eq!(pointers(vec![[0.0; 3], [9.0, 2e4, 0.0], [18.0, 0.0, 0.0]]), ["/mouth/curve/1/1"]);
        assert_eq!(pointers(vec![[18.0, 0.0, 0.0], [9.0, 0.0, 0.0], [0.0; 3]]), Vec::<String>::new());
    }
}
