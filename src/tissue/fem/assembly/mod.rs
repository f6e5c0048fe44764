//! Energy, forces and stiffness of all elements.
//!
//! Elements are evaluated in parallel into buffers. Each force and each block of the matrix then sums its contributions in the
//! order of elements, so that the bits are the same at any number of threads.

mod element_state;
mod kernel;
mod law;
mod pattern;
mod scatter;

pub(in crate::fem) use element_state::{ElementState, FirstInversion, Inversion};
pub(in crate::fem) use law::{Curvature, Law};
pub(in crate::fem) use pattern::{Pattern, total_slots};

use super::dofs::Dofs;
use super::element::{ElementBlock, SMOOTHED_WIDTHS};
use super::error::SolveError;
use super::material::Inverted;
use crate::fem::tuning::BUFFERED_VALUES;
use crate::mesh::Tissue;
use kernel::{Element, n_slots};
use nalgebra::Matrix3;
use prosopon_geometry::Vector;
use rayon::prelude::*;
use scatter::{ForceSources, Scatter};
use std::sync::Arc;

/// Elements with their material laws, one law for each tissue.
#[derive(Debug, Clone)]
pub(in crate::fem) struct Part {
    pub(in crate::fem) block: ElementBlock,
    pub(in crate::fem) laws: [Law; Tissue::COUNT],
}

impl Part {
    fn law(&self, element: usize) -> &Law {
        &self.laws[self.block.tissue[element] as usize]
    }
}

/// All elements and the matrix's pattern. Clones share them.
#[derive(Debug, Clone)]
pub(in crate::fem) struct Assembly {
    /// Elements that carry the energy: those of the mesh, or smoothed ones.
    parts: Arc<Vec<Part>>,
    /// Elements of the mesh when smoothed elements carry the energy.
    geometry: Option<Arc<Vec<Part>>>,
    pattern: Arc<Pattern>,
    slots: Arc<pattern::Slots>,
    scatter: Arc<Scatter>,
    force_sources: Arc<ForceSources>,
}

/// Buffers for the forces and matrices of elements.
#[derive(Debug, Clone)]
pub(in crate::fem) struct ElementBuffers {
    /// Forces of all elements.
    forces: Vec<f64>,
    /// Matrices of one chunk of elements.
    matrices: Vec<f64>,
}

/// Number of elements evaluated by one task: about the same work for each kind.
const fn chunk(n_functions: usize, n_points: usize) -> usize {
    let work = n_functions * n_functions * n_points;
    if work >= 4096 { 8 } else { 8192 / (work + 1) + 1 }
}

/// Elements of a block whose matrices are computed before they are added to the global matrix.
fn elements_at_once(block: &ElementBlock) -> usize {
    (BUFFERED_VALUES / (9 * n_slots(block.n_functions))).clamp(1, block.n_elements().max(1))
}

/// Calls `$method::<N>` for the block's number of functions; [`Assembly::new`] has refused blocks of other widths.
macro_rules! by_width {
    ($part:expr, $function:ident ( $($argument:expr),* )) => {
        match $part.block.n_functions {
            4 => $function::<4>($($argument),*),
            6 => $function::<6>($($argument),*),
            8 => $function::<8>($($argument),*),
            12 => $function::<12>($($argument),*),
            16 => $function::<16>($($argument),*),
            24 => $function::<24>($($argument),*),
            32 => $function::<32>($($argument),*),
            _ => $function::<48>($($argument),*),
        }
    };
}

impl Assembly {
    /// `geometry` holds the elements of the mesh when `parts` are smoothed elements.
    pub(in crate::fem) fn new(parts: Vec<Part>, geometry: Option<Vec<Part>>, dofs: &Dofs) -> Result<Self, SolveError> {
        let blocks: Vec<&ElementBlock> = parts.iter().map(|p| &p.block).collect();
        for b in &blocks {
            let n = b.n_elements();
            let complete = b.nodes.len() == n * b.n_functions
                && b.weights.len() == n * b.n_points
                && b.gradients.len() == n * b.n_points * b.n_functions;
            if !SMOOTHED_WIDTHS.contains(&b.n_functions) || !complete {
                let detail = format!("the block of {}s is incomplete", b.kind);
                return Err(SolveError::Problem { detail });
            }
        }
        let n_slots_in_all = pattern::total_slots(&blocks);
        if n_slots_in_all > (u32::MAX / 2) as usize {
            let detail = format!("the mesh has {n_slots_in_all} element blocks, at most {} are possible", u32::MAX / 2);
            return Err(SolveError::Problem { detail });
        }
        let (pattern, slots) = pattern::build(&blocks, dofs);
        if 9 * pattern.n_blocks() > u32::MAX as usize {
            let detail =
                format!("{} blocks of the stiffness matrix, at most {} are possible", pattern.n_blocks(), u32::MAX / 9);
            return Err(SolveError::Problem { detail });
        }
        let scatter = Scatter::new(&pattern);
        let force_sources = ForceSources::new(&blocks, dofs.n_nodes());
        Ok(Self {
            parts: Arc::new(parts),
            geometry: geometry.map(Arc::new),
            pattern: Arc::new(pattern),
            slots: Arc::new(slots),
            scatter: Arc::new(scatter),
            force_sources: Arc::new(force_sources),
        })
    }

