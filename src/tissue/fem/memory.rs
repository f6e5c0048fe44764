//! What equations take in memory, from counts, before it is taken.

use super::assembly::{Pattern, total_slots};
use super::element::{ElementBlock, MeshCell};
use super::error::SolveError;
use super::factor::Symbolic;
use crate::mesh::Tissue;
use prosopon_geometry::Vector;
use prosopon_geometry::control::Control;

const MB: f64 = 1e-6;

/// What elements take, bytes: their blocks, their slots in the matrix, their forces.
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

/// Bytes of an element's slot: its code, and while the pattern is found the row that it couples.
const SLOT: usize = 2 * size_of::<u32>();
/// What threads and allocator take beside, bytes.
const BESIDE: f64 = 32e6;
/// Copies of the matrix's values: what is solved with, the elements' part, the same at rest, and in single precision while it is factored.
const VALUES: f64 = 3.5;

/// What the matrix takes, bytes: its values, and where they stand for the factorisation.
pub(super) fn of_matrix(pattern: &Pattern) -> f64 {
    pattern.n_values() as f64 * (VALUES * size_of::<f64>() as f64 + size_of::<usize>() as f64)
}

/// What a factor in single precision takes, bytes: its entries and room to make it.
pub(super) fn of_factor(symbolic: &Symbolic) -> f64 {
    let (entries, room) = symbolic.single();
    (entries * size_of::<f32>() + room) as f64
}

/// What the corner of a factor takes, bytes, as contact asks for it.
pub(super) fn of_corner(symbolic: &Symbolic) -> f64 {
    CORNER * (symbolic.corner_len() as f64).powi(2)
}

/// Bytes an entry of the corner: dense in single precision, and in double the columns of the two fifths of its nodes that touch at once.
const CORNER: f64 = 4.0 + 0.4 * 8.0 + 0.16 * 8.0;

/// Refuses what does not fit into the memory that `control` allows.
pub(super) fn check(what: &'static str, bytes: f64, control: &Control) -> Result<(), SolveError> {
    let (needed_mb, allowed_mb) = (bytes * MB, control.memory_mb());
    if needed_mb > allowed_mb { Err(SolveError::Memory { what, needed_mb, allowed_mb }) } else { Ok(()) }
}
