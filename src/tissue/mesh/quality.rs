//! Shape measures of single elements.

use prosopon_geometry::{Point, Vector};

/// Edges of a tetrahedron and the other two corners.
const EDGES: [[usize; 4]; 6] = [[0, 1, 2, 3], [0, 2, 1, 3], [0, 3, 1, 2], [1, 2, 0, 3], [1, 3, 0, 2], [2, 3, 0, 1]];

/// Signed volume, mm³.
pub(super) fn tetrahedron_volume(p: &[Point; 4]) -> f64 {
    (p[1] - p[0]).cross(&(p[2] - p[0])).dot(&(p[3] - p[0])) / 6.0
}

/// Smallest sine of the six dihedral angles, negative when inverted.
/// It is small for angles near 0° and near 180°.
pub(super) fn smallest_sine(p: &[Point; 4]) -> f64 {
    let volume = tetrahedron_volume(p);
    // Twice the area of the face opposite corner i.
    let areas = [[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]]
        .map(|[a, b, c]: [usize; 3]| (p[b] - p[a]).cross(&(p[c] - p[a])).norm());
    let mut least = f64::INFINITY;
    for [i, j, k, l] in EDGES {
        // V = 2 A B sin(angle) / (3 |edge|), where A and B are the areas of the faces at the edge.
        let product = areas[k] * areas[l];
        let sine = if product > 0.0 { 6.0 * volume * (p[j] - p[i]).norm() / product } else { 0.0 };
        least = least.min(sine);
    }
    least
}

/// Smallest and largest dihedral angle, degrees.
pub(super) fn dihedral_range(p: &[Point; 4]) -> (f64, f64) {
    let (mut least, mut most) = (f64::INFINITY, f64::NEG_INFINITY);
    for [i, j, k, l] in EDGES {
        let axis = p[j] - p[i];
        let (u, v) = (axis.cross(&(p[k] - p[i])), axis.cross(&(p[l] - p[i])));
        let angle = u.cross(&v).norm().atan2(u.dot(&v)).to_degrees();
        least = least.min(angle);
        most = most.max(angle);
    }
    (least, most)
}

/// Edges that leave corner `i` of a prism as a right-handed frame: two in its triangle, one across (outwards).
fn corner_frame(p: &[Point; 6], i: usize) -> [Vector; 3] {
    let (base, at) = (i / 3 * 3, i % 3);
    [p[base + (at + 1) % 3] - p[i], p[base + (at + 2) % 3] - p[i], p[at] - p[at + 3]]
}

fn scaled([a, b, c]: [Vector; 3]) -> f64 {
    let size = a.norm() * b.norm() * c.norm();
    // The edges of a regular triangle form 60°. The scale makes a right prism on it 1, as Verdict does for wedges.
    if size > 0.0 { a.cross(&b).dot(&c) / size * (2.0 / 3f64.sqrt()) } else { 0.0 }
}

/// Smallest scaled Jacobian at the six corners of the linear wedge.
/// It is 1 for a right prism on a regular triangle and at most 0 when inverted at a corner. Corners are ordered as in
/// [`MixedMesh::prisms`](super::MixedMesh::prisms).
pub(super) fn scaled_jacobian(p: &[Point; 6]) -> f64 {
    (0..6).map(|i| scaled(corner_frame(p, i))).fold(f64::INFINITY, f64::min).min(1.0)
}

/// Like [`scaled_jacobian`], for the outer corners of a prism whose outer face is curved and tangent to the planes with these
/// unit normals at its corners.
pub(super) fn scaled_jacobian_curved(p: &[Point; 6], normals: &[Vector; 3]) -> f64 {
    let mut least: f64 = 1.0;
    for i in 0..3 {
        let [a, b, c] = corner_frame(p, i);
        let n = normals[i];
        least = least.min(scaled([a - n * n.dot(&a), b - n * n.dot(&b), c]));
    }
    least
}

/// Jacobian determinants of the linear wedge at six quadrature points with equal weights: three in the triangle by two across.
/// Their mean times 1/2 is the exact volume (degree 2 across, 1 in the triangle).
pub(super) fn wedge_determinants(p: &[Point; 6]) -> [f64; 6] {
    let across = 0.5 / 3f64.sqrt();
    let mut out = [0.0; 6];
    for (k, q) in [0.5 - across, 0.5 + across].into_iter().enumerate() {
        for corner in 0..3 {
            let mut l = [1.0 / 6.0; 3];
            l[corner] = 2.0 / 3.0;
            // q = 1 on the outer triangle.
            let at = |i: usize| p[i].coords * q + p[i + 3].coords * (1.0 - q);
            let (r, s) = (at(1) - at(0), at(2) - at(0));
            let up = (0..3).fold(Vector::zeros(), |sum, i| sum + (p[i] - p[i + 3]) * l[i]);
            out[3 * k + corner] = r.cross(&s).dot(&up);
        }
    }
    out
}

/// Volume of the linear wedge, mm³.
pub(super) fn wedge_volume(p: &[Point; 6]) -> f64 {
    wedge_determinants(p).iter().sum::<f64>() / 12.0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn points<const N: usize>(p: [[f64; 3]; N]) -> [Point; N] {
        p.map(Point::from)
    }

    #[test]
    fn regular_tetrahedron() {
        let p = points([[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]]);
        let angle = (1f64 / 3.0).acos();
        let (least, most) = dihedral_range(&p);
        assert!((least - angle.to_degrees()).abs() < 1e-9 && (most - angle.to_degrees()).abs() < 1e-9);
        let volume = tetrahedron_volume(&p);
        assert!((volume.abs() - 8.0 / 3.0).abs() < 1e-12);
        assert!((smallest_sine(&p) - volume.signum() * angle.sin()).abs() < 1e-12);
    }

    #[test]
    fn right_prism_is_perfect_and_a_swapped_one_is_inverted() {
        let h = 0.75f64.sqrt();
        let p =
            points([[0.0, 0.0, 2.0], [1.0, 0.0, 2.0], [0.5, h, 2.0], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, h, 0.0]]);
        assert!((scaled_jacobian(&p) - 1.0).abs() < 1e-12);
        assert!((scaled_jacobian_curved(&p, &[Vector::z(); 3]) - 1.0).abs() < 1e-12);
        assert!((wedge_volume(&p) - h).abs() < 1e-12);
        let swapped = [p[0], p[2], p[1], p[3], p[5], p[4]];
        assert!(scaled_jacobian(&swapped) < 0.0);
        assert!(wedge_determinants(&swapped).iter().all(|d| *d < 0.0));
    }

    #[test]
    fn volume_of_a_frustum() {
        // Triangular frustum of height 1, bottom area 1/2, top scaled by 2: (A + B + sqrt(A B)) / 3.
        let p = points([
            [0.0, 0.0, 1.0],
            [2.0, 0.0, 1.0],
            [0.0, 2.0, 1.0],
            [0.0, 0.0, 0.0],
            [1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
        ]);
        assert!((wedge_volume(&p) - (0.5 + 2.0 + 1.0) / 3.0).abs() < 1e-12);
    }
}
