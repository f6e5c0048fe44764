//! Triangles of one surface that cross each other.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering::Relaxed};

use parry3d_f64::bounding_volume::Aabb as Bounds;
use parry3d_f64::math::Vector as Corner;
use parry3d_f64::partitioning::{Bvh, BvhBuildStrategy};
use rayon::prelude::*;

use super::triangle_intersection::{segment_meets, triangles_meet};
use super::{Point, TriMesh};

/// Most pairs of overlapping boxes per triangle, on average, before the search gives up.
///
/// Surfaces of heads need 14 to 18. In a crafted surface every box may overlap every other.
const MAX_PAIRS: usize = 100;

/// For each triangle whether it crosses another one; `None` when too many bounding boxes overlap.
///
/// Two triangles without a common vertex cross when they have a common point, even if they only touch. Two triangles with
/// one common vertex cross when the side opposite that vertex in one meets the other. Two triangles that share an edge do
/// not count; two copies of one triangle do. These are VCGlib's rules, so that counts compare with MeshLab's.
pub(super) fn crossing_triangles(mesh: &TriMesh) -> Option<Vec<bool>> {
    let triangles = mesh.triangles();
    // Made anew for each query: a list of them takes as much memory as the mesh.
    let bounds = |t: usize| {
        let [a, b, c] = mesh.corners(t);
        let corner = |p: Point| Corner::new(p.x, p.y, p.z);
        Bounds::new(corner(a.inf(&b).inf(&c)), corner(a.sup(&b).sup(&c)))
    };
    let tree = Bvh::from_iter(BvhBuildStrategy::Binned, (0..triangles.len()).map(|t| (t, bounds(t))));
    let budget = triangles.len().saturating_mul(MAX_PAIRS);
    let pairs = AtomicUsize::new(0);
    let crosses: Vec<AtomicBool> = triangles.iter().map(|_| AtomicBool::new(false)).collect();
    let is_marked = |t: usize| crosses[t].load(Relaxed);
    // Marks are only ever set, and a pair is left out only when both its triangles are marked: the result does not depend on
    // the order, nor does whether the number of pairs exceeds the budget.
    (0..triangles.len()).into_par_iter().with_min_len(1024).try_for_each(|one| {
        let mut found = 0;
        for other in tree.intersect_aabb(&bounds(one)) {
            let other = other as usize;
            found += 1;
            // Tests each pair once.
            if other > one && !(is_marked(one) && is_marked(other)) && cross(mesh, one, other) {
                crosses[one].store(true, Relaxed);
                crosses[other].store(true, Relaxed);
            }
        }
        (pairs.fetch_add(found, Relaxed) + found <= budget).then_some(())
    })?;
    Some(crosses.into_iter().map(AtomicBool::into_inner).collect())
}

