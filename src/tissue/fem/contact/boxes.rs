//! A tree of boxes around the triangles of a surface that moves.

use prosopon_geometry::Vector;

/// Triangles in one leaf.
const LEAF: usize = 4;

/// Least and greatest corner of a box.
pub(super) type Bounds = [Vector; 2];

/// Box of some points.
pub(super) fn bounds(points: &[Vector]) -> Bounds {
    points.iter().fold([Vector::repeat(f64::INFINITY), Vector::repeat(f64::NEG_INFINITY)], |[low, high], p| {
        [low.inf(p), high.sup(p)]
    })
}

/// The box, wider by `by` mm on every side.
pub(super) fn widened([low, high]: Bounds, by: f64) -> Bounds {
    [low.add_scalar(-by), high.add_scalar(by)]
}

fn overlap(a: &Bounds, b: &Bounds) -> bool {
    (0..3).all(|i| a[0][i] <= b[1][i] && b[0][i] <= a[1][i])
}

/// A part of the tree: its triangles, and where its second half begins (0 for a leaf). The first half follows it.
#[derive(Debug, Clone, Copy)]
struct Part {
    begin: usize,
    end: usize,
    second: usize,
}

/// The tree without its boxes. It is built once; the boxes are computed anew when the triangles have moved.
#[derive(Debug, Clone, Default)]
pub(super) struct BoxTree {
    order: Vec<u32>,
    parts: Vec<Part>,
}

impl BoxTree {
    /// A tree over triangles with these `centres`.
    pub(super) fn new(centres: &[Vector]) -> Self {
        let mut tree = Self { order: (0..centres.len() as u32).collect(), parts: Vec::new() };
        if !centres.is_empty() {
            tree.split(centres, 0, centres.len());
        }
        tree
    }

    fn split(&mut self, centres: &[Vector], begin: usize, end: usize) {
        let part = self.parts.len();
        self.parts.push(Part { begin, end, second: 0 });
        if end - begin <= LEAF {
            return;
        }
        let points: Vec<Vector> = self.order[begin..end].iter().map(|t| centres[*t as usize]).collect();
        let [low, high] = bounds(&points);
        let axis = (high - low).imax();
        self.order[begin..end].sort_by(|a, b| {
            let along = |t: &u32| centres[*t as usize][axis];
            along(a).total_cmp(&along(b)).then(a.cmp(b))
        });
        let middle = begin.midpoint(end);
        self.split(centres, begin, middle);
        self.parts[part].second = self.parts.len();
        self.split(centres, middle, end);
    }

    /// Boxes of all parts when each triangle has the box `of`.
    pub(super) fn boxes(&self, of: impl Fn(u32) -> Bounds) -> Vec<Bounds> {
        let mut boxes = vec![bounds(&[]); self.parts.len()];
        for (i, part) in self.parts.iter().enumerate().rev() {
            boxes[i] = if part.second == 0 {
                self.order[part.begin..part.end].iter().map(|t| of(*t)).fold(bounds(&[]), joined)
            } else {
                joined(boxes[i + 1], boxes[part.second])
            };
        }
        boxes
    }

    /// Calls `found` for each triangle whose part overlaps `wanted`.
    pub(super) fn query(&self, boxes: &[Bounds], wanted: &Bounds, mut found: impl FnMut(u32)) {
        let mut open = if self.parts.is_empty() { Vec::new() } else { vec![0] };
        while let Some(i) = open.pop() {
            let Part { begin, end, second } = self.parts[i];
            if !overlap(&boxes[i], wanted) {
                continue;
            }
            if second == 0 {
                self.order[begin..end].iter().for_each(|t| found(*t));
            } else {
                open.extend([second, i + 1]);
            }
        }
    }
}

fn joined(a: Bounds, b: Bounds) -> Bounds {
    [a[0].inf(&b[0]), a[1].sup(&b[1])]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_query_finds_all_that_overlap() {
        let noise = |i: usize, k: f64| 10.0 * (i as f64 * k).sin();
        let centres: Vec<Vector> = (0..97).map(|i| Vector::new(noise(i, 1.1), noise(i, 2.3), noise(i, 0.7))).collect();
        let tree = BoxTree::new(&centres);
        // The triangles have moved since the tree was built.
        let of = |t: u32| widened([centres[t as usize] + Vector::x(); 2], 0.5);
        let boxes = tree.boxes(of);
        for i in 0..20 {
            let wanted = widened([Vector::new(noise(i, 0.9), noise(i, 1.9), noise(i, 3.1)); 2], 3.0);
            let mut found = Vec::new();
            tree.query(&boxes, &wanted, |t| found.push(t));
            let all = (0..97u32).filter(|t| overlap(&of(*t), &wanted));
            assert!(all.into_iter().all(|t| found.contains(&t)) && found.len() < 97);
        }
    }
}
