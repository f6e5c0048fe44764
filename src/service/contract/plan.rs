use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::motion::{motion_of, motion_parts};
use super::warning::Findings;
use prosopon_geometry::Warning;
use prosopon_planning::plan::{self, Path, PathReport, Plan, PlanError};

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

/// Codes of findings on the request of a plan, which stay when it is measured.
const OF_REQUEST: [&str; 2] = ["transform-file", "rotation-adjusted"];

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
    /// Overlap and gap along the path; empty until they are measured.
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
    /// Whether overlaps and gaps of bone along the paths have been measured.
    ///
    /// They are measured when the plan is read, and by a solve at its end. A plan for an uploaded tissue mesh has none.
    #[serde(default = "yes")]
    pub measured: bool,
    /// Warnings and notes.
    #[serde(flatten)]
    pub findings: Findings,
    /// Computing time of the reports, s.
    pub wall_s: f64,
}

/// Documents from before the member have been measured.
fn yes() -> bool {
    true
}

impl PlanDocument {
    /// A plan without reports.
    #[must_use]
    pub fn new(label: Option<String>, plan: &Plan) -> Self {
        let (reports, findings) = (Vec::new(), Findings::default());
        Self { label, paths: Self::paths_of(plan), reports, measured: false, findings, wall_s: 0.0 }
    }

    /// The same plan with another warning.
    #[must_use]
    pub fn warned(mut self, warning: Warning) -> Self {
        self.findings.extend([warning]);
        self
    }

    /// The same plan with what was noticed in its request.
    #[must_use]
    pub fn noted(mut self, found: Vec<Warning>) -> Self {
        self.findings.extend(found);
        self
    }

    /// The same plan with `reports`, which took `wall_s` to compute.
    #[must_use]
    pub fn reported(self, reports: &[PathReport], wall_s: f64) -> Self {
        let of_request = self.findings.iter().filter(|found| OF_REQUEST.contains(&found.code.as_str()));
        let mut findings: Findings = of_request.cloned().collect();
        findings.extend(reports.iter().flat_map(|report| report.warnings.clone()));
        Self {
            findings,
            reports: reports.iter().map(PathReportDocument::from).collect(),
            wall_s: self.wall_s + wall_s,
            ..self
        }
    }

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
