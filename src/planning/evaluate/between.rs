use super::{FaceRegion, Statistics, statistics};
use prosopon_geometry::{TriMesh, Vector};

/// Movement from which on skin counts as moved, mm.
const MOVED_MM: f64 = 0.1;

/// Statistics of the distance (mm) between two solutions, over the part of the face that either moves by more than 0.1 mm.
///
/// `a` and `b` are the displacements of the vertices of `skin`, mm. `None` when neither moves the face.
#[must_use]
pub fn between_solutions(skin: &TriMesh, regions: &[FaceRegion], a: &[Vector], b: &[Vector]) -> Option<Statistics> {
    let pairs = || a.iter().zip(b);
    let distances: Vec<f32> = pairs().map(|(a, b)| (a - b).norm() as f32).collect();
    let in_face = skin.positions().iter().map(|p| regions.iter().any(|r| r.contains(p)));
    let moved: Vec<bool> =
        in_face.zip(pairs()).map(|(face, (a, b))| face && a.norm().max(b.norm()) > MOVED_MM).collect();
    statistics(skin, &distances, Some(&moved))
}

#[cfg(test)]
mod tests {
    use super::*;
    use prosopon_geometry::{Aabb, Point};

    /// Four vertices of equal area: outside the face, at rest, and two that differ.
    #[test]
    fn only_skin_of_the_face_that_moves_counts() {
        let at = |x: f64| [Point::new(x, 0.0, 0.0), Point::new(x, 1.0, 0.0), Point::new(x, 0.0, 1.0)];
        let positions: Vec<Point> = [0.0, 10.0, 20.0].into_iter().flat_map(at).collect();
        let skin = TriMesh::new(positions, vec![[0, 1, 2], [3, 4, 5], [6, 7, 8]]).unwrap();
        let bounds = Aabb { min: Point::new(5.0, -1.0, -1.0), max: Point::new(30.0, 2.0, 2.0) };
        let face = FaceRegion::new("chin", bounds);
        let by = |y: [f64; 3]| y.into_iter().flat_map(|y| [Vector::y() * y; 3]).collect::<Vec<_>>();
        let (a, b) = (by([5.0, 0.05, 2.0]), by([0.0, 0.0, 1.7]));
        let found = between_solutions(&skin, std::slice::from_ref(&face), &a, &b).unwrap();
        assert_eq!(found.count, 3);
        assert!((found.p95 - 0.3).abs() < 1e-6 && (found.mean_abs - 0.3).abs() < 1e-6, "{found:?}");
        let rest = by([0.0; 3]);
        assert!(between_solutions(&skin, &[face], &rest, &rest).is_none());
    }
}