    /// Buffers for these elements.
    pub(in crate::fem) fn buffers(&self) -> ElementBuffers {
        let blocks = || self.parts.iter().map(|p| &p.block);
        let functions: usize = blocks().map(|b| b.nodes.len()).sum();
        let values = blocks().map(|b| elements_at_once(b) * 9 * n_slots(b.n_functions)).max().unwrap_or(0);
        ElementBuffers { forces: vec![0.0; 3 * functions], matrices: vec![0.0; values] }
    }

    pub(in crate::fem) fn pattern(&self) -> &Pattern {
        &self.pattern
    }

    /// Elements of the mesh, in the order of the indices of [`Inversion`].
    pub(in crate::fem) fn parts(&self) -> &[Part] {
        self.geometry.as_ref().unwrap_or(&self.parts)
    }

    /// Replaces materials that can lose ellipticity by stable ones. Returns whether there were any.
    pub(in crate::fem) fn stabilise(&mut self) -> bool {
        let shared = std::iter::once(&mut self.parts).chain(&mut self.geometry);
        let mut any = false;
        // Clones of this assembly may share the parts.
        for law in shared.flat_map(Arc::make_mut).flat_map(|p| &mut p.laws) {
            if let Law::Hyperelastic(material) = law
                && let Some(stable) = material.stabilised()
            {
                *material = stable;
                any = true;
            }
        }
        any
    }

    /// Whether smoothed elements or patches carry the energy.
    pub(in crate::fem) fn is_smoothed(&self) -> bool {
        self.geometry.is_some()
    }

    /// An element of the mesh for an element that carries energy.
    fn in_mesh(&self, at: Inversion) -> Inversion {
        let Some(geometry) = &self.geometry else { return at };
        let cell = self.parts[at.part].block.cells[at.element];
        let place = |(part, p): (usize, &Part)| {
            p.block.cells.iter().position(|c| *c == cell).map(|element| Inversion { part, element })
        };
        geometry.iter().enumerate().find_map(place).unwrap_or(Inversion { part: 0, element: 0 })
    }

    /// Fails for an inverted element of the mesh that averages might hide. Small strain allows inversion.
    fn check_geometry(&self, x: &[Vector]) -> Result<(), Inversion> {
        for (index, part) in self.geometry.iter().flat_map(|g| g.iter()).enumerate() {
            if matches!(part.laws[0], Law::SmallStrain(_)) {
                continue;
            }
            let dets = by_width!(part, part_min_det(part, x));
            if let Some(element) = dets.iter().position(|det| !(*det > 0.0 && det.is_finite())) {
                return Err(Inversion { part: index, element });
            }
        }
        Ok(())
    }

    /// Energy (mJ) at `x`.
    pub(in crate::fem) fn energy(&self, x: &[Vector]) -> Result<f64, Inversion> {
        self.check_geometry(x)?;
        let mut total = 0.0;
        for (index, part) in self.parts.iter().enumerate() {
            total += by_width!(part, part_energy(index, part, x)).map_err(|at| self.in_mesh(at))?;
        }
        Ok(total)
    }

    /// Energy (mJ) at `x`, and its gradient by every generalised node in `forces`.
    pub(in crate::fem) fn forces(
        &self,
        buffers: &mut ElementBuffers,
        x: &[Vector],
        forces: &mut [Vector],
    ) -> Result<f64, Inversion> {
        self.check_geometry(x)?;
        let mut total = 0.0;
        let mut rest = buffers.forces.as_mut_slice();
        for (index, part) in self.parts.iter().enumerate() {
            let (buffer, tail) = rest.split_at_mut(3 * part.block.nodes.len());
            rest = tail;
            let done = by_width!(part, part_forces(index, part, x, buffer));
            match done {
                Ok(energy) => total += energy,
                Err(at) => return Err(self.in_mesh(at)),
            }
        }
        self.force_sources.gather(&buffers.forces, forces);
        Ok(total)
    }

