//! Blocks of neighbouring triangles, on which threads work side by side.

use crate::{Point, TriMesh};

/// A part of a mesh as a mesh of its own.
pub(super) struct Block {
    pub(super) mesh: TriMesh,
    /// The vertex of the whole mesh that each vertex of the block is.
    pub(super) vertices: Vec<u32>,
}

/// Divides a mesh into boxes of equally many triangles, at most `max_triangles` each.
///
/// The blocks depend on the mesh only, never on the number of threads. `None` when a part is no mesh, which no valid mesh has.
pub(super) fn blocks(mesh: &TriMesh, max_triangles: usize) -> Option<Vec<Block>> {
    let centres: Vec<Point> = (0..mesh.triangles().len())
        .map(|t| {
            let [a, b, c] = mesh.corners(t);
            Point::from((a.coords + b.coords + c.coords) / 3.0)
        })
        .collect();
    let mut boxes = Vec::new();
    let mut all: Vec<u32> = (0..centres.len() as u32).collect();
    halve(&centres, &mut all, max_triangles.max(1), &mut boxes);
    let mut renumbered = vec![u32::MAX; mesh.positions().len()];
    boxes.into_iter().map(|triangles| block(mesh, &triangles, &mut renumbered)).collect()
}

/// Divides `triangles` at the median along the longest side of their box until they are few enough.
fn halve(centres: &[Point], triangles: &mut [u32], max_triangles: usize, boxes: &mut Vec<Vec<u32>>) {
    if triangles.len() <= max_triangles {
        triangles.sort_unstable();
        boxes.push(triangles.to_vec());
        return;
    }
    let first = centres[triangles[0] as usize];
    let (min, max) =
        triangles.iter().map(|&t| centres[t as usize]).fold((first, first), |(a, b), p| (a.inf(&p), b.sup(&p)));
    let axis = (max - min).imax();
    let middle = triangles.len() / 2;
    let place = |t: u32| centres[t as usize][axis];
    triangles.select_nth_unstable_by(middle, |&a, &b| place(a).total_cmp(&place(b)).then(a.cmp(&b)));
    let (left, right) = triangles.split_at_mut(middle);
    halve(centres, left, max_triangles, boxes);
    halve(centres, right, max_triangles, boxes);
}

/// `renumbered` holds `u32::MAX` for each vertex, before and afterwards.
fn block(mesh: &TriMesh, triangles: &[u32], renumbered: &mut [u32]) -> Option<Block> {
    let mut vertices = Vec::new();
    let mut own = Vec::with_capacity(triangles.len());
    for &t in triangles {
        own.push(mesh.triangles()[t as usize].map(|v| {
            let number = &mut renumbered[v as usize];
            if *number == u32::MAX {
                *number = vertices.len() as u32;
                vertices.push(v);
            }
            *number
        }));
    }
    for &v in &vertices {
        renumbered[v as usize] = u32::MAX;
    }
    let positions = vertices.iter().map(|&v| mesh.positions()[v as usize]).collect();
    Some(Block { mesh: TriMesh::new(positions, own).ok()?, vertices })
}
