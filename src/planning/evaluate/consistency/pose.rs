//! The pose of a head by its landmarks alone.

use nalgebra::Matrix3;

use super::known::known;
use super::tuning::{FLAT, HEAD_SIZES};
use prosopon_geometry::{Point, Vector};

/// Rounds of the robust fit, and the distance below which a point has its full weight, mm of an average head.
const ROUNDS: usize = 30;
const CORE_MM: f64 = 4.0;

/// Place, turn and size of the average head that lies best on landmarks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::evaluate) struct Pose {
    turn: Matrix3<f64>,
    shift: Vector,
    /// Size relative to that of an average adult in mm.
    pub(in crate::evaluate) size: f64,
}

impl Pose {
    /// Fits the average head to the points of the midline and to the middles between left and right points.
    ///
    /// The sides' names and a mirror image do not change it. A minority of misplaced points hardly does. `None` for fewer than
    /// three points, or for points on a line.
    pub(in crate::evaluate) fn of(points: &[(String, Point)]) -> Option<Self> {
        let pairs = middles(points);
        if pairs.len() < 3 {
            return None;
        }
        let mut weights = vec![1.0; pairs.len()];
        let mut pose = Self::weighted(&pairs, &weights)?;
        for _ in 0..ROUNDS {
            for (weight, (q, p)) in weights.iter_mut().zip(&pairs) {
                *weight = CORE_MM / ((pose.place(q) - p).norm() / pose.size).max(CORE_MM);
            }
            pose = Self::weighted(&pairs, &weights)?;
        }
        Some(pose)
    }

    /// Least squares of a turn, a shift and a size (Umeyama 1991) for points in a plane.
    fn weighted(pairs: &[(Point, Point)], weights: &[f64]) -> Option<Self> {
        let total: f64 = weights.iter().sum();
        let with = || pairs.iter().zip(weights);
        let from = with().map(|((q, _), w)| q.coords * *w).sum::<Vector>() / total;
        let to = with().map(|((_, p), w)| p.coords * *w).sum::<Vector>() / total;
        let spread: Matrix3<f64> = with().map(|((q, p), w)| (p.coords - to) * (q.coords - from).transpose() * *w).sum();
        let turn = nearest_turn(&spread)?;
        let own: f64 = with().map(|((q, _), w)| (q.coords - from).norm_squared() * w).sum();
        let size = (turn.transpose() * spread).trace() / own;
        (size.is_finite() && size > 0.0).then(|| Self { turn, shift: to - turn * from * size, size })
    }

    /// Where the point `q` of the average head lies.
    pub(in crate::evaluate) fn place(&self, q: &Point) -> Point {
        Point::from(self.turn * q.coords * self.size + self.shift)
    }

    /// Mean distance of the points of the midline, and of the middles of pairs, from those of the average head, mm of that head.
    ///
    /// The sixth that lies farthest does not count.
    pub(in crate::evaluate) fn unlike_mm(&self, points: &[(String, Point)]) -> f64 {
        let mut off: Vec<f64> = middles(points).iter().map(|(q, p)| (self.place(q) - p).norm() / self.size).collect();
        off.sort_by(f64::total_cmp);
        off.truncate(off.len() - off.len() / 6);
        off.iter().sum::<f64>() / off.len().max(1) as f64
    }

    /// Unit vector to the head's left.
    pub(super) fn left(&self) -> Vector {
        self.turn.column(0).into()
    }

    /// Unit vector to the head's back.
    pub(super) fn back(&self) -> Vector {
        self.turn.column(1).into()
    }

    /// Unit vector upwards in the head.
    pub(in crate::evaluate) fn up(&self) -> Vector {
        self.turn.column(2).into()
    }

    /// A point of the midplane.
    pub(super) fn middle(&self) -> Point {
        Point::from(self.shift)
    }

    /// The point of the midplane that is closest to the middle of `points`.
    pub(super) fn middle_near(&self, points: &[(String, Point)]) -> Point {
        let center = points.iter().map(|(_, p)| p.coords).sum::<Vector>() / points.len().max(1) as f64;
        Point::from(center - self.left() * self.left().dot(&(center - self.shift)))
    }

    /// Whether the head has a size that a head in mm can have.
    pub(super) fn has_size_of_a_head(&self) -> bool {
        (HEAD_SIZES[0]..HEAD_SIZES[1]).contains(&self.size)
    }

    /// Whether the face looks towards +y, which it does in RAS, with the top of the head up.
    pub(super) fn looks_backwards(&self) -> bool {
        self.back().y < -0.7 && self.up().z > 0.7
    }
}

/// Points of the midplane, in the average head and as given.
fn middles(points: &[(String, Point)]) -> Vec<(Point, Point)> {
    let at = |name: &str| points.iter().find(|(n, _)| n == name).map(|(_, p)| *p);
    let one = |(name, p): &(String, Point)| {
        let reference = Point::from(known(name)?.reference?);
        match name.strip_suffix("_left") {
            None if name.ends_with("_right") => None,
            None => Some((reference, *p)),
            Some(stem) => {
                let other = at(&format!("{stem}_right"))?;
                Some((Point::new(0.0, reference.y, reference.z), nalgebra::center(p, &other)))
            }
        }
    };
    points.iter().filter_map(one).collect()
}

/// The rotation nearest to a matrix; `None` when the points behind it lie on a line.
pub(super) fn nearest_turn(m: &Matrix3<f64>) -> Option<Matrix3<f64>> {
    if !m.iter().all(|v| v.is_finite()) {
        return None;
    }
    let svd = m.svd(true, true);
    let (u, v) = (svd.u?, svd.v_t?);
    // Singular values are in descending order.
    if svd.singular_values[1] <= FLAT * FLAT * svd.singular_values[0] {
        return None;
    }
    let sign = if (u * v).determinant() < 0.0 { -1.0 } else { 1.0 };
    Some(u * Matrix3::from_diagonal(&Vector::new(1.0, 1.0, sign)) * v)
}
