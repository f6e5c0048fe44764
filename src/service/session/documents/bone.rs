use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::fault::{Fault, FaultKind};
use crate::motion::motion_of;
use crate::motion_parts;
use prosopon_geometry::{Point, TriMesh, Vector};
use prosopon_planning::plan::{
    self, BoundedPlane, Clearance, Cut, CutShape, Osteotomy, Path, PathReport, Plan, PlanError, Protected, Purpose,
};

/// Rectangle that bounds a cutting plane.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PlaneBoundsDocument {
    /// Direction of the rectangle's length, in the plane.
    pub direction: [f64; 3],
    /// Half extent along `direction`, mm.
    pub half_length_mm: f64,
    /// Half extent along `normal × direction`, mm.
    pub half_width_mm: f64,
}

/// A plane cut.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PlaneDocument {
    /// Centre of the rectangle, or any point of an unbounded plane, LPS mm.
    pub point_mm: [f64; 3],
    /// Normal; unit length in answers.
    pub normal: [f64; 3],
    /// Bounds; the plane is unbounded when absent.
    pub bounds: Option<PlaneBoundsDocument>,
}

impl From<&BoundedPlane> for PlaneDocument {
    fn from(p: &BoundedPlane) -> Self {
        let bounds = p.bounds.map(|(direction, half_length_mm, half_width_mm)| PlaneBoundsDocument {
            direction: direction.into(),
            half_length_mm,
            half_width_mm,
        });
        Self { point_mm: p.point.coords.into(), normal: p.normal.into(), bounds }
    }
}

impl From<&PlaneDocument> for BoundedPlane {
    /// Takes the vectors unchanged: documents hold checked planes with unit vectors.
    fn from(d: &PlaneDocument) -> Self {
        Self {
            point: Point::from(d.point_mm),
            normal: Vector::from(d.normal),
            bounds: d.bounds.map(|b| (Vector::from(b.direction), b.half_length_mm, b.half_width_mm)),
        }
    }
}

/// A line on the bone with the direction and depth of sawing.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PolylineDocument {
    /// Points of the line, 2 to 1000, LPS mm; for a cut all round, the last point equals the first.
    pub points_mm: Vec<[f64; 3]>,
    /// Direction of sawing, into the bone; any length.
    pub direction: [f64; 3],
    /// Depth of the cut from the line, mm.
    pub depth_mm: f64,
}

/// A cut by a triangle mesh, open or closed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct CutSurfaceDocument {
    /// Vertices, LPS mm.
    pub points_mm: Vec<[f64; 3]>,
    /// Triangles, each three vertex indices from 0; at most 100 000.
    pub triangles: Vec<[u32; 3]>,
}

/// A part of bone that is separate without a cut.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct FreePartDocument {
    /// A point in the part or next to it, LPS mm.
    pub point_mm: [f64; 3],
}

/// Purpose of a cut.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum PurposeDocument {
    /// Bone is sawn.
    #[default]
    Osteotomy,
    /// Bones that touch in the image (teeth, streaks of metal, joints) are separated; nothing is sawn.
    Separation,
}

/// One cut: exactly one of `plane`, `polyline`, `surface` and `free_part`.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(from = "StoredCut")]
pub struct CutDocument {
    /// A plane, bounded or unbounded.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plane: Option<PlaneDocument>,
    /// A line with a sawing direction and depth.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub polyline: Option<PolylineDocument>,
    /// Triangles.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub surface: Option<CutSurfaceDocument>,
    /// No cut: a separate part of bone becomes a segment.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub free_part: Option<FreePartDocument>,
    /// Kerf: width of the saw's slot, mm; half of it lies on each side.
    #[serde(default)]
    pub kerf_mm: f64,
    /// Name that a template gave the cut.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// Purpose of the cut.
    #[serde(default)]
    pub purpose: PurposeDocument,
    /// For a separation: a point on the side of the bone to separate, LPS mm, at any distance.
    ///
    /// Thin bridges that all separations together leave are removed too.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub part_mm: Option<[f64; 3]>,
}

