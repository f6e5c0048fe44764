//! Shapes of cuts: planes, polylines with a sawing direction, surfaces.

use super::PlanError;
use super::orient::oriented;
use super::tuning::{MAX_KERF_MM, MAX_POINTS, MAX_TRIANGLES};
use prosopon_geometry::{Motion, Point, TriMesh, Vector};

/// A plane, bounded by a rectangle or endless.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BoundedPlane {
    /// Centre of the rectangle, or any point of an endless plane, LPS mm.
    pub point: Point,
    /// Unit normal.
    pub normal: Vector,
    /// Unit direction in the plane and half extents along it and across it (`normal × direction`), mm; `None` is endless.
    pub bounds: Option<(Vector, f64, f64)>,
}

/// Geometry of a cut.
#[derive(Debug, Clone, PartialEq)]
pub enum CutShape {
    /// A plane.
    Plane(BoundedPlane),
    /// A line on the bone, swept along the sawing direction: a strip of parallelograms.
    Polyline {
        /// Points of the line, LPS mm; a closed line repeats its first point at the end.
        points: Vec<Point>,
        /// Direction of sawing; any length.
        direction: Vector,
        /// Depth of the cut along `direction`, mm.
        depth_mm: f64,
    },
    /// Triangles of an open or closed surface, in any orientation.
    Surface(TriMesh),
    /// No cut: makes the separate part of bone at this point (LPS mm), or nearest to it, a segment of its own.
    FreePart(Point),
}

/// Why a cut is made.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Purpose {
    /// Bone is sawn.
    #[default]
    Osteotomy,
    /// Bones that touch in the image (teeth, streaks of metal, joints) are separated; nothing is sawn.
    Separation,
}

/// A cut through bone, or a separation of bones that touch in the image.
#[derive(Debug, Clone, PartialEq)]
pub struct Cut {
    /// Geometry of the cut.
    pub shape: CutShape,
    /// Kerf, the width of the saw's slot, mm; half of it on each side of the cut.
    pub kerf_mm: f64,
    /// Name of the cut, by which messages call it.
    pub name: Option<String>,
    /// Why it is made.
    pub purpose: Purpose,
    /// For a separation: a point on the side of the bone that it frees, at any distance, LPS mm. Thin bridges that all such
    /// separations together leave between their two sides are parted too. `None`: bridges stay.
    pub part: Option<Point>,
}

impl Cut {
    /// Name of the cut in messages; without a name, its `index` in the list of cuts.
    #[must_use]
    pub fn label(&self, index: usize) -> String {
        self.name.as_ref().map_or_else(|| format!("cut {index}"), |name| format!("cut `{name}`"))
    }
}

/// Coordinates are rounded to this, mm.
const ROUNDED_MM: f64 = 1e-9;

fn rounded(p: &Point) -> Point {
    p.map(|c| (c / ROUNDED_MM).round() * ROUNDED_MM)
}

impl CutShape {
    fn rounded(&self) -> Self {
        let direction = |v: &Vector| rounded(&Point::from(*v)).coords;
        match self {
            Self::Plane(plane) => Self::Plane(BoundedPlane {
                point: rounded(&plane.point),
                normal: direction(&plane.normal),
                bounds: plane.bounds.map(|(along, length, width)| (direction(&along), length, width)),
            }),
            Self::Polyline { points, direction: along, depth_mm } => Self::Polyline {
                points: points.iter().map(rounded).collect(),
                direction: direction(along),
                depth_mm: *depth_mm,
            },
            Self::Surface(mesh) => {
                let positions = mesh.positions().iter().map(rounded).collect();
                Self::Surface(mesh.with_positions(positions).unwrap_or_else(|_| mesh.clone()))
            }
            Self::FreePart(p) => Self::FreePart(rounded(p)),
        }
    }

    /// The shape moved in space.
    #[must_use]
    pub fn moved(&self, motion: &Motion) -> Self {
        match self {
            Self::Plane(plane) => Self::Plane(BoundedPlane {
                point: motion * plane.point,
                normal: motion * plane.normal,
                bounds: plane.bounds.map(|(along, length, width)| (motion * along, length, width)),
            }),
            Self::Polyline { points, direction, depth_mm } => Self::Polyline {
                points: points.iter().map(|p| motion * p).collect(),
                direction: motion * direction,
                depth_mm: *depth_mm,
            },
            Self::Surface(mesh) => Self::Surface(mesh.moved(motion)),
            Self::FreePart(p) => Self::FreePart(motion * p),
        }
    }
}

