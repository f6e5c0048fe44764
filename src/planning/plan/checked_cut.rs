//! Checked cuts, prepared for intersection with the grid.

use super::PlanError;
use super::orient::oriented;
use super::shape::{Cut, CutShape, unit};
use prosopon_field::ExactDistance;
use prosopon_geometry::{Point, ScalarGrid, TriMesh, Vector};

/// A checked cut.
#[derive(Debug, Clone)]
pub(super) enum CheckedCut {
    Plane(CheckedPlane),
    Sheet(TriMesh),
    /// Cuts nothing.
    None,
}

/// A plane with an orthonormal frame.
#[derive(Debug, Clone, Copy)]
pub(super) struct CheckedPlane {
    point: Point,
    normal: Vector,
    /// Unit directions in the plane and half extents along them, mm.
    sides: Option<[(Vector, f64); 2]>,
}

impl CheckedCut {
    pub(super) fn new(index: usize, cut: &Cut) -> Result<Self, PlanError> {
        cut.check(index)?;
        Ok(match &cut.shape {
            CutShape::Plane(plane) => {
                let normal = plane.normal.normalize();
                let sides = plane.bounds.and_then(|(direction, along, across)| {
                    let u = unit(&(direction - normal * normal.dot(&direction)))?;
                    Some([(u, along), (normal.cross(&u), across)])
                });
                Self::Plane(CheckedPlane { point: plane.point, normal, sides })
            }
            CutShape::Polyline { .. } => match cut.surface(index, &Point::origin(), 1.0)? {
                Some(strip) => Self::Sheet(strip),
                None => Self::None,
            },
            CutShape::Surface(mesh) => Self::Sheet(oriented(mesh)),
            CutShape::FreePart(_) => Self::None,
        })
    }

    /// Distances of many points to the cut, mm.
    pub(super) fn distances(&self, points: &[Point]) -> Vec<f64> {
        match self {
            Self::Plane(plane) => points.iter().map(|p| plane.distance(p)).collect(),
            Self::Sheet(mesh) => {
                let exact = ExactDistance::new(mesh);
                points.iter().map(|p| exact.closest(p).2).collect()
            }
            Self::None => vec![f64::INFINITY; points.len()],
        }
    }
}

impl CheckedPlane {
    /// Signed distance from the endless plane, mm.
    fn side(&self, p: &Point) -> f64 {
        self.normal.dot(&(p - self.point))
    }

    /// Signed distances (mm) of both ends of the grid edge `from`–`to`; `None` when it does not cross the cut.
    ///
    /// A node in the plane counts as on the normal's side. Every edge evaluates a node by the same arithmetic, so that rounding
    /// opens no gap.
    pub(super) fn crosses(&self, from: &Point, to: &Point) -> Option<[f64; 2]> {
        let (a, b) = (self.side(from), self.side(to));
        if (a < 0.0) == (b < 0.0) {
            return None;
        }
        let Some(sides) = self.sides else { return Some([a, b]) };
        let hit = (from - self.point) + (to - from) * (a / (a - b));
        sides.iter().all(|(u, half)| u.dot(&hit).abs() <= *half).then_some([a, b])
    }

    /// Range of the grid's nodes along `axis` whose edges the cut can cross.
    pub(super) fn nodes(&self, grid: &ScalarGrid, axis: usize) -> std::ops::Range<usize> {
        let n = grid.dims[axis];
        let Some(sides) = self.sides else { return 0..n };
        let half: f64 = sides.iter().map(|(u, half)| (u[axis] * half).abs()).sum();
        let to_node = |x: f64| (x - grid.origin[axis]) / grid.spacing;
        let (low, high) = (to_node(self.point[axis] - half) - 2.0, to_node(self.point[axis] + half) + 2.0);
        // Casts saturate.
        (low.max(0.0) as usize).min(n)..(high.max(0.0).ceil() as usize).min(n)
    }

    fn distance(&self, p: &Point) -> f64 {
        let d = p - self.point;
        let beyond = self.sides.map_or([0.0; 2], |s| s.map(|(u, half)| (u.dot(&d).abs() - half).max(0.0)));
        Vector::new(self.side(p), beyond[0], beyond[1]).norm()
    }
}