/// A stored cut; earlier versions stored the plane alone.
#[derive(Deserialize)]
#[serde(untagged)]
#[expect(clippy::large_enum_variant, reason = "it lives as long as one document is read")]
enum StoredCut {
    Plane(PlaneDocument),
    Cut {
        #[serde(default)]
        plane: Option<PlaneDocument>,
        #[serde(default)]
        polyline: Option<PolylineDocument>,
        #[serde(default)]
        surface: Option<CutSurfaceDocument>,
        #[serde(default)]
        free_part: Option<FreePartDocument>,
        #[serde(default)]
        kerf_mm: f64,
        #[serde(default)]
        name: Option<String>,
        #[serde(default)]
        purpose: PurposeDocument,
        #[serde(default)]
        part_mm: Option<[f64; 3]>,
    },
}

impl From<StoredCut> for CutDocument {
    fn from(stored: StoredCut) -> Self {
        match stored {
            StoredCut::Plane(plane) => Self { plane: Some(plane), ..Self::default() },
            StoredCut::Cut { plane, polyline, surface, free_part, kerf_mm, name, purpose, part_mm } => {
                Self { plane, polyline, surface, free_part, kerf_mm, name, purpose, part_mm }
            }
        }
    }
}

impl From<&Cut> for CutDocument {
    fn from(cut: &Cut) -> Self {
        let purpose = match cut.purpose {
            Purpose::Osteotomy => PurposeDocument::Osteotomy,
            Purpose::Separation => PurposeDocument::Separation,
        };
        let part_mm = cut.part.map(|p| p.coords.into());
        let blank = Self { kerf_mm: cut.kerf_mm, name: cut.name.clone(), purpose, part_mm, ..Self::default() };
        let coordinates = |points: &[Point]| points.iter().map(|p| p.coords.into()).collect();
        match &cut.shape {
            CutShape::Plane(plane) => Self { plane: Some(plane.into()), ..blank },
            CutShape::Polyline { points, direction, depth_mm } => {
                let (points_mm, direction) = (coordinates(points), (*direction).into());
                Self { polyline: Some(PolylineDocument { points_mm, direction, depth_mm: *depth_mm }), ..blank }
            }
            CutShape::Surface(mesh) => {
                let (points_mm, triangles) = (coordinates(mesh.positions()), mesh.triangles().to_vec());
                Self { surface: Some(CutSurfaceDocument { points_mm, triangles }), ..blank }
            }
            CutShape::FreePart(point) => {
                Self { free_part: Some(FreePartDocument { point_mm: point.coords.into() }), ..blank }
            }
        }
    }
}

impl CutDocument {
    /// The cut for the numerics.
    ///
    /// # Errors
    /// A description when the surface is not valid, or when there is not exactly one shape.
    pub fn cut(&self) -> Result<Cut, String> {
        let points = |all: &[[f64; 3]]| all.iter().copied().map(Point::from).collect::<Vec<_>>();
        let shape = match (&self.plane, &self.polyline, &self.surface, &self.free_part) {
            (Some(plane), None, None, None) => CutShape::Plane(plane.into()),
            (None, Some(line), None, None) => CutShape::Polyline {
                points: points(&line.points_mm),
                direction: Vector::from(line.direction),
                depth_mm: line.depth_mm,
            },
            (None, None, Some(surface), None) => CutShape::Surface(
                TriMesh::new(points(&surface.points_mm), surface.triangles.clone()).map_err(|e| e.to_string())?,
            ),
            (None, None, None, Some(part)) => CutShape::FreePart(Point::from(part.point_mm)),
            _ => return Err("must have exactly one of plane, polyline, surface and free_part".to_owned()),
        };
        let purpose = match self.purpose {
            PurposeDocument::Osteotomy => Purpose::Osteotomy,
            PurposeDocument::Separation => Purpose::Separation,
        };
        Ok(Cut { shape, kerf_mm: self.kerf_mm, name: self.name.clone(), purpose, part: self.part_mm.map(Point::from) })
    }
}

