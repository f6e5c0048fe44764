//! Closed surfaces of segments from the grid nodes that belong to them.

use super::lattice::{lattice, neighbours};
use super::osteotomy::Segment;
use super::separation::Separation;
use prosopon_geometry::control::{Cancelled, Control};
use prosopon_geometry::{Point, ScalarGrid, TriMesh, Vector, isosurface};

/// All segments with their surfaces; `segment` holds the segment number of each grid node.
pub(super) fn segments(
    grid: &ScalarGrid,
    segment: &[u32],
    separation: &Separation,
    control: &Control,
) -> Result<Vec<Segment>, Cancelled> {
    let n = separation.bounded_by.len();
    let boxes = node_boxes(grid, segment, n);
    let mut found = Vec::with_capacity(n);
    for (id, bounds) in boxes.into_iter().enumerate() {
        control.check()?;
        let Some((low, high)) = bounds else { continue };
        let id = id as u32;
        // A kerf may leave nothing of a segment; the caller reports that.
        let Some(surface) = isosurface(&segment_grid(grid, segment, separation, id, low, high), 0.0) else { continue };
        let centroid = centroid(&surface);
        let bounded_by = separation.bounded_by[id as usize].clone();
        let (volume_mm3, area_mm2) = (surface.volume(), surface.area());
        found.push(Segment { id, name: None, surface, volume_mm3, area_mm2, centroid, bounded_by });
        control.report(f64::from(id + 1) / n as f64);
    }
    Ok(found)
}

type NodeBox = ([usize; 3], [usize; 3]);

/// Lowest and highest lattice coordinates of each segment's nodes; `None` for a segment without nodes.
fn node_boxes(grid: &ScalarGrid, segment: &[u32], n: usize) -> Vec<Option<NodeBox>> {
    let mut boxes: Vec<Option<NodeBox>> = vec![None; n];
    for (node, s) in segment.iter().enumerate() {
        let Some(b) = boxes.get_mut(*s as usize) else { continue };
        let at = lattice(grid, node);
        let (low, high) = b.get_or_insert((at, at));
        for a in 0..3 {
            low[a] = low[a].min(at[a]);
            high[a] = high[a].max(at[a]);
        }
    }
    boxes
}

/// Signed values of one segment over its box, which is extended by two nodes on every side.
///
/// The segment's nodes beside a separating cut take minus their distance to it, the nodes beyond the cut plus theirs: the zero
/// level then lies in the cut, at the same place for both neighbours. A replaced value would also move the zero level on the
/// edges from its node to air; the values in air are scaled by the same ratio, which keeps the bone's surface in place.
fn segment_grid(
    grid: &ScalarGrid,
    segment: &[u32],
    separation: &Separation,
    id: u32,
    low: [usize; 3],
    high: [usize; 3],
) -> ScalarGrid {
    let low = low.map(|l| l.saturating_sub(2));
    let high: [usize; 3] = std::array::from_fn(|a| (high[a] + 2).min(grid.dims[a] - 1));
    let dims = [0, 1, 2].map(|a| high[a] - low[a] + 1);
    let mut values = Vec::with_capacity(dims.iter().product());
    for k in low[2]..=high[2] {
        for j in low[1]..=high[1] {
            for i in low[0]..=high[0] {
                let node = grid.index(i, j, k);
                let value = grid.values[node];
                values.push(if value >= 0.0 {
                    let behind_a_cut = separation.beyond.get(&(node, id)).copied().unwrap_or(0.0);
                    behind_a_cut.max(value * air_scale(grid, segment, separation, id, node))
                } else {
                    let distance = separation.distance[node];
                    let own = if distance.is_finite() { distance } else { -value };
                    if segment[node] == id { -own } else { separation.across(node, -value) }
                });
            }
        }
    }
    ScalarGrid { dims, origin: grid.position(low[0], low[1], low[2]), spacing: grid.spacing, values }
}

/// Mean ratio of new to old value over the segment's own nodes beside the air node `node`; 1 when there are none.
fn air_scale(grid: &ScalarGrid, segment: &[u32], separation: &Separation, id: u32, node: usize) -> f32 {
    let (mut sum, mut count) = (0.0f32, 0u8);
    for other in neighbours(grid, node).filter(|o| segment[*o] == id) {
        let distance = separation.distance[other];
        sum += if distance.is_finite() { (distance / -grid.values[other]).clamp(0.1, 10.0) } else { 1.0 };
        count += 1;
    }
    if count == 0 { 1.0 } else { sum / f32::from(count) }
}

/// Centroid of the solid inside a closed surface.
fn centroid(surface: &TriMesh) -> Point {
    let o = surface.bounds().center();
    let (mut volume, mut moment) = (0.0, Vector::zeros());
    for t in 0..surface.triangles().len() {
        let [a, b, c] = surface.corners(t).map(|p| p - o);
        let v = a.dot(&b.cross(&c));
        volume += v;
        moment += (a + b + c) * (0.25 * v);
    }
    if volume == 0.0 { o } else { o + moment / volume }
}