impl From<CutShape> for Cut {
    fn from(shape: CutShape) -> Self {
        Self { shape, kerf_mm: 0.0, name: None, purpose: Purpose::Osteotomy, part: None }
    }
}

impl From<BoundedPlane> for Cut {
    fn from(plane: BoundedPlane) -> Self {
        CutShape::Plane(plane).into()
    }
}

impl Cut {
    /// The same cut with a name.
    #[must_use]
    pub fn named(self, name: &str) -> Self {
        Self { name: Some(name.to_owned()), ..self }
    }

    /// The cut with coordinates rounded to a millionth of a micrometre: it stays the same when it is moved to another frame and back.
    #[must_use]
    pub fn rounded(&self) -> Self {
        Self { shape: self.shape.rounded(), part: self.part.map(|p| rounded(&p)), ..self.clone() }
    }

    /// The cut moved in space.
    #[must_use]
    pub fn moved(&self, motion: &Motion) -> Self {
        Self { shape: self.shape.moved(motion), part: self.part.map(|p| motion * p), ..self.clone() }
    }

    /// The same cut as a separation: it parts bones that touch in the image and saws nothing.
    #[must_use]
    pub fn separating(self) -> Self {
        Self { purpose: Purpose::Separation, ..self }
    }

    /// The same cut as a separation that frees the bone on the side of `part`.
    ///
    /// Thin bridges that it leaves are parted too.
    #[must_use]
    pub fn parting(self, part: Point) -> Self {
        Self { part: Some(part), ..self.separating() }
    }

    /// Triangles of the cut, consistently oriented where possible; `None` for [`CutShape::FreePart`].
    ///
    /// An endless plane becomes a square that reaches `reach` mm to each side of its point nearest to `centre` (LPS mm).
    ///
    /// # Errors
    /// [`PlanError::Cut`] for a value that is not allowed, as in [`cut`](super::cut()); it calls the cut by its name, or `cut {index}`.
    pub fn surface(&self, index: usize, centre: &Point, reach: f64) -> Result<Option<TriMesh>, PlanError> {
        self.check(index)?;
        Ok(match &self.shape {
            CutShape::Plane(plane) => Some(rectangle(plane, centre, reach)),
            CutShape::Polyline { points, direction, depth_mm } => strip(points, direction, *depth_mm),
            CutShape::Surface(mesh) => Some(oriented(mesh)),
            CutShape::FreePart(_) => None,
        })
    }

    /// The error of this cut, number `index` of the list of cuts, at `field`.
    pub(super) fn fault(&self, index: usize, field: &'static str, detail: String) -> PlanError {
        PlanError::Cut { cut: index, label: self.label(index), field, detail }
    }

    /// Checks every value; errors call the cut by its name, or `cut {index}`.
    pub(super) fn check(&self, index: usize) -> Result<(), PlanError> {
        let fault = |field: &'static str, detail: String| Err(self.fault(index, field, format!("`{field}` {detail}")));
        if !(0.0..=MAX_KERF_MM).contains(&self.kerf_mm) {
            return fault("kerf_mm", format!("is {} mm, allowed is 0 to {MAX_KERF_MM} mm", self.kerf_mm));
        }
        match &self.shape {
            CutShape::Plane(plane) => match plane_fault(plane) {
                Some((field, detail)) => fault(field, detail.to_owned()),
                None => Ok(()),
            },
            CutShape::Polyline { points, direction, depth_mm } => match polyline_fault(points, direction, *depth_mm) {
                Some((field, detail)) => fault(field, detail),
                None => Ok(()),
            },
            CutShape::Surface(mesh) if mesh.triangles().len() > MAX_TRIANGLES => fault(
                "surface",
                format!("has {} triangles, at most {MAX_TRIANGLES} are allowed; simplify it", mesh.triangles().len()),
            ),
            CutShape::Surface(mesh) if mesh.area() <= 0.0 => {
                fault("surface", "has no area: every triangle is flat".to_owned())
            }
            CutShape::FreePart(p) if !finite(&p.coords) => fault("free_part", "is not finite".to_owned()),
            CutShape::Surface(_) | CutShape::FreePart(_) => Ok(()),
        }
    }
}

/// A unit vector, unless it has no length or is not finite.
pub(super) fn unit(v: &Vector) -> Option<Vector> {
    v.try_normalize(1e-9).filter(finite)
}

fn finite(v: &Vector) -> bool {
    v.iter().all(|c| c.is_finite())
}

