use super::super::MixedMesh;
use super::super::embedding::{Embedding, embed_points};
use super::super::tuning::{BEFORE_FRONT_MM, SPLIT_END_SHARE};
use super::{Opening, Slit};
use prosopon_geometry::{Point, TriMesh};

/// A skin whose triangles end at the slit.
///
/// The vertices of the skin keep their order; the new ones lie on the slit, one on either lip at each place.
#[derive(Debug, Clone, PartialEq)]
pub struct PartedSkin {
    /// The skin.
    pub skin: TriMesh,
    /// Number of vertices that the skin had before; they come first.
    pub own: usize,
    /// Whether each vertex lies on the upper lip or above it.
    pub upper: Vec<bool>,
}

prosopon_geometry::flat!(PartedSkin { skin, own, upper });

/// Cuts the triangles of `skin` that cross `slit`; `None` when there are none.
#[must_use]
pub fn part_skin(skin: &TriMesh, slit: &Slit) -> Option<PartedSkin> {
    let mut positions = skin.positions().to_vec();
    let own = positions.len();
    let heights: Vec<f64> = positions.iter().map(|p| slit.height(p)).collect();
    let mut upper: Vec<bool> = heights.iter().map(|h| *h >= 0.0).collect();
    let mut cut: Vec<([u32; 2], Point)> = Vec::new();
    for t in skin.triangles() {
        for [a, b] in [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]] {
            let (low, high) = (a.min(b), a.max(b));
            if upper[low as usize] != upper[high as usize]
                && let Some(p) = crossing(slit, &positions, &heights, [low, high])
            {
                cut.push(([low, high], p));
            }
        }
    }
    cut.sort_unstable_by_key(|c| c.0);
    cut.dedup_by_key(|c| c.0);
    if cut.is_empty() {
        return None;
    }
    for (_, p) in &cut {
        positions.extend([*p, *p]);
        upper.extend([true, false]);
    }
    // The new vertex on the edge from `a` to `b`, on the lip of `a`.
    let beside = |a: u32, b: u32| -> Option<u32> {
        let at = cut.binary_search_by_key(&[a.min(b), a.max(b)], |c| c.0).ok()?;
        Some((own + 2 * at + usize::from(!upper[a as usize])) as u32)
    };
    let mut triangles = Vec::with_capacity(skin.triangles().len() + 2 * cut.len());
    for t in skin.triangles() {
        split(*t, &beside, &mut triangles);
    }
    TriMesh::new(positions, triangles).ok().map(|skin| PartedSkin { skin, own, upper })
}

/// Point of an edge on the slit; `None` where the slit does not reach it.
fn crossing(slit: &Slit, positions: &[Point], heights: &[f64], [a, b]: [u32; 2]) -> Option<Point> {
    let ((p, q), (u, v)) = ((positions[a as usize], positions[b as usize]), (heights[a as usize], heights[b as usize]));
    let share = (u / (u - v)).clamp(SPLIT_END_SHARE, 1.0 - SPLIT_END_SHARE);
    let at = p + (q - p) * share;
    let [right, left] = slit.span();
    let is_inside = right < at.x && at.x < left;
    (is_inside && at.y > slit.front_y(at.x) - BEFORE_FRONT_MM && at.y < slit.back_y(at.x)).then_some(at)
}

/// Adds a triangle, split along its edges that are cut.
fn split(t: [u32; 3], beside: &dyn Fn(u32, u32) -> Option<u32>, out: &mut Vec<[u32; 3]>) {
    for [a, b, c] in [t, [t[1], t[2], t[0]], [t[2], t[0], t[1]]] {
        let (ab, ac) = (beside(a, b).zip(beside(b, a)), beside(a, c).zip(beside(c, a)));
        match (ab, ac) {
            // `a` is alone on its side.
            (Some((a_to_b, b_to_a)), Some((a_to_c, c_to_a))) => {
                out.extend([[a, a_to_b, a_to_c], [b_to_a, b, c], [b_to_a, c, c_to_a]]);
                return;
            }
            // The cut ends at `c`.
            (Some((a_to_b, b_to_a)), None) if beside(b, c).is_none() => {
                out.extend([[a, a_to_b, c], [b_to_a, b, c]]);
                return;
            }
            (Some(_), None) | (None, Some(_) | None) => {}
        }
    }
    out.push(t);
}

/// Finds the prism under each vertex of a parted skin, as [`embed`](super::super::embed), each lip on its own margin.
#[must_use]
pub fn embed_parted(parted: &PartedSkin, mesh: &MixedMesh, slit: &Slit, reach_mm: f64) -> Embedding {
    // Both lips lie farther apart than the reach.
    let opening = Opening::by(slit, reach_mm);
    let skin = parted.skin.positions().iter().zip(&parted.upper);
    let points: Vec<Point> = skin.map(|(p, upper)| opening.opened(p, *upper)).collect();
    let mut upper: Vec<bool> = mesh.positions.iter().map(|p| slit.height(p) >= 0.0).collect();
    for (side, is_upper) in [(0, true), (1, false)] {
        for &node in mesh.facing.iter().flat_map(|f| &f.sides[side]).flatten() {
            upper[node as usize] = is_upper;
        }
    }
    let place = |n: u32| opening.opened(&mesh.positions[n as usize], upper[n as usize]);
    let triangles: Vec<[Point; 3]> = mesh.prisms.iter().map(|p| [p[0], p[1], p[2]].map(place)).collect();
    embed_points(&points, &triangles, reach_mm)
}

