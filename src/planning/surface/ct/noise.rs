//! Noise of a CT, and its reduction where it would hide surfaces.

use super::tuning::{NOISE_WINDOW_HU, NOISY_HU};
use prosopon_geometry::{ScalarGrid, Warning};
use rayon::prelude::*;

/// Averages neighbours where soft tissue is noisier than [`NOISY_HU`], and reports it.
pub(super) fn reduce(hu: &mut ScalarGrid) -> Option<Warning> {
    let noise = of_soft_tissue(hu);
    if noise <= NOISY_HU {
        return None;
    }
    let plane = hu.dims[0] * hu.dims[1];
    for (axis, stride) in [1, hu.dims[0], plane].into_iter().enumerate() {
        hu.values = averaged(&hu.values, hu.dims[axis], stride);
    }
    let message = format!(
        "soft tissue has a noise of about {noise:.0} HU; values were averaged over neighbours {:.1} mm apart, which blurs thin bone",
        hu.spacing
    );
    Some(Warning::check("noisy-volume", message).act("Check thin bone and the skin, or use a smoother reconstruction."))
}

/// Standard deviation of the noise of soft tissue, HU, from the median difference of neighbours along x; 0 without soft tissue.
fn of_soft_tissue(hu: &ScalarGrid) -> f64 {
    let [low, high] = NOISE_WINDOW_HU;
    let largest = (high - low) as usize;
    let mut counts = vec![0u64; largest + 1];
    for row in hu.values.chunks(hu.dims[0]) {
        for (a, b) in row.iter().zip(&row[1..]) {
            if (low..=high).contains(a) && (low..=high).contains(b) {
                counts[((a - b).abs() as usize).min(largest)] += 1;
            }
        }
    }
    let half = counts.iter().sum::<u64>().div_ceil(2);
    let mut below = 0;
    let median = counts.iter().position(|n| {
        below += n;
        below >= half
    });
    // The median of the absolute value is 0.6745 standard deviations, and a difference has √2 of those of its parts. Differences
    // were rounded down.
    median.filter(|_| half > 0).map_or(0.0, |m| (m as f64 + 0.5) / 0.6745 / std::f64::consts::SQRT_2)
}

/// One pass of (1, 2, 1) / 4 along an axis; beyond the border the last sample repeats.
fn averaged(values: &[f32], length: usize, stride: usize) -> Vec<f32> {
    let at = |at: usize| {
        let place = at / stride % length;
        let before = if place > 0 { values[at - stride] } else { values[at] };
        let after = if place + 1 < length { values[at + stride] } else { values[at] };
        0.25 * (before + 2.0 * values[at] + after)
    };
    (0..values.len()).into_par_iter().map(at).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use prosopon_geometry::{Aabb, Point};

    /// Soft tissue with evenly distributed noise of a standard deviation, HU.
    fn tissue(deviation: f64) -> ScalarGrid {
        let bounds = Aabb { min: Point::origin(), max: Point::new(30.0, 30.0, 30.0) };
        let mut hu = ScalarGrid::covering(&bounds, 1.0, 0.0);
        let mut state = 7_u64;
        for value in &mut hu.values {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let share = (state >> 40) as f64 / f64::from(1 << 24);
            *value = (40.0 + (share - 0.5) * deviation * 12f64.sqrt()) as f32;
        }
        hu
    }

    #[test]
    fn noise_is_measured_and_reduced_only_where_it_is_high() {
        for (deviation, is_reduced) in [(0.0, false), (30.0, false), (120.0, true)] {
            let mut hu = tissue(deviation);
            let before = hu.clone();
            let found = of_soft_tissue(&hu);
            // The median of a triangular distribution (the difference of two even ones) is 6 % above that of a normal one.
            assert!((found - deviation).abs() < 0.1 * deviation + 1.0, "{deviation}: {found}");
            let warning = reduce(&mut hu);
            assert_eq!((warning.is_some(), hu != before), (is_reduced, is_reduced), "{deviation}");
            if is_reduced {
                // The variance of (1, 2, 1) / 4 is 3/8 along each axis, thus the deviation falls to 0.23; along x, neighbours
                // are alike, so that the difference falls more.
                assert!(of_soft_tissue(&hu) < 0.23 * deviation, "{}", of_soft_tissue(&hu));
            }
        }
    }
}