fn plane_fault(plane: &BoundedPlane) -> Option<(&'static str, &'static str)> {
    if !finite(&plane.point.coords) {
        return Some(("plane.point_mm", "is not finite"));
    }
    let Some(normal) = unit(&plane.normal) else { return Some(("plane.normal", "has no length")) };
    let (direction, along, across) = plane.bounds?;
    if unit(&direction).and_then(|d| unit(&(d - normal * normal.dot(&d)))).is_none() {
        return Some(("plane.bounds", "the direction has no part in the plane; it must not be parallel to the normal"));
    }
    let extent = |e: f64| e > 0.0 && e.is_finite();
    (!extent(along) || !extent(across)).then_some(("plane.bounds", "half extents must be above 0 mm"))
}

fn polyline_fault(points: &[Point], direction: &Vector, depth_mm: f64) -> Option<(&'static str, String)> {
    if !(2..=MAX_POINTS).contains(&points.len()) {
        return Some(("polyline.points_mm", format!("has {} points, allowed are 2 to {MAX_POINTS}", points.len())));
    }
    if let Some(i) = points.iter().position(|p| !finite(&p.coords)) {
        return Some(("polyline.points_mm", format!("point {i} has a coordinate that is not finite")));
    }
    let Some(direction) = unit(direction) else { return Some(("polyline.direction", "has no length".to_owned())) };
    if !(depth_mm > 0.0 && depth_mm.is_finite()) {
        return Some(("polyline.depth_mm", format!("is {depth_mm} mm, must be above 0 mm")));
    }
    let flat: Vec<Vector> = points.iter().map(|p| p.coords - direction * direction.dot(&p.coords)).collect();
    if let Some(i) = flat.windows(2).position(|w| (w[1] - w[0]).norm() < 1e-6) {
        let detail =
            format!("points {i} and {} lie behind each other in the sawing direction; remove or move one", i + 1);
        return Some(("polyline.points_mm", detail));
    }
    let side = direction.cross(&(flat[1] - flat[0])).normalize();
    let along = side.cross(&direction);
    let plane: Vec<[f64; 2]> = flat.iter().map(|p| [along.dot(p), side.dot(p)]).collect();
    let (i, j) = crossing_segments(&plane)?;
    Some((
        "polyline.points_mm",
        format!("the line crosses itself in the sawing direction: its parts after points {i} and {j} meet"),
    ))
}

