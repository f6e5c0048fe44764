use super::brick;
use super::check::measure;
use super::distance_field::{DistanceField, NO_BRICK, detail_at};
use super::error::{FieldError, within};
use super::exact::ExactDistance;
use super::lattice::{BRICK, EDGE, Lattice};
use super::sign::{self, Nodes, Signs, Tally};
use super::spline::{self, Weights};
use crate::control::{Cancelled, Control};
use crate::geometry::{TriMesh, Vector};
use rayon::prelude::*;

/// Most samples (coarse and fine) of a field: half a gigabyte of detail.
pub(super) const MOST_SAMPLES: u64 = 1 << 27;
/// Bricks between two reports of progress.
const CHUNK: usize = 512;
/// A point of the band needs coefficients up to (3/2)√3 spacings away, and these their neighbours' values.
const STENCIL_REACH: f64 = 3.6;

/// Resolution of a field.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FieldSettings {
    /// Finest spacing, mm.
    pub spacing_mm: f64,
    /// Half-width of the band around the surface with full accuracy, mm.
    pub band_mm: f64,
    /// How far beyond the surface's box the grid reaches, mm; points farther out are extrapolated.
    pub margin_mm: f64,
}

impl Default for FieldSettings {
    fn default() -> Self {
        Self { spacing_mm: 0.8, band_mm: 5.0, margin_mm: 10.0 }
    }
}

impl FieldSettings {
    fn check(&self) -> Result<(), FieldError> {
        within("spacing_mm", self.spacing_mm, 0.01..=50.0, "0.01 to 50 mm")?;
        within("band_mm", self.band_mm, 0.0..=200.0, "0 to 200 mm")?;
        within("margin_mm", self.margin_mm, 0.0..=1000.0, "0 to 1000 mm")
    }
}

/// What a built field is like.
#[derive(Debug, Clone, PartialEq)]
pub struct FieldReport {
    /// Bricks of 8³ cells at the finest spacing.
    pub bricks: usize,
    /// Memory of the field, bytes.
    pub bytes: usize,
    /// Largest difference from the exact distance at a fixed sample of points within the band, mm.
    pub max_error_mm: f64,
    /// RMS difference at the same points, mm.
    pub rms_error_mm: f64,
    /// Number of those points.
    pub checked_points: usize,
    /// What is wrong with the surface and how it was dealt with.
    pub warnings: Vec<String>,
}

impl DistanceField {
    /// Builds the field of `surface`.
    ///
    /// Coefficients are c = f - (sum of f's second differences along the axes) / 8, exact for quadratics: of the signed
    /// distance on the coarse nodes, then of what the coarse spline leaves on the fine nodes within the band.
    ///
    /// # Errors
    /// [`FieldError`] for settings out of range, too much memory, or cancellation.
    pub fn build(
        surface: &TriMesh,
        settings: &FieldSettings,
        control: &Control,
    ) -> Result<(Self, FieldReport), FieldError> {
        Self::build_from(&ExactDistance::new(surface), surface, settings, control)
    }

