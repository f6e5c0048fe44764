//! Averages over neighbourhoods on a surface.

use super::distance::{Welded, welded};
use super::statistics::vertex_areas;
use super::tuning::MAX_ROUNDS;
use prosopon_geometry::{TriMesh, Vector};

/// Repeated averaging over vertex neighbours that approximates a Gaussian of a given standard deviation.
///
/// Vertices with equal coordinates are merged. One round over a vertex and its neighbours adds 3/7 of the squared edge length
/// to the variance along each axis (exact on equilateral triangles).
pub(super) struct Neighbourhoods {
    welded: Welded,
    /// Ordered pairs of neighbours, ascending; each edge appears in both directions.
    pairs: Vec<(u32, u32)>,
    rounds: usize,
}

impl Neighbourhoods {
    /// Prepares averages over `mesh` with the standard deviation `radius_mm`.
    pub(super) fn new(mesh: &TriMesh, radius_mm: f64) -> Self {
        let welded = welded(mesh);
        let mut pairs: Vec<(u32, u32)> = welded
            .triangles
            .iter()
            .flat_map(|&[a, b, c]| [(a, b), (b, a), (b, c), (c, b), (c, a), (a, c)])
            .filter(|(a, b)| a != b)
            .collect();
        pairs.sort_unstable();
        pairs.dedup();
        let edge_sq =
            |&(a, b): &(u32, u32)| (welded.positions[a as usize] - welded.positions[b as usize]).norm_squared();
        let mean_sq = pairs.iter().map(edge_sq).sum::<f64>() / pairs.len().max(1) as f64;
        let rounds = (radius_mm * radius_mm * 7.0 / (3.0 * mean_sq.max(1e-12))).ceil();
        Self { welded, pairs, rounds: (rounds as usize).clamp(1, MAX_ROUNDS) }
    }

    /// Averages of `values`, one per vertex. NaN values do not contribute and stay NaN.
    pub(super) fn averaged(&self, values: &[f32]) -> Vec<f32> {
        let n = self.welded.positions.len();
        let (mut now, mut counts) = (vec![0.0f64; n], vec![0u32; n]);
        for (value, v) in values.iter().zip(&self.welded.number).filter(|(value, _)| value.is_finite()) {
            now[*v as usize] += f64::from(*value);
            counts[*v as usize] += 1;
        }
        for (value, count) in now.iter_mut().zip(&counts) {
            *value = if *count > 0 { *value / f64::from(*count) } else { f64::NAN };
        }
        for _ in 0..self.rounds {
            let (mut sums, mut weights) = (now.clone(), vec![1.0f64; n]);
            for &(a, b) in &self.pairs {
                let value = now[b as usize];
                if value.is_finite() {
                    sums[a as usize] += value;
                    weights[a as usize] += 1.0;
                }
            }
            sums.iter_mut().zip(&weights).for_each(|(sum, weight)| *sum /= weight);
            now = sums;
        }
        self.welded.number.iter().map(|v| now[*v as usize] as f32).collect()
    }

    /// Averaged unit normals, one per vertex of the mesh; zero where undefined.
    pub(super) fn normals(&self, mesh: &TriMesh) -> Vec<Vector> {
        let mut now = vec![Vector::zeros(); self.welded.positions.len()];
        for (t, corners) in self.welded.triangles.iter().enumerate() {
            for v in corners {
                now[*v as usize] += mesh.scaled_normal(t);
            }
        }
        for _ in 0..self.rounds {
            let mut sums = now.clone();
            for &(a, b) in &self.pairs {
                sums[a as usize] += now[b as usize];
            }
            now = sums.into_iter().map(|s| s.try_normalize(0.0).unwrap_or_else(Vector::zeros)).collect();
        }
        self.welded.number.iter().map(|v| now[*v as usize]).collect()
    }
}

/// Root mean square of the part that averaging removes, weighted by area, mm.
pub(super) fn roughness(mesh: &TriMesh, raw: &[f32], averaged: &[f32]) -> f64 {
    let (mut sum, mut total) = (0.0, 0.0);
    for ((raw, averaged), area) in raw.iter().zip(averaged).zip(vertex_areas(mesh)) {
        let rest = f64::from(raw - averaged);
        if rest.is_finite() {
            sum += area * rest * rest;
            total += area;
        }
    }
    if total > 0.0 { (sum / total).sqrt() } else { 0.0 }
}
