//! A dense assembler and Newton's method, for problems of a few hundred unknowns.

use nalgebra::{DMatrix, DVector, Matrix3, Vector3};
use prosopon_tissue::fem::element::ElementBlock;
use prosopon_tissue::fem::material::{Material, Tangent};

/// Element blocks with one material each.
pub(crate) type Body<'a> = [(&'a ElementBlock, Material)];

/// Deformation gradient of point `p` of element `e`.
pub(crate) fn deformation_gradient(block: &ElementBlock, values: &[Vector3<f64>], e: usize, p: usize) -> Matrix3<f64> {
    let n = block.n_functions;
    (0..n)
        .map(|a| {
            values[block.nodes[e * n + a] as usize] * block.gradients[(e * block.n_points + p) * n + a].transpose()
        })
        .sum()
}

/// Calls `visit(element, point, nodes, gradients, weight)` for every quadrature point.
fn for_each_point(block: &ElementBlock, mut visit: impl FnMut(usize, usize, &[u32], &[Vector3<f64>], f64)) {
    let n = block.n_functions;
    for e in 0..block.n_elements() {
        for p in 0..block.n_points {
            let at = e * block.n_points + p;
            visit(e, p, &block.nodes[e * n..(e + 1) * n], &block.gradients[at * n..(at + 1) * n], block.weights[at]);
        }
    }
}

/// Internal forces at all generalised nodes.
pub(crate) fn forces(body: &Body<'_>, values: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
    let mut forces = vec![Vector3::zeros(); values.len()];
    for (block, material) in body {
        for_each_point(block, |e, p, nodes, gradients, weight| {
            let stress = material.first_piola(&deformation_gradient(block, values, e, p)).unwrap();
            for (&node, g) in nodes.iter().zip(gradients) {
                forces[node as usize] += stress * g * weight;
            }
        });
    }
    forces
}

/// Tangent stiffness of the unknowns.
pub(crate) fn stiffness(body: &Body<'_>, values: &[Vector3<f64>], free: &[usize]) -> DMatrix<f64> {
    let mut place = vec![usize::MAX; values.len()];
    free.iter().enumerate().for_each(|(i, &n)| place[n] = 3 * i);
    let mut k = DMatrix::zeros(3 * free.len(), 3 * free.len());
    for (block, material) in body {
        for_each_point(block, |e, p, nodes, gradients, weight| {
            let f = deformation_gradient(block, values, e, p);
            let (_, t): (_, Tangent) = material.stress_and_tangent(&f).unwrap();
            for (&a, ga) in nodes.iter().zip(gradients).filter(|(n, _)| place[**n as usize] != usize::MAX) {
                // T contracted with one gradient: 9 x 3.
                let half = nalgebra::SMatrix::<f64, 3, 9>::from_fn(|r, c| {
                    (0..3).map(|j| ga[j] * t[(r + 3 * j, c)]).sum::<f64>() * weight
                });
                for (&b, gb) in nodes.iter().zip(gradients).filter(|(n, _)| place[**n as usize] != usize::MAX) {
                    let (row, col) = (place[a as usize], place[b as usize]);
                    for r in 0..3 {
                        for c in 0..3 {
                            k[(row + r, col + c)] += (0..3).map(|j| half[(r, c + 3 * j)] * gb[j]).sum::<f64>();
                        }
                    }
                }
            }
        });
    }
    k
}

/// Newton's method for the free generalised nodes under `loads`, starting at `values`; panics when it does not converge.
pub(crate) fn solve(body: &Body<'_>, values: &mut [Vector3<f64>], free: &[usize], loads: &[Vector3<f64>]) -> usize {
    let mut last = f64::INFINITY;
    for iteration in 0..30 {
        let inner = forces(body, values);
        let residual = DVector::from_iterator(
            3 * free.len(),
            free.iter().flat_map(|&n| {
                let r = loads[n] - inner[n];
                [r.x, r.y, r.z]
            }),
        );
        let step = stiffness(body, values, free).lu().solve(&residual).unwrap();
        for (i, &n) in free.iter().enumerate() {
            values[n] += Vector3::new(step[3 * i], step[3 * i + 1], step[3 * i + 2]);
        }
        // Quadratic convergence: after this, one more step changes only rounding errors.
        if step.amax() < 1e-10 && step.amax() > 0.1 * last || step.amax() < 1e-13 {
            return iteration + 1;
        }
        last = step.amax();
    }
    panic!("no convergence, last step {last:e}");
}
