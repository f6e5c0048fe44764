//! A simulated scan of a deformed skin, with its own vertices and triangles, and with noise.

use rayon::prelude::*;

use prosopon_field::ExactDistance;
use prosopon_geometry::{Point, ScalarGrid, TriMesh, Vector, isosurface};

/// Spacing of the scan's grid, mm, and its offset from the bounds of the skin, so that no vertex is shared.
const SPACING_MM: f64 = 1.8;
const OFFSET_MM: [f64; 3] = [3.37, 2.91, 3.73];
/// Margin of the grid around the skin, mm.
const MARGIN_MM: f64 = 6.0;

/// Settings of a scan.
#[derive(Debug, Clone, Copy)]
pub(super) struct Scan<'a> {
    /// The deformed skin.
    pub(super) truth: &'a TriMesh,
    /// Standard deviation of the noise along each axis, mm.
    pub(super) noise_mm: f64,
    /// Seed of the noise.
    pub(super) seed: u64,
}

/// Scans the deformed skin; `None` when there is no surface.
///
/// The distance to the skin is sampled on a separate grid, whose isosurface gives new vertices and triangles. Each vertex is then
/// projected onto the true surface, and noise is added.
pub(super) fn scanned(scan: &Scan<'_>) -> Option<TriMesh> {
    let exact = ExactDistance::new(scan.truth);
    let mut bounds = scan.truth.bounds().grown(MARGIN_MM);
    bounds.min -= Vector::from(OFFSET_MM);
    let mut grid = ScalarGrid::covering(&bounds, SPACING_MM, 0.0);
    let ([nx, ny, _], origin) = (grid.dims, grid.origin);
    grid.values.par_chunks_mut(nx).enumerate().for_each(|(row, values)| {
        let (j, k) = (row % ny, row / ny);
        for (i, value) in values.iter_mut().enumerate() {
            let p = origin + Vector::new(i as f64, j as f64, k as f64) * SPACING_MM;
            *value = exact.signed(&p) as f32;
        }
    });
    let mesh = isosurface(&grid, 0.0)?;
    let mut noise = Noise(scan.seed);
    let positions: Vec<Point> = mesh
        .positions()
        .par_iter()
        .map(|p| exact.closest(p).0)
        .collect::<Vec<Point>>()
        .into_iter()
        .map(|p| p + Vector::new(noise.next(), noise.next(), noise.next()) * scan.noise_mm)
        .collect();
    mesh.with_positions(positions).ok()
}

/// Normal deviates by the Box-Muller transform of a linear congruential sequence, the same in every run.
struct Noise(u64);

impl Noise {
    /// Between 0 and 1, never 0.
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 11) as f64 + 0.5) / (1u64 << 53) as f64
    }

    fn next(&mut self) -> f64 {
        let (a, b) = (self.uniform(), self.uniform());
        (-2.0 * a.ln()).sqrt() * (std::f64::consts::TAU * b).cos()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_has_the_moments_of_a_normal_deviate() {
        let mut noise = Noise(7);
        let all: Vec<f64> = (0..40_000).map(|_| noise.next()).collect();
        let mean = all.iter().sum::<f64>() / all.len() as f64;
        let square = all.iter().map(|v| v * v).sum::<f64>() / all.len() as f64;
        let fourth = all.iter().map(|v| v.powi(4)).sum::<f64>() / all.len() as f64;
        // Five standard deviations of each moment of 40 000.
        assert!(mean.abs() < 0.025 && (square - 1.0).abs() < 0.036 && (fourth - 3.0).abs() < 0.25);
    }
}