fn cross(mesh: &TriMesh, one: usize, other: usize) -> bool {
    let (a, b) = (mesh.triangles()[one], mesh.triangles()[other]);
    let shared = |t: [u32; 3], of: [u32; 3]| t.map(|v| of.contains(&v));
    let (in_a, in_b) = (shared(a, b), shared(b, a));
    let (p, q) = (mesh.corners(one), mesh.corners(other));
    let opposite = |corners: &[Point; 3], shared: [bool; 3]| {
        let at = shared.iter().position(|s| *s).unwrap_or(0);
        [corners[(at + 1) % 3], corners[(at + 2) % 3]]
    };
    match in_a.iter().filter(|s| **s).count() {
        0 => triangles_meet(&p, &q),
        1 => {
            let ([p0, p1], [q0, q1]) = (opposite(&p, in_a), opposite(&q, in_b));
            segment_meets(&p0, &p1, &q) || segment_meets(&q0, &q1, &p)
        }
        2 => false,
        _ => true,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Vector;

    fn soup(corners: &[[f64; 3]]) -> TriMesh {
        let positions = corners.iter().map(|[x, y, z]| Point::new(*x, *y, *z)).collect();
        let triangles = (0..corners.len() as u32 / 3).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
        TriMesh::new(positions, triangles).unwrap()
    }

    fn normal(t: &[Point; 3]) -> Vector {
        (t[1] - t[0]).cross(&(t[2] - t[0]))
    }

    /// Interval that a triangle covers on `line`, the intersection of both planes, in floating point (Möller 1997).
    fn interval(t: &[Point; 3], other: &[Point; 3], line: &Vector) -> Option<[f64; 2]> {
        let height = t.map(|p| normal(other).dot(&(p - other[0])));
        let mut ends = Vec::new();
        for i in 0..3 {
            let j = (i + 1) % 3;
            if height[i] * height[j] < 0.0 {
                let cut = t[i] + (t[j] - t[i]) * (height[i] / (height[i] - height[j]));
                ends.push(line.dot(&cut.coords));
            }
        }
        let [a, b] = ends[..] else { return None };
        Some([a.min(b), a.max(b)])
    }

    /// Pseudo-random number, uniform in 0 to 10, the same on every run.
    fn random(state: &mut u64) -> f64 {
        *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (*state >> 11) as f64 / (1u64 << 53) as f64 * 10.0
    }

    #[test]
    fn the_tree_finds_what_all_pairs_by_another_method_give() {
        let mut state = 1;
        for _ in 0..100 {
            let mut point = |size: f64| [(); 3].map(|()| size * random(&mut state));
            let mut corners = Vec::new();
            for _ in 0..20 {
                let [x, y, z] = point(1.0);
                corners.extend([(); 3].map(|()| point(0.5)).map(|[u, v, w]| [x + u, y + v, z + w]));
            }
            let mesh = soup(&corners);
            let meet = |a: usize, b: usize| {
                let (p, q) = (mesh.corners(a), mesh.corners(b));
                let line = normal(&p).cross(&normal(&q));
                match (interval(&p, &q, &line), interval(&q, &p, &line)) {
                    (Some(i), Some(j)) => i[0].max(j[0]) <= i[1].min(j[1]),
                    _ => false,
                }
            };
            let expected = (0..20).map(|a| (0..20).any(|b| a != b && meet(a, b))).collect();
            assert_eq!(crossing_triangles(&mesh), Some(expected));
        }
    }

    #[test]
    fn neighbours_count_only_where_they_pass_through_each_other() {
        let points = [[0., 0., 0.], [2., 0., 0.], [0., 2., 0.], [-2., 0., 0.], [1., 0.5, -1.], [1., 0.5, 1.]];
        let positions: Vec<Point> = points.iter().map(|[x, y, z]| Point::new(*x, *y, *z)).collect();
        let crossing = |triangles: &[[u32; 3]]| {
            crossing_triangles(&TriMesh::new(positions.clone(), triangles.to_vec()).unwrap()).unwrap()
        };
        assert_eq!(crossing(&[[0, 1, 2], [0, 2, 3]]), [false, false]); // an edge in common
        assert_eq!(crossing(&[[0, 1, 2], [0, 3, 5]]), [false, false]); // a vertex in common
        assert_eq!(crossing(&[[0, 1, 2], [0, 4, 5]]), [true, true]); // a vertex in common, one passes through the other
        assert_eq!(crossing(&[[0, 1, 2], [2, 1, 0]]), [true, true]); // copies
    }

    #[test]
    fn a_bundle_of_needles_is_given_up_in_time() {
        // Parallel needles along the diagonal: every box overlaps most others, no needle meets another.
        let mut corners = Vec::new();
        for i in 0..3000 {
            let (x, y) = (f64::from(i % 55) * 1e-3, f64::from(i / 55) * 1e-3);
            corners.extend([[x, y, 0.0], [x + 1e-5, y, 0.0], [x + 100.0, y + 100.0, 100.0]]);
        }
        assert_eq!(crossing_triangles(&soup(&corners)), None);
    }
}