/// Cuts for the numerics from stored documents, which were checked before.
///
/// # Errors
/// [`FaultKind::PlanNotUsable`] when a document was changed since.
pub fn stored_cuts(documents: &[CutDocument]) -> Result<Vec<Cut>, Fault> {
    let cut = |(i, d): (usize, &CutDocument)| {
        d.cut().map_err(|detail| Fault::new(FaultKind::PlanNotUsable, detail).at(&format!("/cuts/{i}")))
    };
    documents.iter().enumerate().map(cut).collect()
}

/// A segment of the cut bone.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SegmentDocument {
    /// Number; 0 is the fixed skull.
    pub id: u32,
    /// Suggested name by position.
    ///
    /// `skull`, `maxilla`, `mandible_distal`, `mandible_proximal_left`, `chin` and others.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// Volume, mm³.
    pub volume_mm3: f64,
    /// Area, mm².
    pub area_mm2: f64,
    /// Number of triangles of its surface.
    pub triangles: usize,
    /// Centroid, LPS mm.
    pub centroid_mm: [f64; 3],
    /// Indices of the cuts that bound it.
    pub bounded_by: Vec<usize>,
}

/// Distance of a cut to a protected point or curve.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ClearanceDocument {
    /// Index of the cut.
    pub cut: usize,
    /// Name of the protected point or curve.
    pub protected: String,
    /// Smallest distance to the side of the saw's slot, mm; 0 when the cut crosses it.
    pub distance_mm: f64,
    /// Nearest protected point, LPS mm.
    pub place_mm: [f64; 3],
    /// Requested margin, mm.
    pub margin_mm: Option<f64>,
    /// Whether the distance is smaller than the margin.
    pub below_margin: bool,
}

/// Cuts and the segments that they make.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct OsteotomyDocument {
    /// Label that the client gave it.
    pub label: Option<String>,
    /// Template that placed the cuts, when there is exactly one.
    pub template: Option<String>,
    /// Templates that placed cuts, in the order of the cuts.
    #[serde(default)]
    pub templates: Vec<String>,
    /// The cuts.
    pub cuts: Vec<CutDocument>,
    /// The segments, by id.
    pub segments: Vec<SegmentDocument>,
    /// Distance of each cut to each protected point or curve.
    #[serde(default)]
    pub clearances: Vec<ClearanceDocument>,
    /// Volume of the bone before it was cut, mm³.
    #[serde(default)]
    pub bone_mm3: f64,
    /// Volume of small fragments that were dropped, mm³.
    #[serde(default)]
    pub dropped_mm3: f64,
    /// What was dropped, and what is doubtful.
    pub warnings: Vec<String>,
}

impl OsteotomyDocument {
    /// The document of a cut bone.
    #[must_use]
    pub fn new(
        label: Option<String>,
        templates: Vec<String>,
        osteotomy: &Osteotomy,
        protected: &[Protected],
        clearances: &[Clearance],
    ) -> Self {
        let clearance = |c: &Clearance| {
            let of = protected.get(c.protected);
            let margin_mm = of.and_then(|p| p.margin_mm);
            ClearanceDocument {
                cut: c.cut,
                protected: of.map(|p| p.name.clone()).unwrap_or_default(),
                distance_mm: c.distance_mm,
                place_mm: c.place.coords.into(),
                margin_mm,
                below_margin: margin_mm.is_some_and(|m| c.distance_mm < m),
            }
        };
        let segment = |s: &prosopon_planning::plan::Segment| SegmentDocument {
            id: s.id,
            name: s.name.clone(),
            volume_mm3: s.volume_mm3,
            area_mm2: s.area_mm2,
            triangles: s.surface.triangles().len(),
            centroid_mm: s.centroid.coords.into(),
            bounded_by: s.bounded_by.clone(),
        };
        Self {
            label,
            template: (templates.len() == 1).then(|| templates.concat()),
            templates,
            clearances: clearances.iter().map(clearance).collect(),
            cuts: osteotomy.cuts.iter().map(CutDocument::from).collect(),
            segments: osteotomy.segments.iter().map(segment).collect(),
            bone_mm3: osteotomy.bone_mm3,
            dropped_mm3: osteotomy.dropped_mm3,
            warnings: osteotomy.warnings.clone(),
        }
    }
}

