use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::geometry::{Point, Vector};
use crate::plan::{BoundedPlane, Osteotomy, Path, PathReport, Plan, PlanError};
use crate::session::motion::motion_of;
use crate::session::motion_parts;

/// Rectangle that bounds a cut plane.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PlaneBoundsDocument {
    /// Direction in the plane.
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
    /// Centre of the rectangle, or any point of an endless plane, LPS mm.
    pub point_mm: [f64; 3],
    /// Normal; unit length in answers.
    pub normal: [f64; 3],
    /// Bounds; endless when absent.
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
    /// Takes unit vectors as they are: documents hold checked planes.
    fn from(d: &PlaneDocument) -> Self {
        Self {
            point: Point::from(d.point_mm),
            normal: Vector::from(d.normal),
            bounds: d.bounds.map(|b| (Vector::from(b.direction), b.half_length_mm, b.half_width_mm)),
        }
    }
}

/// A piece of bone.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SegmentDocument {
    /// Number; 0 is the skull that stays.
    pub id: u32,
    /// Volume, mm³.
    pub volume_mm3: f64,
    /// Area, mm².
    pub area_mm2: f64,
    /// Triangles of its surface.
    pub triangles: usize,
    /// Centroid, LPS mm.
    pub centroid_mm: [f64; 3],
    /// Indices of the cuts that bound it.
    pub bounded_by: Vec<usize>,
}

/// Cuts and the segments that they make.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct OsteotomyDocument {
    /// The client's tag.
    pub label: Option<String>,
    /// Template that placed the cuts.
    pub template: Option<String>,
    /// The cuts.
    pub cuts: Vec<PlaneDocument>,
    /// The segments, by id.
    pub segments: Vec<SegmentDocument>,
    /// What was dropped or is doubtful.
    pub warnings: Vec<String>,
}

impl OsteotomyDocument {
    /// The document of a cut bone.
    #[must_use]
    pub fn new(label: Option<String>, template: Option<String>, osteotomy: &Osteotomy) -> Self {
        let segment = |s: &crate::plan::Segment| SegmentDocument {
            id: s.id,
            volume_mm3: s.volume_mm3,
            area_mm2: s.area_mm2,
            triangles: s.surface.triangles().len(),
            centroid_mm: s.centroid.coords.into(),
            bounded_by: s.bounded_by.clone(),
        };
        Self {
            label,
            template,
            cuts: osteotomy.cuts.iter().map(PlaneDocument::from).collect(),
            segments: osteotomy.segments.iter().map(segment).collect(),
            warnings: osteotomy.warnings.clone(),
        }
    }

    /// The cuts as the numerics take them.
    #[must_use]
    pub fn planes(&self) -> Vec<BoundedPlane> {
        self.cuts.iter().map(BoundedPlane::from).collect()
    }
}

/// A motion from rest at `t`.
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

/// State of a segment along its path.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PathSample {
    /// Path parameter.
    pub t: f64,
    /// Deepest overlap with other bone, mm; 0 when none.
    pub overlap_mm: f64,
    /// Mean gap at the cut faces, mm.
    pub gap_mm: f64,
}

/// How a segment travels and what it meets.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PathReportDocument {
    /// The segment.
    pub segment: u32,
    /// Largest displacement of a point at the end, mm.
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
        let sample = |&(t, overlap_mm, gap_mm): &(f64, f64, f64)| PathSample { t, overlap_mm, gap_mm };
        Self {
            segment: r.segment,
            max_displacement_mm: r.max_displacement_mm,
            centroid_displacement_mm: r.centroid_displacement_mm,
            path_length_mm: r.path_length_mm,
            along: r.along.iter().map(sample).collect(),
        }
    }
}

/// Bone paths and what they meet.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PlanDocument {
    /// The client's tag.
    pub label: Option<String>,
    /// One path a moving segment.
    pub paths: Vec<PathDocument>,
    /// One report a path.
    pub reports: Vec<PathReportDocument>,
    /// Time that the reports took, s.
    pub wall_s: f64,
}

impl PlanDocument {
    /// The plan that the numerics take.
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

    /// Documents of checked paths.
    #[must_use]
    pub fn paths_of(plan: &Plan) -> Vec<PathDocument> {
        let waypoint = |(t, motion): &(f64, crate::geometry::Motion)| {
            let (translation_mm, quaternion_xyzw) = motion_parts(motion);
            WaypointDocument { t: *t, translation_mm, quaternion_xyzw }
        };
        let path =
            |p: &Path| PathDocument { segment: p.segment(), waypoints: p.waypoints().iter().map(waypoint).collect() };
        plan.paths.iter().map(path).collect()
    }
}
