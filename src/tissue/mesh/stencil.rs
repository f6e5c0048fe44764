//! Clips one tetrahedron of the snapped lattice by the sign of the values at its vertices.

/// A vertex of a lattice tetrahedron: its node and its value (0 after snapping).
#[derive(Debug, Clone, Copy)]
pub(super) struct Corner {
    pub(super) node: u32,
    pub(super) value: f64,
}

/// Appends the negative part of a tetrahedron to `out` as tetrahedra of either orientation.
///
/// `cut(a, b)` is the node on the edge between a negative `a` and a positive `b`. The diagonal of a quadrilateral on a lattice
/// face starts at its more negative vertex (the lower index when equal). Both tetrahedra at the face then choose the same
/// diagonal, the total order prevents cyclic wedges, and the diagonal is mostly the shorter one. `shorter(a, b, c, d)` returns
/// whether to use the diagonal `a c` of the free quadrilateral `a b c d` on the surface.
pub(super) fn cut_tetrahedron(
    corners: [Corner; 4],
    cut: impl Fn(u32, u32) -> u32,
    shorter: impl Fn([u32; 4]) -> bool,
    out: &mut Vec<[u32; 4]>,
) {
    let mut sorted = corners;
    sorted.sort_by(|a, b| a.value.total_cmp(&b.value).then(a.node.cmp(&b.node)));
    let negative = sorted.iter().filter(|c| c.value < 0.0).count();
    let positive = sorted.iter().filter(|c| c.value > 0.0).count();
    let [a, b, c, d] = sorted.map(|c| c.node);
    match (negative, positive) {
        (0, _) => {}
        (_, 0) => out.push([a, b, c, d]),
        (1, 1) => out.push([a, b, c, cut(a, d)]),
        (1, 2) => out.push([a, b, cut(a, c), cut(a, d)]),
        (1, _) => out.push([a, cut(a, b), cut(a, c), cut(a, d)]),
        (2, 1) => {
            let (ad, bd) = (cut(a, d), cut(b, d));
            out.push([c, a, b, bd]);
            out.push([c, a, bd, ad]);
        }
        (2, _) => {
            let [ac, ad, bc, bd] = [cut(a, c), cut(a, d), cut(b, c), cut(b, d)];
            out.push([a, b, bc, bd]);
            if shorter([ac, ad, bd, bc]) {
                out.push([a, ac, ad, bd]);
                out.push([a, ac, bd, bc]);
            } else {
                out.push([a, ac, ad, bc]);
                out.push([a, ad, bd, bc]);
            }
        }
        (_, _) => {
            let [ad, bd, cd] = [cut(a, d), cut(b, d), cut(c, d)];
            out.push([a, b, c, cd]);
            out.push([a, b, cd, bd]);
            out.push([a, bd, cd, ad]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use prosopon_geometry::Point;
    use std::cell::RefCell;

    fn volume(p: [Point; 4]) -> f64 {
        (p[1] - p[0]).cross(&(p[2] - p[0])).dot(&(p[3] - p[0])).abs() / 6.0
    }

    /// The pieces of a linear function's negative part add up to its exact share of the tetrahedron.
    #[test]
    fn pieces_fill_the_negative_part() {
        let p = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.2, 1.1, 0.0], [0.3, 0.2, 0.9]].map(Point::from);
        let whole = volume(p);
        for values in [
            [-1.0, 1.0, 2.0, 0.7],
            [-1.0, -0.3, 2.0, 0.7],
            [-1.0, -0.3, -0.5, 0.7],
            [-1.0, 0.0, 2.0, 0.7],
            [-1.0, -0.4, 0.0, 0.7],
            [-1.0, 0.0, 0.0, 0.7],
            [-1.0, 0.0, 0.0, 0.0],
            [-1.0, -2.0, -0.1, 0.0],
        ] {
            let nodes = RefCell::new(p.to_vec());
            let keys = RefCell::new(Vec::new());
            let cut = |a: u32, b: u32| {
                if let Some(at) = keys.borrow().iter().position(|k| *k == (a, b)) {
                    return 4 + at as u32;
                }
                let (a_at, b_at) = (a as usize, b as usize);
                let t = values[a_at] / (values[a_at] - values[b_at]);
                nodes.borrow_mut().push(p[a_at] + (p[b_at] - p[a_at]) * t);
                keys.borrow_mut().push((a, b));
                3 + keys.borrow().len() as u32
            };
            for flag in [false, true] {
                let mut out = Vec::new();
                let corners = [0, 1, 2, 3].map(|i| Corner { node: i as u32, value: values[i] });
                cut_tetrahedron(corners, cut, |_| flag, &mut out);
                let nodes = nodes.borrow();
                let filled: f64 = out.iter().map(|t| volume(t.map(|n| nodes[n as usize]))).sum();
                let share = negative_share(values);
                assert!((filled / whole - share).abs() < 1e-6, "{values:?}: {} against {share}", filled / whole);
            }
        }
    }

    /// Share of a tetrahedron where the linear function with these corner values is negative (divided differences).
    fn negative_share(values: [f64; 4]) -> f64 {
        // Share = sum over negative i of v_i^3 / prod (v_i - v_j). A tiny shift makes the values distinct without changing the
        // result noticeably.
        let v: Vec<f64> =
            values.iter().enumerate().map(|(i, v)| if *v == 0.0 { 1e-7 * i as f64 } else { *v }).collect();
        (0..4)
            .filter(|&i| v[i] < 0.0)
            .map(|i| v[i].powi(3) / (0..4).filter(|&j| j != i).map(|j| v[i] - v[j]).product::<f64>())
            .sum()
    }
}