    /// Builds the field of `surface`, for which `exact` was made.
    ///
    /// # Errors
    /// As [`DistanceField::build`].
    pub fn build_from(
        exact: &ExactDistance,
        surface: &TriMesh,
        settings: &FieldSettings,
        control: &Control,
    ) -> Result<(Self, FieldReport), FieldError> {
        settings.check()?;
        let too_large =
            |samples| FieldError::TooLarge { spacing_mm: settings.spacing_mm, samples, allowed: MOST_SAMPLES };
        let bounds = surface.bounds().grown(settings.margin_mm);
        let lattice = Lattice::covering(&bounds, settings.spacing_mm, MOST_SAMPLES).map_err(too_large)?;
        let mut tally = Tally::default();

        let nodes = coarse_distances(&lattice, exact, &control.part(0.0, 0.1))?;
        let coarse_signs = coarse_signs(&lattice, exact, &nodes);
        tally.add(&coarse_signs);
        let coarse = coarse_coefficients(&lattice, &nodes, &coarse_signs.inside);
        control.check()?;

        let reach = settings.band_mm + STENCIL_REACH * settings.spacing_mm;
        let candidates = near_bricks(&lattice, exact, &nodes, reach, control)?;
        let samples = coarse.len() as u64 + (candidates.len() * BRICK) as u64;
        if samples > MOST_SAMPLES {
            return Err(too_large(samples));
        }
        let mut field = Self { index: vec![NO_BRICK; lattice.n_bricks()], lattice, coarse, detail: Vec::new() };
        let mut residuals: Vec<f32> = Vec::new();
        let mut bricks = 0u32;
        for (n, chunk) in candidates.chunks(CHUNK).enumerate() {
            let built = chunk
                .par_iter()
                .map(|candidate| {
                    control.check()?;
                    Ok(field.brick_residual(exact, candidate, reach))
                })
                .collect::<Result<Vec<_>, Cancelled>>()?;
            for (candidate, built) in chunk.iter().zip(built) {
                let Some((residual, signs)) = built else { continue };
                field.index[candidate.brick] = bricks;
                bricks += 1;
                residuals.extend_from_slice(&residual);
                tally.add(&signs);
            }
            control.part(0.1, 0.85).report((n * CHUNK) as f64 / candidates.len() as f64);
        }
        field.detail = field.detail_coefficients(&residuals);
        drop(residuals);
        control.report(0.9);
        control.check()?;

        let measured = measure(&field, exact, surface, settings.band_mm, control)?;
        let mut warnings = exact.defects().warnings();
        warnings.extend(tally.warnings());
        control.report(1.0);
        let report = FieldReport {
            bricks: bricks as usize,
            bytes: field.bytes(),
            max_error_mm: measured.max_error_mm,
            rms_error_mm: measured.rms_error_mm,
            checked_points: measured.points,
            warnings,
        };
        Ok((field, report))
    }

    /// What the coarse spline leaves of the signed distance at the fine nodes of a brick, and their signs; `None` when no
    /// node is within `reach` of the surface.
    fn brick_residual(
        &self,
        exact: &ExactDistance,
        candidate: &Candidate,
        reach: f64,
    ) -> Option<([f32; BRICK], Signs)> {
        let lattice = &self.lattice;
        let at = lattice.brick_at(candidate.brick);
        let origin = lattice.brick_origin(at);
        let distances = brick::distances(exact.tree(), &origin, lattice.spacing, f64::INFINITY, candidate.hint);
        if distances.iter().all(|&d| d > reach) {
            return None;
        }
        let signs = brick::signs(exact, &origin, lattice.spacing, &distances);
        let coarse = self.coarse_around(at);
        let weights =
            [0, 1, 2, 3, 4, 5, 6, 7].map(|i: usize| Weights::at((i as f64 - 0.5 * (EDGE as f64 - 1.0)) / EDGE as f64));
        let mut residual = [0.0; BRICK];
        for (n, residual) in residual.iter_mut().enumerate() {
            let w = [weights[n % EDGE], weights[n / EDGE % EDGE], weights[n / (EDGE * EDGE)]];
            let signed = if signs.inside[n] { -distances[n] } else { distances[n] };
            *residual = (signed - spline::value(&coarse, &w)) as f32;
        }
        Some((residual, signs))
    }

    /// Spline coefficients of the values `residuals` at the bricks' nodes. Where a neighbour has no brick that axis'
    /// second difference is left out.
    fn detail_coefficients(&self, residuals: &[f32]) -> Vec<f32> {
        let slots: Vec<usize> = (0..self.index.len()).filter(|&b| self.index[b] != NO_BRICK).collect();
        let mut detail = vec![0.0f32; residuals.len()];
        // Bricks were numbered in the order of their place.
        detail.par_chunks_mut(BRICK).zip(&slots).for_each(|(detail, &brick)| {
            let at = self.lattice.brick_at(brick);
            for (n, detail) in detail.iter_mut().enumerate() {
                let local = [n % EDGE, n / EDGE % EDGE, n / (EDGE * EDGE)];
                let node = [0, 1, 2].map(|a| at[a] * EDGE + local[a]);
                let value = |step| detail_at(&self.lattice, &self.index, residuals, node, step).map(f64::from);
                let Some(here) = value([1, 1, 1]) else { continue };
                let mut second = 0.0;
                for a in 0..3 {
                    let mut step = [1; 3];
                    step[a] = 0;
                    let before = value(step);
                    step[a] = 2;
                    if let (Some(before), Some(after)) = (before, value(step)) {
                        second += before + after - 2.0 * here;
                    }
                }
                *detail = (here - second / 8.0) as f32;
            }
        });
        detail
    }
}