/// First two parts of a plane polyline that meet and are not neighbours, each by the index of its first point.
fn crossing_segments(line: &[[f64; 2]]) -> Option<(usize, usize)> {
    let n = line.len() - 1;
    let closed = line[0] == line[n];
    let turn = |a: [f64; 2], b: [f64; 2], c: [f64; 2]| (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
    let within =
        |a: [f64; 2], b: [f64; 2], p: [f64; 2]| (0..2).all(|k| a[k].min(b[k]) <= p[k] && p[k] <= a[k].max(b[k]));
    for i in 0..n {
        for j in i + 2..n {
            if closed && i == 0 && j == n - 1 {
                continue;
            }
            let [a, b, c, d] = [line[i], line[i + 1], line[j], line[j + 1]];
            let (s, t, u, v) = (turn(a, b, c), turn(a, b, d), turn(c, d, a), turn(c, d, b));
            let touch = [(s, a, b, c), (t, a, b, d), (u, c, d, a), (v, c, d, b)];
            if (s * t < 0.0 && u * v < 0.0) || touch.iter().any(|(e, a, b, p)| *e == 0.0 && within(*a, *b, *p)) {
                return Some((i, j));
            }
        }
    }
    None
}

/// Two triangles for each part of the line between neighbouring points.
fn strip(points: &[Point], direction: &Vector, depth_mm: f64) -> Option<TriMesh> {
    let down = unit(direction)? * depth_mm;
    let closed = points.len() > 2 && points.first() == points.last();
    let top = if closed { &points[..points.len() - 1] } else { points };
    let n = top.len() as u32;
    let positions = top.iter().copied().chain(top.iter().map(|p| p + down)).collect();
    let stretches = if closed { n } else { n - 1 };
    let triangles = (0..stretches).flat_map(|i| {
        let j = (i + 1) % n;
        [[i, j, n + j], [i, n + j, n + i]]
    });
    TriMesh::new(positions, triangles.collect()).ok()
}

fn rectangle(plane: &BoundedPlane, centre: &Point, reach: f64) -> TriMesh {
    let normal = plane.normal.normalize();
    let (middle, u, along, across) = match plane.bounds {
        Some((direction, along, across)) => {
            (plane.point, (direction - normal * normal.dot(&direction)).normalize(), along, across)
        }
        None => {
            let foot = centre - normal * normal.dot(&(centre - plane.point));
            let axis = if normal.x.abs() < 0.8 { Vector::x() } else { Vector::y() };
            (foot, (axis - normal * normal.dot(&axis)).normalize(), reach, reach)
        }
    };
    let (u, v) = (u * along, normal.cross(&u) * across);
    let positions = vec![middle - u - v, middle + u - v, middle + u + v, middle - u + v];
    match TriMesh::new(positions, vec![[0, 1, 2], [0, 2, 3]]) {
        Ok(mesh) => mesh,
        Err(_) => unreachable!("a checked plane has finite corners"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn polyline(points: &[[f64; 3]], direction: [f64; 3], depth_mm: f64) -> Cut {
        let points = points.iter().map(|p| Point::from(*p)).collect();
        CutShape::Polyline { points, direction: direction.into(), depth_mm }.into()
    }

    #[test]
    fn a_strip_has_the_area_of_its_parallelograms() {
        let cut = polyline(&[[0.0; 3], [10.0, 0.0, 0.0], [10.0, 5.0, 0.0]], [0.0, 0.0, -2.0], 4.0);
        let mesh = cut.surface(0, &Point::origin(), 1.0).unwrap().unwrap();
        assert!((mesh.area() - 60.0).abs() < 1e-12);
        let round = polyline(&[[0.0; 3], [3.0, 0.0, 0.0], [0.0, 4.0, 0.0], [0.0; 3]], [0.0, 0.0, 1.0], 2.0);
        let mesh = round.surface(0, &Point::origin(), 1.0).unwrap().unwrap();
        assert!((mesh.area() - 24.0).abs() < 1e-12 && mesh.positions().len() == 6);
    }

    #[test]
    fn an_endless_plane_is_shown_around_the_centre() {
        let plane = BoundedPlane { point: Point::new(500.0, 0.0, 3.0), normal: Vector::z(), bounds: None };
        let mesh = Cut::from(plane).surface(0, &Point::new(1.0, 2.0, 90.0), 50.0).unwrap().unwrap();
        assert!((mesh.area() - 1e4).abs() < 1e-9 && (mesh.bounds().center() - Point::new(1.0, 2.0, 3.0)).norm() < 1e-9);
    }

    #[test]
    fn a_fault_names_the_cut_and_not_the_first_one() {
        let plane = BoundedPlane { point: Point::origin(), normal: Vector::zeros(), bounds: None };
        let message = |cut: Cut| cut.surface(4, &Point::origin(), 1.0).unwrap_err().to_string();
        assert_eq!(message(plane.into()), "cut 4: `plane.normal` has no length");
        assert_eq!(message(Cut::from(plane).named("chin")), "cut `chin`: `plane.normal` has no length");
    }

    #[test]
    fn hostile_polylines_are_refused_by_name() {
        let what = |cut: Cut| match cut.check(3) {
            Err(PlanError::Cut { cut: 3, field, .. }) => field,
            other => panic!("{other:?}"),
        };
        let (a, b, down) = ([0.0; 3], [9.0, 0.0, 0.0], [0.0, 0.0, -1.0]);
        assert_eq!(what(polyline(&[], down, 5.0)), "polyline.points_mm");
        assert_eq!(what(polyline(&[a], down, 5.0)), "polyline.points_mm");
        assert_eq!(what(polyline(&[a, a], down, 5.0)), "polyline.points_mm");
        assert_eq!(what(polyline(&[a, [0.0, 0.0, 7.0]], down, 5.0)), "polyline.points_mm");
        assert_eq!(what(polyline(&[a, [f64::NAN, 0.0, 0.0]], down, 5.0)), "polyline.points_mm");
        assert_eq!(what(polyline(&vec![a; 1001], down, 5.0)), "polyline.points_mm");
        assert_eq!(what(polyline(&[a, b], [0.0; 3], 5.0)), "polyline.direction");
        assert_eq!(what(polyline(&[a, b], [f64::INFINITY, 0.0, 0.0], 5.0)), "polyline.direction");
        for depth in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert_eq!(what(polyline(&[a, b], down, depth)), "polyline.depth_mm");
        }
        // A bow tie crosses itself, also when its lines lie at different depths.
        let tie = [a, [10.0, 10.0, 1.0], [10.0, 0.0, 2.0], [0.0, 10.0, 3.0]];
        assert_eq!(what(polyline(&tie, down, 5.0)), "polyline.points_mm");
        for kerf_mm in [-1.0, 11.0, f64::NAN] {
            assert_eq!(what(Cut { kerf_mm, ..polyline(&[a, b], down, 5.0) }), "kerf_mm");
        }
        assert!(polyline(&[a, b, [9.0, 9.0, 0.0], a], down, 5.0).check(0).is_ok());
    }
}
