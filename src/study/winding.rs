use prosopon_geometry::{Point, TriMesh, Vector};

/// Largest number of triangles in a leaf.
const LEAF: usize = 8;
/// Largest truncation error (solid angle) of one far group in the first attempt; each further attempt allows a hundredth of it.
const ALLOWED: f64 = 1e-5;

/// Neighbouring triangles and the expansion of their far field.
#[derive(Debug)]
struct Group {
    first: u32,
    last: u32,
    /// Index of the second child, 0 for a leaf; the first child directly follows its parent.
    second: u32,
    center: Point,
    radius: f64,
    /// Sum of areas times normals, mm².
    normal: Vector,
    /// Symmetric part of ∫ (x - center) nᵀ: xx, yy, zz, xy, xz, yz, mm³.
    moment: [f64; 6],
    /// Bound on ∫ |x - center|², mm⁴.
    second_moment: f64,
}

/// Winding number w of a triangle soup with a proven sign of |w| - ½.
///
/// Far groups contribute their Taylor expansion to first order. The second derivatives of x/|x|³ are third derivatives of
/// 1/|x| and at most 3!/|x|⁴, so the truncation error of a group is at most 3 ∫|x - c|² / (r - R)⁴. The bounds are summed.
/// When the sum does not decide on which side of ½ the number lies, the winding number is computed again with smaller
/// errors, in the end without any.
#[derive(Debug)]
pub(super) struct ProvenWinding {
    corners: Vec<[Point; 3]>,
    groups: Vec<Group>,
}

impl ProvenWinding {
    pub(super) fn new(mesh: &TriMesh) -> Self {
        let mut corners: Vec<[Point; 3]> = (0..mesh.triangles().len()).map(|t| mesh.corners(t)).collect();
        let mut groups = Vec::new();
        group(&mut corners, 0, &mut groups);
        Self { corners, groups }
    }

    /// Whether `q` is inside, that is |w| > ½; proven except for rounding.
    pub(super) fn is_inside(&self, q: &Point) -> bool {
        let mut allowed = ALLOWED;
        loop {
            let (winding, bound) = self.at(q, allowed);
            let apart = winding.abs() - 0.5;
            // A bound of zero means that no group was expanded.
            if apart.abs() > bound || bound == 0.0 || allowed < 1e-30 {
                return apart > 0.0;
            }
            allowed *= 1e-2;
        }
    }

    /// Winding number at `q` and a bound on its truncation error, when each far group may have the error `allowed`.
    fn at(&self, q: &Point, allowed: f64) -> (f64, f64) {
        let (mut sum, mut bound) = (0.0, 0.0);
        let mut stack = vec![0u32];
        while let Some(index) = stack.pop() {
            let g = &self.groups[index as usize];
            let r = g.center - q;
            let distance = r.norm();
            let gap = distance - g.radius;
            let error = 3.0 * g.second_moment / gap.powi(4);
            if gap > 0.0 && error <= allowed {
                sum += g.far_field(&r, distance);
                bound += error;
            } else if g.second == 0 {
                sum += self.corners[g.first as usize..g.last as usize].iter().map(|c| solid_angle(q, c)).sum::<f64>();
            } else {
                stack.push(g.second);
                stack.push(index + 1);
            }
        }
        let full = 4.0 * std::f64::consts::PI;
        (sum / full, bound / full)
    }
}

impl Group {
    fn far_field(&self, r: &Vector, distance: f64) -> f64 {
        let [xx, yy, zz, xy, xz, yz] = self.moment;
        let quadratic =
            xx * r.x * r.x + yy * r.y * r.y + zz * r.z * r.z + 2.0 * (xy * r.x * r.y + xz * r.x * r.z + yz * r.y * r.z);
        let distance_sq = distance * distance;
        (self.normal.dot(r) + (xx + yy + zz) - 3.0 * quadratic / distance_sq) / (distance_sq * distance)
    }
}

fn group(corners: &mut [[Point; 3]], first: u32, groups: &mut Vec<Group>) {
    let index = groups.len();
    groups.push(summed(corners, first));
    if corners.len() <= LEAF {
        return;
    }
    let middles = corners.iter().map(middle);
    let (low, high) = middles.fold((middle(&corners[0]), middle(&corners[0])), |(l, h), p| (l.inf(&p), h.sup(&p)));
    let axis = (high - low).imax();
    let half = corners.len() / 2;
    corners.select_nth_unstable_by(half, |a, b| middle(a)[axis].total_cmp(&middle(b)[axis]));
    let (left, right) = corners.split_at_mut(half);
    group(left, first, groups);
    let second = groups.len() as u32;
    groups[index].second = second;
    group(right, first + half as u32, groups);
}