    /// First-order change of the forces for a change `dx` of the nodes.
    pub(in crate::fem) fn force_change(
        &self,
        buffers: &mut ElementBuffers,
        x: &[Vector],
        dx: &[Vector],
        change: &mut [Vector],
    ) -> Result<(), Inversion> {
        let mut rest = buffers.forces.as_mut_slice();
        for (index, part) in self.parts.iter().enumerate() {
            let (buffer, tail) = rest.split_at_mut(3 * part.block.nodes.len());
            rest = tail;
            let done = by_width!(part, part_force_change(index, part, x, dx, buffer));
            if let Err(at) = done {
                return Err(self.in_mesh(at));
            }
        }
        self.force_sources.gather(&buffers.forces, change);
        Ok(())
    }

    /// Forces and stiffness matrix at `x`.
    pub(in crate::fem) fn tangent(
        &self,
        buffers: &mut ElementBuffers,
        x: &[Vector],
        curvature: Curvature,
        forces: &mut [Vector],
        values: &mut [f64],
    ) -> Result<(), Inversion> {
        self.check_geometry(x)?;
        values.fill(0.0);
        let mut rest = buffers.forces.as_mut_slice();
        let mut first_slot = 0;
        for (index, part) in self.parts.iter().enumerate() {
            let (buffer, tail) = rest.split_at_mut(3 * part.block.nodes.len());
            rest = tail;
            let (n, slots) = (part.block.n_elements(), n_slots(part.block.n_functions));
            let at_once = elements_at_once(&part.block);
            for from in (0..n).step_by(at_once) {
                let to = n.min(from + at_once);
                let forces = &mut buffer[3 * from * part.block.n_functions..3 * to * part.block.n_functions];
                let blocks = &mut buffers.matrices[..9 * slots * (to - from)];
                let done = by_width!(part, part_tangent(index, part, from, curvature, x, forces, blocks));
                if let Err(at) = done {
                    return Err(self.in_mesh(at));
                }
                let codes = self.slots.codes(first_slot + slots * from..first_slot + slots * to);
                self.scatter.add(&self.pattern, codes, blocks, values);
            }
            first_slot += slots * n;
        }
        self.force_sources.gather(&buffers.forces, forces);
        Ok(())
    }

    /// Share of `dx`, at most 1, at which an element is first inverted, and that element.
    pub(in crate::fem) fn first_inversion(&self, x: &[Vector], dx: &[Vector]) -> FirstInversion {
        let mut least = FirstInversion { share: 1.0, element: None };
        let mut search = |parts: &[Part], in_mesh: &dyn Fn(Inversion) -> Inversion| {
            for (index, part) in parts.iter().enumerate() {
                let shares = by_width!(part, part_first_inversion(part, x, dx));
                for (element, share) in shares.into_iter().enumerate() {
                    if share < least.share {
                        least = FirstInversion { share, element: Some(in_mesh(Inversion { part: index, element })) };
                    }
                }
            }
        };
        search(self.parts(), &|at| at);
        if self.is_smoothed() {
            search(&self.parts, &|at| self.in_mesh(at));
        }
        least
    }

    /// Smallest det F in each element, by part.
    pub(in crate::fem) fn min_det(&self, x: &[Vector]) -> Vec<Vec<f64>> {
        self.parts().iter().map(|part| by_width!(part, part_min_det(part, x))).collect()
    }

    /// Deformation gradients at the points of one element.
    pub(in crate::fem) fn deformations(&self, at: Inversion, x: &[Vector]) -> Vec<Matrix3<f64>> {
        let part = &self.parts()[at.part];
        by_width!(part, element_deformations(part, at.element, x))
    }

    /// State of an element at `x`.
    pub(in crate::fem) fn state(&self, at: Inversion, x: &[Vector]) -> ElementState {
        let part = &self.parts()[at.part];
        let law = part.law(at.element);
        let q = part.block.n_points;
        let weights = &part.block.weights[at.element * q..(at.element + 1) * q];
        let mut sum = ElementState { volume: 0.0, stress: Matrix3::zeros(), ratio: 0.0 };
        for (f, w) in self.deformations(at, x).iter().zip(weights) {
            sum.volume += w;
            sum.stress += law.cauchy(f) * *w;
            sum.ratio += w * f.determinant();
        }
        let stress = sum.stress / sum.volume;
        ElementState { stress, ratio: sum.ratio / sum.volume, ..sum }
    }

    /// Tissue of an element.
    pub(in crate::fem) fn tissue(&self, at: Inversion) -> Tissue {
        self.parts()[at.part].block.tissue[at.element]
    }
}

/// Runs a loop over elements compiled for the SIMD instructions of this processor; functions that it calls must be inlined.
fn vectorised<T>(elements: impl FnOnce() -> T) -> T {
    pulp::Arch::new().dispatch(elements)
}

/// Sum of the energies of chunks, in order; the first inverted element if there is one.
fn in_order(index: usize, chunks: Vec<Result<f64, usize>>) -> Result<f64, Inversion> {
    chunks.into_iter().try_fold(0.0, |sum, c| c.map(|c| sum + c)).map_err(|element| Inversion { part: index, element })
}