/// A brick that may reach into the band, and a triangle close to it.
struct Candidate {
    brick: usize,
    hint: u32,
}

/// Unsigned distance at coarse nodes, and the nearest triangle of each.
struct CoarseNodes {
    distances: Vec<f64>,
    slots: Vec<u32>,
}

fn coarse_distances(lattice: &Lattice, exact: &ExactDistance, control: &Control) -> Result<CoarseNodes, Cancelled> {
    let [nx, ny, nz] = lattice.coarse_dims();
    let (origin, spacing) = (lattice.coarse_origin(), lattice.coarse_spacing());
    let rows = (0..ny * nz)
        .into_par_iter()
        .map(|row| {
            control.check()?;
            let start = origin + Vector::new(0.0, (row % ny) as f64, (row / ny) as f64) * spacing;
            let mut hint = 0;
            Ok((0..nx)
                .map(|i| {
                    let nearest = exact.nearest(&(start + Vector::new(i as f64 * spacing, 0.0, 0.0)), hint);
                    hint = nearest.slot;
                    (nearest.distance_sq.sqrt(), nearest.slot)
                })
                .collect::<Vec<_>>())
        })
        .collect::<Result<Vec<_>, Cancelled>>()?;
    control.report(1.0);
    let (distances, slots) = rows.into_iter().flatten().unzip();
    Ok(CoarseNodes { distances, slots })
}

fn coarse_signs(lattice: &Lattice, exact: &ExactDistance, nodes: &CoarseNodes) -> Signs {
    let dims = lattice.coarse_dims();
    let spacing = lattice.coarse_spacing();
    let origin = lattice.coarse_origin();
    let half = Vector::new(dims[0] as f64, dims[1] as f64, dims[2] as f64) * (0.5 * spacing);
    let slope = sign::slope(&exact.defects().rim, &(origin + half), half.norm());
    sign::signs(&Nodes { dims, origin, spacing, distances: &nodes.distances }, exact, slope)
}

fn coarse_coefficients(lattice: &Lattice, nodes: &CoarseNodes, inside: &[bool]) -> Vec<f64> {
    let dims = lattice.coarse_dims();
    let strides = [1, dims[0], dims[0] * dims[1]];
    let signed: Vec<f64> =
        nodes.distances.iter().zip(inside).map(|(&d, &inside)| if inside { -d } else { d }).collect();
    let mut coefficients = signed.clone();
    for k in 1..dims[2] - 1 {
        for j in 1..dims[1] - 1 {
            for i in 1..dims[0] - 1 {
                let n = i + strides[1] * j + strides[2] * k;
                let second: f64 = strides.iter().map(|s| signed[n - s] + signed[n + s] - 2.0 * signed[n]).sum();
                coefficients[n] -= second / 8.0;
            }
        }
    }
    coefficients
}

/// Bricks with an octant whose nodes may be within `reach` of the surface, by the distance at the octant's middle.
fn near_bricks(
    lattice: &Lattice,
    exact: &ExactDistance,
    nodes: &CoarseNodes,
    reach: f64,
    control: &Control,
) -> Result<Vec<Candidate>, Cancelled> {
    let half_diagonal = |n: f64| 0.5 * 3f64.sqrt() * (n - 1.0) * lattice.spacing;
    let (whole, octant) = (half_diagonal(EDGE as f64), half_diagonal(0.5 * EDGE as f64));
    let candidates = (0..lattice.n_bricks())
        .into_par_iter()
        .map(|brick| {
            control.check()?;
            let at = lattice.brick_at(brick);
            let coarse = lattice.coarse_index(at);
            let (distance, hint) = (nodes.distances[coarse], nodes.slots[coarse]);
            if distance > reach + whole {
                return Ok(None);
            }
            let first = lattice.brick_origin(at) + Vector::repeat(1.5 * lattice.spacing);
            let is_near = distance <= reach
                || (0..8).any(|o| {
                    let step =
                        Vector::new((o & 1) as f64, (o >> 1 & 1) as f64, (o >> 2) as f64) * (4.0 * lattice.spacing);
                    exact.nearest(&(first + step), hint).distance_sq.sqrt() <= reach + octant
                });
            Ok(is_near.then_some(Candidate { brick, hint }))
        })
        .collect::<Result<Vec<_>, Cancelled>>()?;
    Ok(candidates.into_iter().flatten().collect())
}
