//! Triangles of a marching-cubes cell for each of its 256 sign patterns, computed instead of tabulated.

use std::sync::LazyLock;

/// How the surface crosses a cell with a given sign pattern.
#[derive(Debug, Default)]
pub(super) struct CellCase {
    /// Corners of each triangle: 0 to 11 is the vertex on that cell edge, `12 + n` is centre `n`.
    pub(super) triangles: Vec<[u8; 3]>,
    /// Extra vertices; each is the mean of the vertices on the listed cell edges.
    pub(super) centers: Vec<Vec<u8>>,
}

/// Cases indexed by sign pattern: bit `c` is set when corner `c` (bit 0 is x, bit 1 y, bit 2 z) is inside.
pub(super) static CASES: LazyLock<Vec<CellCase>> = LazyLock::new(|| (0..=255).map(cell_case).collect());

/// Lower and upper corner of a cell edge.
///
/// Edge `4 axis + m` runs along `axis` from the corner given by `m` in the other two axes (lower axis in bit 0).
pub(super) fn edge_corners(edge: usize) -> [usize; 2] {
    let axis = edge / 4;
    let (u, v) = other_axes(axis);
    let low = ((edge & 1) << u) | (((edge >> 1) & 1) << v);
    [low, low | (1 << axis)]
}

fn other_axes(axis: usize) -> (usize, usize) {
    match axis {
        0 => (1, 2),
        1 => (0, 2),
        _ => (0, 1),
    }
}

fn edge_between(a: usize, b: usize) -> usize {
    let low = a.min(b);
    let axis = (a ^ b).trailing_zeros() as usize;
    let (u, v) = other_axes(axis);
    4 * axis + ((low >> u) & 1) + 2 * ((low >> v) & 1)
}

/// Corners of a face, counter-clockwise seen from outside the cell.
fn face_corners(axis: usize, side: usize) -> [usize; 4] {
    let (u, v) = (1 << ((axis + 1) % 3), 1 << ((axis + 2) % 3));
    let base = side << axis;
    if side == 1 { [base, base + u, base + u + v, base + v] } else { [base, base + v, base + v + u, base + u] }
}

fn share_a_face(a: u8, b: u8) -> bool {
    let [a0, a1] = edge_corners(a as usize);
    let [b0, b1] = edge_corners(b as usize);
    let all_equal = |bit: usize| (a0 & bit) == (a1 & bit) && (b0 & bit) == (b1 & bit) && (a0 & bit) == (b0 & bit);
    [1, 2, 4].into_iter().any(all_equal)
}

/// For each cut edge, the next cut edge around the surface polygon.
///
/// Seen from outside the cell the solid is on the right, so that polygons are counter-clockwise seen from outside the solid.
///
/// On a face with two diagonally opposite inside corners, these are joined. The rule depends only on the face's own corners,
/// so both cells at the face draw the same segments: this makes the surface closed.
fn next_edges(pattern: usize) -> [Option<u8>; 12] {
    let mut next = [None; 12];
    let inside = |c: usize| pattern >> c & 1 == 1;
    for (axis, side) in (0..3).flat_map(|a| [(a, 0), (a, 1)]) {
        let corners = face_corners(axis, side);
        for i in 0..4 {
            let entering = !inside(corners[i]) && inside(corners[(i + 1) % 4]);
            if !entering {
                continue;
            }
            // Walks back over the outside corners to the edge at which the boundary of the face left the solid.
            let mut j = i;
            while !inside(corners[(j + 3) % 4]) {
                j = (j + 3) % 4;
            }
            let start = edge_between(corners[i], corners[(i + 1) % 4]);
            next[start] = Some(edge_between(corners[(j + 3) % 4], corners[j]) as u8);
        }
    }
    next
}

/// Triangulates a polygon without diagonals that lie in a face of the cell; `None` when that is impossible.
///
/// The neighbouring cell could draw the same diagonal, which would then have four triangles.
fn triangulate(polygon: &[u8]) -> Option<Vec<[u8; 3]>> {
    let n = polygon.len();
    if n < 3 {
        return Some(Vec::new());
    }
    let allowed = |a: usize, b: usize| a.abs_diff(b) == 1 || !share_a_face(polygon[a], polygon[b]);
    for apex in 1..n - 1 {
        if !allowed(0, apex) || !allowed(apex, n - 1) {
            continue;
        }
        if let (Some(left), Some(right)) = (triangulate(&polygon[..=apex]), triangulate(&polygon[apex..])) {
            let mut triangles = left;
            triangles.push([polygon[0], polygon[apex], polygon[n - 1]]);
            triangles.extend(right);
            return Some(triangles);
        }
    }
    None
}

fn cell_case(pattern: usize) -> CellCase {
    let mut next = next_edges(pattern);
    let mut case = CellCase::default();
    for first in 0..12u8 {
        let mut polygon = Vec::new();
        let mut edge = first;
        while let Some(following) = next[edge as usize].take() {
            polygon.push(edge);
            edge = following;
        }
        if polygon.is_empty() {
            continue;
        }
        match triangulate(&polygon) {
            Some(triangles) => case.triangles.extend(triangles),
            None => {
                let center = 12 + case.centers.len() as u8;
                let n = polygon.len();
                case.triangles.extend((0..n).map(|i| [polygon[i], polygon[(i + 1) % n], center]));
                case.centers.push(polygon);
            }
        }
    }
    case
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_cut_edge_lies_on_exactly_one_polygon() {
        for pattern in 0..256usize {
            let cut = |e: usize| edge_corners(e).map(|c| pattern >> c & 1).iter().sum::<usize>() == 1;
            let mut seen = [0; 12];
            for e in next_edges(pattern).into_iter().flatten() {
                seen[e as usize] += 1;
            }
            for e in 0..12 {
                assert_eq!(seen[e], usize::from(cut(e)), "pattern {pattern:08b}, edge {e}");
            }
        }
    }

    #[test]
    fn edges_are_numbered_consistently() {
        for e in 0..12 {
            let [a, b] = edge_corners(e);
            assert_eq!(edge_between(a, b), e);
        }
    }

    #[test]
    fn few_patterns_need_a_centre() {
        let with_center = CASES.iter().filter(|c| !c.centers.is_empty()).count();
        assert!(with_center <= 32, "{with_center} patterns");
        assert!(CASES.iter().all(|c| c.triangles.len() <= 12));
    }
}
