//! Stress and volume ratio of each cell of the mesh.

use super::assembly::{Assembly, ElementState, Inversion};
use super::element::{ElementBlock, MeshCell};
use super::report::CellState;
use crate::mesh::{MixedMesh, Tissue};
use nalgebra::Matrix3;
use prosopon_geometry::Vector;

/// States of the tetrahedra and of the prisms at `x`.
///
/// With a locking-free formulation the stress of a cell is the mean over its nodes of the means around each node: that of single
/// elements would oscillate. The volume ratio is always that of the cell.
pub(super) fn cell_states(assembly: &Assembly, mesh: &MixedMesh, x: &[Vector]) -> (Vec<CellState>, Vec<CellState>) {
    let states: Vec<Vec<ElementState>> = (assembly.parts().iter().enumerate())
        .map(|(part, p)| (0..p.block.n_elements()).map(|e| assembly.state(Inversion { part, element: e }, x)).collect())
        .collect();
    let nodal = assembly.is_smoothed().then(|| nodal_stress(assembly, mesh, &states));
    let mut tetrahedra = vec![(0.0, Matrix3::zeros(), 0.0); mesh.tetrahedra.len()];
    let mut prisms = vec![(0.0, Matrix3::zeros(), 0.0); mesh.prisms.len()];
    for (part, states) in assembly.parts().iter().zip(&states) {
        for (element, state) in states.iter().enumerate() {
            let mut stress = state.stress;
            if let Some(nodal) = &nodal {
                let corners = corners(&part.block, element, mesh);
                let tissue = part.block.tissue[element] as usize;
                let around = corners.iter().map(|n| nodal[Tissue::COUNT * *n as usize + tissue]);
                stress = around.sum::<Matrix3<f64>>() / corners.len() as f64;
            }
            let sum = match part.block.cells[element] {
                MeshCell::Tetrahedron(cell) => &mut tetrahedra[cell as usize],
                MeshCell::Prism(cell) => &mut prisms[cell as usize],
            };
            sum.0 += state.volume;
            sum.1 += stress * state.volume;
            sum.2 += state.ratio * state.volume;
        }
    }
    let mean = |(volume, stress, ratio): (f64, Matrix3<f64>, f64)| {
        // Cells whose nodes all stay at rest are not among the elements.
        if volume == 0.0 {
            return CellState { stress_mpa: [0.0; 6], volume_ratio: 1.0 };
        }
        let s: Matrix3<f64> = stress / volume;
        let stress_mpa = [s[(0, 0)], s[(1, 1)], s[(2, 2)], s[(0, 1)], s[(1, 2)], s[(0, 2)]];
        CellState { stress_mpa, volume_ratio: ratio / volume }
    };
    (tetrahedra.into_iter().map(mean).collect(), prisms.into_iter().map(mean).collect())
}

/// Mesh nodes at the corners of an element.
fn corners<'a>(block: &'a ElementBlock, element: usize, mesh: &'a MixedMesh) -> &'a [u32] {
    let n = block.n_functions;
    match block.cells[element] {
        MeshCell::Prism(prism) if n > 4 => &mesh.prisms[prism as usize],
        MeshCell::Prism(_) | MeshCell::Tetrahedron(_) => &block.nodes[element * n..(element + 1) * n],
    }
}

/// Mean stress of the elements of each tissue around each node, MPa, by node and tissue.
fn nodal_stress(assembly: &Assembly, mesh: &MixedMesh, states: &[Vec<ElementState>]) -> Vec<Matrix3<f64>> {
    let mut sums = vec![(0.0, Matrix3::zeros()); Tissue::COUNT * mesh.positions.len()];
    for (part, states) in assembly.parts().iter().zip(states) {
        for (element, state) in states.iter().enumerate() {
            let corners = corners(&part.block, element, mesh);
            let share = state.volume / corners.len() as f64;
            for node in corners {
                let sum = &mut sums[Tissue::COUNT * *node as usize + part.block.tissue[element] as usize];
                sum.0 += share;
                sum.1 += state.stress * share;
            }
        }
    }
    sums.into_iter().map(|(volume, sum)| if volume > 0.0 { sum / volume } else { sum }).collect()
}
