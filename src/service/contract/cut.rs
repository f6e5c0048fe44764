use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::check::{Check, REACH_MM};
use super::fault::{Fault, FaultKind};
use prosopon_geometry::{Point, TriMesh, Vector};
use prosopon_planning::plan::{BoundedPlane, Cut, CutShape, Purpose};

/// Shortest polyline of a cut, mm; a shorter one is a mistake in units.
const SHORTEST_LINE_MM: f64 = 1.0;

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

impl From<PurposeDocument> for Purpose {
    fn from(purpose: PurposeDocument) -> Self {
        match purpose {
            PurposeDocument::Osteotomy => Self::Osteotomy,
            PurposeDocument::Separation => Self::Separation,
        }
    }
}

impl From<Purpose> for PurposeDocument {
    fn from(purpose: Purpose) -> Self {
        match purpose {
            Purpose::Osteotomy => Self::Osteotomy,
            Purpose::Separation => Self::Separation,
        }
    }
}

/// One cut: exactly one of `plane`, `polyline`, `surface` and `free_part`.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
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
    /// Name of the cut, 1 to 64 characters; templates name theirs.
    ///
    /// Segments are named after the templates' cuts that bound them. Nothing else depends on a cut's name.
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

impl From<&Cut> for CutDocument {
    fn from(cut: &Cut) -> Self {
        let purpose = cut.purpose.into();
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
        let purpose = self.purpose.into();
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

/// The cut of a request; reports faults below `pointer` and gives `None` when it has no usable shape.
pub(super) fn checked_cut(check: &mut Check, pointer: &str, request: &CutDocument) -> Option<Cut> {
    check.number(&format!("{pointer}/kerf_mm"), request.kerf_mm, 0.0, 10.0);
    check.name(&format!("{pointer}/name"), request.name.as_deref());
    let part = request.part_mm.map(|p| Point::from(check.vector(&format!("{pointer}/part_mm"), p)));
    let shape = match (&request.plane, &request.polyline, &request.surface, &request.free_part) {
        (Some(plane), None, None, None) => CutShape::Plane(bounded_plane(check, &format!("{pointer}/plane"), plane)),
        (None, Some(line), None, None) => {
            let pointer = format!("{pointer}/polyline");
            let direction = check.direction(&format!("{pointer}/direction"), line.direction);
            let depth_mm = check.number(&format!("{pointer}/depth_mm"), line.depth_mm, 0.1, REACH_MM);
            let (least, most) = (2, 1000);
            let points = points(check, &format!("{pointer}/points_mm"), &line.points_mm, least, most);
            let length_mm: f64 = points.windows(2).map(|w| (w[1] - w[0]).norm()).sum();
            if (least..=most).contains(&line.points_mm.len()) && length_mm < SHORTEST_LINE_MM {
                let detail = format!(
                    "make a line of {length_mm:.3} mm, at least {SHORTEST_LINE_MM} mm are needed; check that they are in mm"
                );
                check.fault(format!("{pointer}/points_mm"), detail);
            }
            CutShape::Polyline { points, direction, depth_mm }
        }
        (None, None, Some(surface), None) => {
            let pointer = format!("{pointer}/surface");
            let points = points(check, &format!("{pointer}/points_mm"), &surface.points_mm, 3, 100_000);
            if !(1..=100_000).contains(&surface.triangles.len()) {
                let detail = format!("has {} triangles, allowed are 1 to 100000", surface.triangles.len());
                check.fault(format!("{pointer}/triangles"), detail);
                return None;
            }
            match TriMesh::new(points, surface.triangles.clone()) {
                Ok(mesh) => CutShape::Surface(mesh),
                Err(error) => {
                    check.fault(format!("{pointer}/triangles"), error.to_string());
                    return None;
                }
            }
        }
        (None, None, None, Some(part)) => {
            CutShape::FreePart(Point::from(check.vector(&format!("{pointer}/free_part/point_mm"), part.point_mm)))
        }
        _ => {
            check.fault(pointer, "must have exactly one of plane, polyline, surface and free_part");
            return None;
        }
    };
    let (kerf_mm, name, purpose) = (request.kerf_mm, request.name.clone(), request.purpose.into());
    Some(Cut { shape, kerf_mm, name, purpose, part })
}

pub(super) fn points(check: &mut Check, pointer: &str, given: &[[f64; 3]], least: usize, most: usize) -> Vec<Point> {
    if !(least..=most).contains(&given.len()) {
        check.fault(pointer, format!("has {} points, allowed are {least} to {most}", given.len()));
    }
    let taken = given.iter().take(most).enumerate();
    taken.map(|(i, p)| Point::from(check.vector(&format!("{pointer}/{i}"), *p))).collect()
}

fn bounded_plane(check: &mut Check, pointer: &str, plane: &PlaneDocument) -> BoundedPlane {
    let normal = check.direction(&format!("{pointer}/normal"), plane.normal);
    let bounds = plane.bounds.map(|b| {
        let direction = check.direction(&format!("{pointer}/bounds/direction"), b.direction);
        // The rectangle's sides must be perpendicular to the normal; a small deviation is projected out.
        let in_plane = direction - normal * normal.dot(&direction);
        if in_plane.norm() < 0.9 {
            check.fault(format!("{pointer}/bounds/direction"), "does not lie in the plane");
        }
        let length = check.number(&format!("{pointer}/bounds/half_length_mm"), b.half_length_mm, 0.1, REACH_MM);
        let width = check.number(&format!("{pointer}/bounds/half_width_mm"), b.half_width_mm, 0.1, REACH_MM);
        (in_plane.try_normalize(1e-9).unwrap_or(direction), length, width)
    });
    BoundedPlane { point: Point::from(check.vector(&format!("{pointer}/point_mm"), plane.point_mm)), normal, bounds }
}