fn part_energy<const N: usize>(index: usize, part: &Part, x: &[Vector]) -> Result<f64, Inversion> {
    let size = chunk(N, part.block.n_points);
    let n = part.block.n_elements();
    let energies: Vec<Result<f64, usize>> = (0..n.div_ceil(size))
        .into_par_iter()
        .map(|c| {
            let (from, to) = (c * size, n.min((c + 1) * size));
            vectorised(
                #[inline(always)]
                || {
                    let mut sum = 0.0;
                    for e in from..to {
                        let element = Element::<N>::new(&part.block, e);
                        sum += element.energy(part.law(e), &element.collect(x)).map_err(|_: Inverted| e)?;
                    }
                    Ok(sum)
                },
            )
        })
        .collect();
    in_order(index, energies)
}

fn part_forces<const N: usize>(index: usize, part: &Part, x: &[Vector], buffer: &mut [f64]) -> Result<f64, Inversion> {
    let size = chunk(N, part.block.n_points);
    let energies: Vec<Result<f64, usize>> = buffer
        .par_chunks_mut(3 * N * size)
        .enumerate()
        .map(|(c, out)| {
            vectorised(
                #[inline(always)]
                || {
                    out.fill(0.0);
                    let mut sum = 0.0;
                    for (i, out) in out.chunks_exact_mut(3 * N).enumerate() {
                        let e = c * size + i;
                        let element = Element::<N>::new(&part.block, e);
                        sum += element.forces(part.law(e), &element.collect(x), out).map_err(|_: Inverted| e)?;
                    }
                    Ok(sum)
                },
            )
        })
        .collect();
    in_order(index, energies)
}

fn part_force_change<const N: usize>(
    index: usize,
    part: &Part,
    x: &[Vector],
    dx: &[Vector],
    buffer: &mut [f64],
) -> Result<f64, Inversion> {
    let size = chunk(N, part.block.n_points);
    let done: Vec<Result<f64, usize>> = buffer
        .par_chunks_mut(3 * N * size)
        .enumerate()
        .map(|(c, out)| {
            out.fill(0.0);
            for (i, out) in out.chunks_exact_mut(3 * N).enumerate() {
                let e = c * size + i;
                let element = Element::<N>::new(&part.block, e);
                let dx = element.collect(dx);
                if dx.iter().any(|d| *d != Vector::zeros()) {
                    element.force_change(part.law(e), &element.collect(x), &dx, out).map_err(|_: Inverted| e)?;
                }
            }
            Ok(0.0)
        })
        .collect();
    in_order(index, done)
}

fn part_tangent<const N: usize>(
    index: usize,
    part: &Part,
    first: usize,
    curvature: Curvature,
    x: &[Vector],
    buffer: &mut [f64],
    blocks: &mut [f64],
) -> Result<f64, Inversion> {
    let size = chunk(N, part.block.n_points);
    let slots = 9 * n_slots(N);
    let done: Vec<Result<f64, usize>> = buffer
        .par_chunks_mut(3 * N * size)
        .zip(blocks.par_chunks_mut(slots * size))
        .enumerate()
        .map(|(c, (out, blocks))| {
            vectorised(
                #[inline(always)]
                || {
                    out.fill(0.0);
                    let elements = out.chunks_exact_mut(3 * N).zip(blocks.chunks_exact_mut(slots));
                    for (i, (out, blocks)) in elements.enumerate() {
                        let e = first + c * size + i;
                        let element = Element::<N>::new(&part.block, e);
                        let x = element.collect(x);
                        element.tangent(part.law(e), curvature, &x, out, blocks).map_err(|_: Inverted| e)?;
                    }
                    Ok(0.0)
                },
            )
        })
        .collect();
    in_order(index, done)
}

fn part_first_inversion<const N: usize>(part: &Part, x: &[Vector], dx: &[Vector]) -> Vec<f64> {
    (0..part.block.n_elements())
        .into_par_iter()
        .with_min_len(chunk(N, part.block.n_points))
        .map(|e| {
            let element = Element::<N>::new(&part.block, e);
            element.first_inversion(&element.collect(x), &element.collect(dx))
        })
        .collect()
}

fn part_min_det<const N: usize>(part: &Part, x: &[Vector]) -> Vec<f64> {
    (0..part.block.n_elements())
        .into_par_iter()
        .with_min_len(chunk(N, part.block.n_points))
        .map(|e| {
            let element = Element::<N>::new(&part.block, e);
            element.min_det(&element.collect(x))
        })
        .collect()
}

fn element_deformations<const N: usize>(part: &Part, element: usize, x: &[Vector]) -> Vec<Matrix3<f64>> {
    let element = Element::<N>::new(&part.block, element);
    element.deformations(element.collect(x)).collect()
}