fn middle([a, b, c]: &[Point; 3]) -> Point {
    a + ((b - a) + (c - a)) / 3.0
}

fn summed(corners: &[[Point; 3]], first: u32) -> Group {
    let scaled = |c: &[Point; 3]| (c[1] - c[0]).cross(&(c[2] - c[0])) * 0.5;
    let area: f64 = corners.iter().map(|c| scaled(c).norm()).sum();
    let origin = corners[0][0];
    let offset: Vector = corners.iter().map(|c| (middle(c) - origin) * scaled(c).norm()).sum();
    let center = if area > 0.0 { origin + offset / area } else { origin };
    let mut g = Group {
        first,
        last: first + corners.len() as u32,
        second: 0,
        center,
        radius: 0.0,
        normal: Vector::zeros(),
        moment: [0.0; 6],
        second_moment: 0.0,
    };
    for c in corners {
        let (n, e) = (scaled(c), middle(c) - center);
        g.normal += n;
        g.moment[0] += e.x * n.x;
        g.moment[1] += e.y * n.y;
        g.moment[2] += e.z * n.z;
        g.moment[3] += 0.5 * (e.x * n.y + e.y * n.x);
        g.moment[4] += 0.5 * (e.x * n.z + e.z * n.x);
        g.moment[5] += 0.5 * (e.y * n.z + e.z * n.y);
        // A convex function on a triangle is largest at a corner.
        let farthest = c.iter().map(|p| (p - center).norm_squared()).fold(0.0, f64::max);
        g.second_moment += n.norm() * farthest;
        g.radius = g.radius.max(farthest.sqrt());
    }
    g
}

/// Solid angle of the triangle seen from `p`, positive when seen from its back (van Oosterom and Strackee 1983).
fn solid_angle(p: &Point, corners: &[Point; 3]) -> f64 {
    let [a, b, c] = corners.map(|q| q - p);
    let determinant = a.dot(&b.cross(&c));
    if determinant == 0.0 {
        return 0.0;
    }
    let (la, lb, lc) = (a.norm(), b.norm(), c.norm());
    2.0 * determinant.atan2(la * lb * lc + a.dot(&b) * lc + b.dot(&c) * la + c.dot(&a) * lb)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers in [0, 1), the same on every run.
    fn random(state: &mut u64) -> f64 {
        *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (*state >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Triangles around a ball, each a little off: open everywhere.
    fn soup() -> TriMesh {
        let mut state = 1;
        let mut positions = Vec::new();
        for _ in 0..600 {
            let mut unit = || 2.0 * random(&mut state) - 1.0;
            let normal = Vector::new(unit(), unit(), unit()).normalize();
            let u = normal.cross(&Vector::new(unit(), unit(), unit())).normalize();
            let v = normal.cross(&u);
            let middle = Point::from(normal * (10.0 + 0.2 * unit()));
            positions.extend([middle + u, middle + v - u * 0.5, middle - v - u * 0.5]);
        }
        let triangles = (0..600).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
        TriMesh::new(positions, triangles).unwrap()
    }

    #[test]
    fn the_bound_holds_against_the_full_sum() {
        let mesh = soup();
        let proven = ProvenWinding::new(&mesh);
        let mut state = 2;
        let mut shortened = 0;
        for _ in 0..500 {
            let q = Point::from(Vector::from_fn(|_, _| 40.0 * random(&mut state) - 20.0));
            let full: f64 =
                (0..600).map(|t| solid_angle(&q, &mesh.corners(t))).sum::<f64>() / (4.0 * std::f64::consts::PI);
            for allowed in [1e-2, 1e-4, 1e-6] {
                let (winding, bound) = proven.at(&q, allowed);
                assert!((winding - full).abs() <= bound + 1e-12, "{winding} {full} {bound}");
                shortened += usize::from(bound > 0.0);
            }
            assert_eq!(proven.is_inside(&q), full.abs() > 0.5);
        }
        assert!(shortened > 500);
    }
}