#[cfg(test)]
mod tests {
    use super::super::SlitKnot;
    use super::*;
    use std::collections::BTreeMap;

    /// A sheet in the plane y = -90 of triangles with edges of 2 mm.
    fn sheet() -> TriMesh {
        const N: u32 = 31;
        let positions = (0..N * N)
            .map(|n| Point::new(2.0 * f64::from(n % N) - 30.0, -90.0, 2.0 * f64::from(n / N) - 30.3))
            .collect();
        let triangles = (0..N - 1).flat_map(|j| (0..N - 1).map(move |i| (i, j))).flat_map(|(i, j)| {
            let [a, b, c, d] = [i + N * j, i + 1 + N * j, i + 1 + N * (j + 1), i + N * (j + 1)];
            [[a, b, c], [a, c, d]]
        });
        TriMesh::new(positions, triangles.collect()).unwrap()
    }

    fn slit() -> Slit {
        let knot = |x: f64| SlitKnot { front: Point::new(x, -90.0, 1.0 - 0.003 * x * x), back_y: -80.0 };
        Slit::new([-21.0, -9.0, 0.0, 9.0, 21.0].map(knot).to_vec()).unwrap()
    }

    /// Edges with one triangle.
    fn rim(mesh: &TriMesh) -> Vec<[u32; 2]> {
        let mut edges: BTreeMap<[u32; 2], usize> = BTreeMap::new();
        for t in mesh.triangles() {
            for [a, b] in [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]] {
                *edges.entry([a.min(b), a.max(b)]).or_default() += 1;
            }
        }
        assert!(edges.values().all(|n| *n < 3));
        edges.into_iter().filter(|(_, n)| *n == 1).map(|(e, _)| e).collect()
    }

    #[test]
    fn a_parted_skin_has_the_same_shape_and_one_opening_along_the_slit() {
        let (skin, slit) = (sheet(), slit());
        let parted = part_skin(&skin, &slit).unwrap();
        assert_eq!(parted.skin.positions()[..parted.own], skin.positions()[..]);
        assert!((parted.skin.area() / skin.area() - 1.0).abs() < 1e-12);
        let before = rim(&skin).len();
        let new: Vec<_> =
            rim(&parted.skin).into_iter().filter(|e| e.iter().any(|v| *v as usize >= parted.own)).collect();
        assert_eq!(rim(&parted.skin).len(), before + new.len());
        let length = |upper: bool| -> f64 {
            let edges = new
                .iter()
                .filter(|e| e.iter().all(|v| (*v as usize) < parted.own || parted.upper[*v as usize] == upper));
            let at = |v: u32| parted.skin.positions()[v as usize];
            let inner = edges.filter(|e| e.iter().all(|v| *v as usize >= parted.own));
            inner.map(|e| (at(e[0]) - at(e[1])).norm()).sum()
        };
        // 42 mm wide and 1.3 mm high: up to a triangle at each end the arc's length, 42 (1 + 8/3 (1.323/42)²).
        for upper in [true, false] {
            assert!((38.0..42.2).contains(&length(upper)), "{}", length(upper));
        }
        let far = Slit::new(
            slit.knots().iter().map(|k| SlitKnot { front: k.front + nalgebra::Vector3::z() * 90.0, ..*k }).collect(),
        );
        assert!(part_skin(&skin, &far.unwrap()).is_none());
    }

    #[test]
    fn lips_that_part_stretch_no_triangle_over_the_gap() {
        let (skin, slit) = (sheet(), slit());
        let parted = part_skin(&skin, &slit).unwrap();
        // Both lips move apart by up to 2.5 mm each, in proportion to the distance from the corners.
        let [right, left] = slit.span();
        let moved = |mesh: &TriMesh, upper: &dyn Fn(usize, &Point) -> bool| {
            let up = |p: &Point| {
                2.5 * ((p.x - right).min(left - p.x) / 21.0).max(0.0) * (-slit.height(p).abs() / 20.0).exp()
            };
            let positions = mesh
                .positions()
                .iter()
                .enumerate()
                .map(|(v, p)| p + nalgebra::Vector3::z() * if upper(v, p) { up(p) } else { -up(p) });
            mesh.with_positions(positions.collect()).unwrap()
        };
        let stretch = |mesh: &TriMesh, rest: &TriMesh| {
            let longest = |m: &TriMesh, t: usize| {
                let [a, b, c] = m.corners(t);
                (b - a).norm().max((c - b).norm()).max((a - c).norm())
            };
            (0..mesh.triangles().len()).map(|t| longest(mesh, t) / longest(rest, t).max(0.5)).fold(0.0, f64::max)
        };
        let apart = moved(&parted.skin, &|v, _| parted.upper[v]);
        let torn = moved(&skin, &|_, p| slit.height(p) >= 0.0);
        let (found, whole) = (stretch(&apart, &parted.skin), stretch(&torn, &skin));
        assert!(found < 1.3 && whole > 2.0, "{found} {whole}");
    }
}
