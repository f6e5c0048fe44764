use super::dual::Real;
use super::skull::ORBIT;
use prosopon_geometry::{Point, Vector};

/// Landmarks and planes of a head, LPS mm.
#[derive(Debug, Clone, PartialEq)]
pub struct Landmarks {
    /// Name and position: `pogonion`, `menton`, `ans`, `nasal_bone_tip`, `pronasale`, `soft_pogonion`, and `orbitale_*` and
    /// `frontomalare_*` of both sides.
    pub points: Vec<(String, Point)>,
    /// x of the midline, mm.
    pub midline_x_mm: f64,
    /// z of the occlusal plane, mm.
    pub occlusal_plane_z_mm: f64,
    /// Point and unit normal of the Le Fort I plane.
    pub le_fort_1_plane: (Point, Vector),
}

impl Landmarks {
    /// Position of the landmark called `name`; `None` when there is none.
    #[must_use]
    pub fn point(&self, name: &str) -> Option<Point> {
        self.points.iter().find(|(n, _)| n == name).map(|(_, p)| *p)
    }

    pub(super) fn of_head() -> Self {
        let skin = |p: [f64; 3]| super::skin::skin(p);
        let bone = |p: [f64; 3]| super::skull::skull(p);
        let points = [
            ("pogonion", frontmost(&bone, [-41.0, -28.0])),
            ("menton", lowest(&bone, [-82.0, -60.0])),
            ("ans", frontmost(&bone, [24.0, 33.0])),
            ("nasal_bone_tip", frontmost(&bone, [57.0, 70.0])),
            ("pronasale", frontmost(&skin, [32.0, 50.0])),
            ("soft_pogonion", frontmost(&skin, [-46.0, -26.0])),
        ];
        let [orbitale, frontomalare] = [lower_rim(&bone), lateral_rim(&bone)];
        let mirrored = |p: Point| Point::new(-p.x, p.y, p.z);
        let rims = [
            ("orbitale_left", orbitale),
            ("orbitale_right", mirrored(orbitale)),
            ("frontomalare_left", frontomalare),
            ("frontomalare_right", mirrored(frontomalare)),
        ];
        Self {
            points: points.into_iter().chain(rims).map(|(name, p)| (name.to_owned(), p)).collect(),
            midline_x_mm: 0.0,
            occlusal_plane_z_mm: 0.0,
            le_fort_1_plane: (Point::new(0.0, -60.0, 32.0), Vector::z()),
        }
    }
}

/// Point of the midline profile that is farthest forward between the heights `low` and `high`.
fn frontmost(solid: &dyn Fn([f64; 3]) -> f64, [low, high]: [f64; 2]) -> Point {
    extreme(low, high, |z| first_hit(-140.0, 0.0, |y| solid([0.0, y, z])).map(|y| Point::new(0.0, y, z)), |p| p.y)
}

/// Point of the midline profile that is lowest between `front` and `back`.
fn lowest(solid: &dyn Fn([f64; 3]) -> f64, [front, back]: [f64; 2]) -> Point {
    extreme(front, back, |y| first_hit(-100.0, 0.0, |z| solid([0.0, y, z])).map(|z| Point::new(0.0, y, z)), |p| p.z)
}

/// Height of the lateral rim's suture in the orbit, in units of the orbit's height.
const SUTURE_SHARE: f64 = 0.75;
/// Width of the lateral rim that is searched for its front, beyond the orbit, mm.
const RIM_WIDTH_MM: f64 = 10.0;

/// Edge of the left orbit's lower rim below the orbit's centre: the point farthest up and forward.
fn lower_rim(solid: &dyn Fn([f64; 3]) -> f64) -> Point {
    let [x, _, z] = ORBIT.center;
    let front = |z| first_hit(-140.0, 0.0, |y| solid([x, y, z])).map(|y| Point::new(x, y, z));
    extreme(z - 1.5 * ORBIT.radii[2], z - 0.5 * ORBIT.radii[2], front, |p| p.y - p.z)
}

/// Front of the left orbit's lateral rim at the suture of cheek bone and forehead.
fn lateral_rim(solid: &dyn Fn([f64; 3]) -> f64) -> Point {
    let z = ORBIT.center[2] + (2.0 * SUTURE_SHARE - 1.0) * ORBIT.radii[2];
    let edge = ORBIT.center[0] + ORBIT.radii[0];
    let front = |x| first_hit(-140.0, 0.0, |y| solid([x, y, z])).map(|y| Point::new(x, y, z));
    extreme(edge - RIM_WIDTH_MM, edge + RIM_WIDTH_MM, front, |p| p.y)
}

/// The point with the least `key` among the hits from `low` to `high`, in steps of 0.05 mm.
fn extreme(low: f64, high: f64, hit: impl Fn(f64) -> Option<Point>, key: impl Fn(&Point) -> f64) -> Point {
    let steps = ((high - low) / 0.05).round() as usize;
    (0..=steps)
        .filter_map(|i| hit(low + 0.05 * i as f64))
        .min_by(|a, b| key(a).total_cmp(&key(b)))
        .unwrap_or_else(Point::origin)
}

/// First root of `f` from `from` towards `to`.
fn first_hit(from: f64, to: f64, f: impl Fn(f64) -> f64) -> Option<f64> {
    let step = 0.5;
    let mut inside = (0..).map(|i| from + step * f64::from(i)).take_while(|x| *x < to).find(|x| f(*x).value() < 0.0)?;
    let mut outside = inside - step;
    for _ in 0..48 {
        let middle = 0.5 * (inside + outside);
        if f(middle) < 0.0 {
            inside = middle;
        } else {
            outside = middle;
        }
    }
    Some(0.5 * (inside + outside))
}
