//! Memory of the equations, estimated from counts before allocation.

use super::assembly::{Pattern, total_slots};
use super::element::{ElementBlock, MeshCell};
use super::error::SolveError;
use super::factor::Symbolic;
use crate::mesh::Tissue;
use prosopon_geometry::Vector;
use prosopon_geometry::control::Control;

const MB: f64 = 1e-6;

/// Memory of the elements, bytes: their blocks, their slots in the matrix, their forces.
pub(super) fn of_elements(blocks: &[&ElementBlock]) -> f64 {
    let of_block = |b: &&ElementBlock| {
        let (n, q) = (b.n_functions, b.n_points);
        let nodes = n * (size_of::<u32>() + size_of::<Vector>());
        let each =
            q * (n * size_of::<Vector>() + size_of::<f64>()) + nodes + size_of::<Tissue>() + size_of::<MeshCell>();
        (b.n_elements() * each) as f64
    };
    BESIDE + blocks.iter().map(of_block).sum::<f64>() + (SLOT * total_slots(blocks)) as f64
}

/// Bytes for each slot of an element: its code, and the coupled row while the pattern is built.
const SLOT: usize = 2 * size_of::<u32>();
/// Memory of threads and allocator, bytes.
const BESIDE: f64 = 32e6;
/// Copies of the matrix's values: the system, the elements' part, that part at rest, and one in single precision during
/// factorisation.
const VALUES: f64 = 3.5;

/// Memory of the matrix, bytes: its values and their index for the factorisation.
pub(super) fn of_matrix(pattern: &Pattern) -> f64 {
    pattern.n_values() as f64 * (VALUES * size_of::<f64>() as f64 + size_of::<usize>() as f64)
}

/// Memory of a factor in single precision, bytes: its entries and scratch memory for the factorisation.
pub(super) fn of_factor(symbolic: &Symbolic) -> f64 {
    let (entries, room) = symbolic.single();
    (entries * size_of::<f32>() + room) as f64
}

/// Memory of the dense corner of a factor, bytes, as contact requests it.
pub(super) fn of_corner(symbolic: &Symbolic) -> f64 {
    CORNER * (symbolic.corner_len() as f64).powi(2)
}

/// Bytes for each entry of the corner: dense in single precision, and in double the columns of the two fifths of its nodes in
/// contact at once.
const CORNER: f64 = 4.0 + 0.4 * 8.0 + 0.16 * 8.0;

/// Fails when `bytes` exceed the memory that `control` allows.
pub(super) fn check(what: &'static str, bytes: f64, control: &Control) -> Result<(), SolveError> {
    let (needed_mb, allowed_mb) = (bytes * MB, control.memory_mb());
    if needed_mb > allowed_mb { Err(SolveError::Memory { what, needed_mb, allowed_mb }) } else { Ok(()) }
}
