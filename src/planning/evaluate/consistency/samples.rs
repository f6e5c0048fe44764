//! Points spread evenly over a surface.

use prosopon_geometry::{Point, TriMesh};

/// About `count` points of `mesh`, each for the same area; the same points for the same mesh.
pub(in crate::evaluate) fn spread(mesh: &TriMesh, count: usize) -> Vec<Point> {
    let n = mesh.triangles().len();
    let total: f64 = (0..n).map(|t| mesh.scaled_normal(t).norm()).sum();
    if total.is_nan() || total <= 0.0 {
        return Vec::new();
    }
    let each = total / count as f64;
    let (mut points, mut before) = (Vec::with_capacity(count + 1), 0.0);
    for t in 0..n {
        let after = before + mesh.scaled_normal(t).norm();
        while (points.len() as f64 + 0.5) * each < after && points.len() < count {
            points.push(within(mesh, t, points.len()));
        }
        before = after;
    }
    points
}

/// The `i`th point, in triangle `t`; successive points lie at different places of their triangles.
fn within(mesh: &TriMesh, t: usize, i: usize) -> Point {
    // Multiples of two irrational numbers spread evenly over a square (Roberts, The unreasonable effectiveness of
    // quasirandom sequences, 2018), of which the half beyond the diagonal is folded back.
    let (u, v) = ((i as f64 * 0.754_877_666_246_69).fract(), (i as f64 * 0.569_840_290_998_05).fract());
    let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
    let [a, b, c] = mesh.corners(t);
    a + (b - a) * u + (c - a) * v
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluate::nearest_bone::tests::block;

    #[test]
    fn points_lie_on_the_surface_in_proportion_to_area() {
        let mesh = block([0.0; 3], [10.0, 10.0, 30.0]);
        let points = spread(&mesh, 700);
        assert_eq!(points.len(), 700);
        let on = |p: &&Point| p.z.abs() < 1e-9;
        // One of 14 squares of 10 mm.
        assert!((45..=55).contains(&points.iter().filter(on).count()), "{}", points.iter().filter(on).count());
        assert_eq!(points, spread(&mesh, 700));
    }
}
