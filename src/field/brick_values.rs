//! Values at the nodes of a brick and those next to it, and the spline coefficients that follow.

use super::lattice::EDGE;

/// Nodes around a tile that its coefficients depend on.
pub(super) const HALO: usize = 1;
/// Nodes along the edge of a brick with those next to it.
pub(super) const AROUND: usize = EDGE + 2 * HALO;

/// Sums of 3³ values with the given weights along each axis.
#[inline(always)]
pub(super) fn tensor(c: &[f32; 27], weights: &[[f32; 3]; AROUND]) -> [f32; AROUND.pow(3)] {
    let mut lines = [[0.0f32; AROUND]; 9];
    for (line, row) in lines.iter_mut().zip(c.chunks_exact(3)) {
        for (value, w) in line.iter_mut().zip(weights) {
            *value = w[0] * row[0] + w[1] * row[1] + w[2] * row[2];
        }
    }
    let mut values = [0.0; AROUND.pow(3)];
    for (k, wz) in weights.iter().enumerate() {
        let mut planes = [[0.0f32; AROUND]; 3];
        for (j, plane) in planes.iter_mut().enumerate() {
            for i in 0..AROUND {
                plane[i] = wz[0] * lines[j][i] + wz[1] * lines[3 + j][i] + wz[2] * lines[6 + j][i];
            }
        }
        for (j, wy) in weights.iter().enumerate() {
            let row = &mut values[AROUND * (j + AROUND * k)..][..AROUND];
            for i in 0..AROUND {
                row[i] = wy[0] * planes[0][i] + wy[1] * planes[1][i] + wy[2] * planes[2][i];
            }
        }
    }
    values
}

/// Spline coefficients `c` at the nodes of a brick, by the values there and next to it: they are the values less an eighth of
/// their second differences.
#[inline(always)]
pub(super) fn coefficients(values: &[f32], edge: usize, c: &mut [f32]) {
    let side = edge + 2 * HALO;
    for (n, row) in c.chunks_exact_mut(edge).enumerate() {
        let first = HALO + side * (n % edge + HALO + side * (n / edge + HALO));
        let at = |from: usize| &values[from..from + edge];
        let (own, x0, x1) = (at(first), at(first - 1), at(first + 1));
        let (y0, y1) = (at(first - side), at(first + side));
        let (z0, z1) = (at(first - side * side), at(first + side * side));
        for (i, c) in row.iter_mut().enumerate() {
            *c = 1.75 * own[i] - 0.125 * (x0[i] + x1[i] + y0[i] + y1[i] + z0[i] + z1[i]);
        }
    }
}
