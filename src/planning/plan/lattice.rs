//! Nodes of the bone's grid as a lattice, and its edges that cuts cross.

use prosopon_geometry::ScalarGrid;

/// Label of a node outside bone.
pub(super) const OUTSIDE: u32 = u32::MAX;

/// A grid edge that a cut crosses, from `node` to the next node along `axis`, with at least one end in bone.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Crossing {
    pub(super) node: usize,
    pub(super) axis: usize,
    pub(super) cut: usize,
    /// Distances of `node` and of the next one to the plane that crosses here, mm.
    pub(super) distance: [f32; 2],
    /// Whether `node` lies on the side of the cut's normal.
    pub(super) positive: bool,
    /// Whether both ends are in bone: the edge is blocked.
    pub(super) in_bone: bool,
}

/// Storage steps to the next node along x, y, z.
pub(super) fn strides(grid: &ScalarGrid) -> [usize; 3] {
    [1, grid.dims[0], grid.dims[0] * grid.dims[1]]
}

/// Lattice coordinates of a node.
pub(super) fn lattice(grid: &ScalarGrid, node: usize) -> [usize; 3] {
    let [nx, ny, _] = grid.dims;
    [node % nx, node / nx % ny, node / (nx * ny)]
}

/// The up to six nodes beside `node`.
pub(super) fn neighbours(grid: &ScalarGrid, node: usize) -> impl Iterator<Item = usize> {
    let at = lattice(grid, node);
    let (steps, dims) = (strides(grid), grid.dims);
    (0..3).flat_map(move |a| {
        let before = (at[a] > 0).then(|| node - steps[a]);
        let after = (at[a] + 1 < dims[a]).then(|| node + steps[a]);
        before.into_iter().chain(after)
    })
}