/// Motion from rest at the path parameter `t`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct WaypointDocument {
    /// Path parameter, 0 to 1.
    pub t: f64,
    /// Translation of the point at the origin, mm.
    pub translation_mm: [f64; 3],
    /// Rotation, unit quaternion x, y, z, w.
    pub quaternion_xyzw: [f64; 4],
}

/// Path of one segment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PathDocument {
    /// The segment that moves.
    pub segment: u32,
    /// Motions from rest, joined by screw motions.
    pub waypoints: Vec<WaypointDocument>,
}

/// Overlap and gap of a segment at a point of its path.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PathSample {
    /// Path parameter.
    pub t: f64,
    /// Deepest overlap with other bone, mm; 0 when none.
    pub overlap_mm: f64,
    /// Volume of the overlap with other bone, mm³.
    #[serde(default)]
    pub overlap_mm3: f64,
    /// Mean gap at the cut faces, mm.
    pub gap_mm: f64,
    /// Volume between the cut faces and the bone that they face, mm³.
    #[serde(default)]
    pub gap_mm3: f64,
}

/// Report of a segment's path: displacement, overlaps and gaps.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PathReportDocument {
    /// The segment.
    pub segment: u32,
    /// Largest displacement of a point of the segment at the end, mm.
    pub max_displacement_mm: f64,
    /// Displacement of its centroid at the end, LPS mm.
    pub centroid_displacement_mm: [f64; 3],
    /// Length of the centroid's path, mm.
    pub path_length_mm: f64,
    /// Overlap and gap along the path.
    pub along: Vec<PathSample>,
}

impl From<&PathReport> for PathReportDocument {
    fn from(r: &PathReport) -> Self {
        let sample = |s: &plan::PathSample| PathSample {
            t: s.t,
            overlap_mm: s.overlap_mm,
            overlap_mm3: s.overlap_mm3,
            gap_mm: s.gap_mm,
            gap_mm3: s.gap_mm3,
        };
        Self {
            segment: r.segment,
            max_displacement_mm: r.max_displacement_mm,
            centroid_displacement_mm: r.centroid_displacement_mm,
            path_length_mm: r.path_length_mm,
            along: r.along.iter().map(sample).collect(),
        }
    }
}

/// Plan: paths of the bone segments with their reports.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PlanDocument {
    /// Label that the client gave it.
    pub label: Option<String>,
    /// One path for each moving segment.
    pub paths: Vec<PathDocument>,
    /// One report for each path.
    pub reports: Vec<PathReportDocument>,
    /// What to check before the plan is solved: unusual motions, overlapping bone, wide gaps.
    #[serde(default)]
    pub warnings: Vec<String>,
    /// Computing time of the reports, s.
    pub wall_s: f64,
}

impl PlanDocument {
    /// The plan for the numerics.
    ///
    /// # Errors
    /// [`PlanError`] when a path is not usable.
    pub fn plan(&self) -> Result<Plan, PlanError> {
        let path = |p: &PathDocument| {
            let motions = p.waypoints.iter().map(|w| (w.t, motion_of(w.translation_mm, w.quaternion_xyzw)));
            Path::new(p.segment, motions.collect())
        };
        Ok(Plan { paths: self.paths.iter().map(path).collect::<Result<_, _>>()? })
    }

    /// Documents of the paths of a plan.
    #[must_use]
    pub fn paths_of(plan: &Plan) -> Vec<PathDocument> {
        let waypoint = |(t, motion): &(f64, prosopon_geometry::Motion)| {
            let (translation_mm, quaternion_xyzw) = motion_parts(motion);
            WaypointDocument { t: *t, translation_mm, quaternion_xyzw }
        };
        let path =
            |p: &Path| PathDocument { segment: p.segment(), waypoints: p.waypoints().iter().map(waypoint).collect() };
        plan.paths.iter().map(path).collect()
    }
}
