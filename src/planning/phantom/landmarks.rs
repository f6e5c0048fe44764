use super::dual::Real;
use prosopon_geometry::{Point, Vector};

/// Landmarks and planes of a head, LPS mm.
#[derive(Debug, Clone, PartialEq)]
pub struct Landmarks {
    /// Name and position: `pogonion`, `menton`, `ans`, `nasal_bone_tip`, `pronasale`, `soft_pogonion`.
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
        Self {
            points: points.map(|(name, p)| (name.to_owned(), p)).to_vec(),
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
