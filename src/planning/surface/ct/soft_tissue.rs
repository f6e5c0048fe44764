//! Local mean of soft tissue in a CT, which distinguishes fat from muscle.

use super::tuning::{MAX_MEAN_HU, MIN_SOFT_SHARE, PASSES, SOFT_HU, SOFT_SPACING_MM};
use rayon::prelude::*;

use prosopon_geometry::{ScalarGrid, Vector};

/// Local mean of soft tissue on a lattice of about 2 mm, in whole HU from -127 to 127.
/// It is NaN where there is hardly any soft tissue. Noise and streaks average out; air and bone do not count.
pub(super) fn soft_tissue(hu: &ScalarGrid) -> ScalarGrid {
    let n = ((SOFT_SPACING_MM / hu.spacing).round() as usize).max(1);
    let dims = hu.dims.map(|d| d.div_ceil(n).max(2));
    let plane = dims[0] * dims[1];
    // Sum of values and share of soft tissue in a block of n³ samples.
    let block = |at: usize| -> [f32; 2] {
        let first = [at % dims[0], at / dims[0] % dims[1], at / plane].map(|c| n * c);
        let end = |a: usize| (first[a] + n).min(hu.dims[a]);
        let mut sum = [0.0; 2];
        for k in first[2]..end(2) {
            for j in first[1]..end(1) {
                for i in first[0]..end(0) {
                    let value = hu.values[hu.index(i, j, k)];
                    if SOFT_HU.contains(&value) {
                        sum[0] += value;
                        sum[1] += 1.0;
                    }
                }
            }
        }
        sum.map(|s| s / (n * n * n) as f32)
    };
    let mut sums: Vec<[f32; 2]> = (0..plane * dims[2]).into_par_iter().map(block).collect();
    for _ in 0..PASSES {
        for (axis, stride) in [1, dims[0], plane].into_iter().enumerate() {
            sums = smoothed(&sums, dims, axis, stride);
        }
    }
    let mean = |[sum, share]: [f32; 2]| {
        if share < MIN_SOFT_SHARE { f32::NAN } else { (sum / share).round().clamp(-MAX_MEAN_HU, MAX_MEAN_HU) }
    };
    let middle = Vector::repeat(0.5 * (n - 1) as f64 * hu.spacing);
    ScalarGrid {
        dims,
        origin: hu.origin + middle,
        spacing: n as f64 * hu.spacing,
        values: sums.into_iter().map(mean).collect(),
    }
}

/// One pass of (1, 2, 1) / 4 along an axis; samples beyond the border are 0.
fn smoothed(values: &[[f32; 2]], dims: [usize; 3], axis: usize, stride: usize) -> Vec<[f32; 2]> {
    let place = |at: usize| at / stride % dims[axis];
    let of = |at: usize| {
        let [mut sum, mut share] = values[at].map(|v| 0.5 * v);
        let beside = [(place(at) > 0).then(|| at - stride), (place(at) + 1 < dims[axis]).then_some(at + stride)];
        for other in beside.into_iter().flatten() {
            sum += 0.25 * values[other][0];
            share += 0.25 * values[other][1];
        }
        [sum, share]
    };
    (0..values.len()).into_par_iter().map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use prosopon_geometry::{Aabb, Point};

    /// Muscle of 55 HU below z = 0, fat of -95 above, bone beyond x = 20, air beyond x = -20, noise of 60 HU.
    fn layers() -> ScalarGrid {
        let bounds = Aabb { min: Point::new(-30.0, -10.0, -20.0), max: Point::new(30.0, 10.0, 20.0) };
        let mut hu = ScalarGrid::covering(&bounds, 1.0, 0.0);
        let mut state = 7_u32;
        for k in 0..hu.dims[2] {
            for j in 0..hu.dims[1] {
                for i in 0..hu.dims[0] {
                    let p = hu.position(i, j, k);
                    state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                    let noise = (f64::from(state >> 8) / f64::from(1 << 24) - 0.5) * 120.0;
                    let soft = if p.z < 0.0 { 55.0 } else { -95.0 };
                    let value = if p.x > 20.0 { 900.0 } else { soft + noise };
                    let at = hu.index(i, j, k);
                    hu.values[at] = if p.x < -20.0 { -1000.0 } else { value as f32 };
                }
            }
        }
        hu
    }

    #[test]
    fn layers_are_told_apart_through_noise_and_beside_bone_and_air() {
        let found = soft_tissue(&layers());
        assert_eq!(found.spacing, 2.0);
        for x in [-17.0, 0.0, 18.0] {
            for y in [-6.0, 4.0] {
                let (muscle, fat) = (found.sample(&Point::new(x, y, -5.0)), found.sample(&Point::new(x, y, 5.0)));
                // The mean of about 60 values with a standard deviation of 35 HU; those of fat are truncated at -150.
                assert!((muscle - 55.0).abs() < 15.0 && (fat + 93.0).abs() < 15.0, "{x} {y}: {muscle} {fat}");
            }
        }
        assert!(found.sample(&Point::new(27.0, 0.0, 0.0)).is_nan(), "bone");
        assert!(found.sample(&Point::new(-27.0, 0.0, 0.0)).is_nan(), "air");
        assert!(found.values.iter().all(|v| v.is_nan() || v.fract() == 0.0));
    }
}
