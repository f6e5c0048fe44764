//! Capped Euclidean distances on a lattice, in steps.

use rayon::prelude::*;

/// The lower bits of a key hold the seed's offset in 1/4096 steps, the higher bits the squared distance.
const OFFSET_BITS: u32 = 12;
const OFFSET_SCALE: f32 = (1 << OFFSET_BITS) as f32;
const LARGEST_OFFSET: f32 = OFFSET_SCALE - 1.0;

/// Distance of each sample to the nearest seed, and the offset stored with that seed.
pub(super) struct Nearest {
    keys: Vec<u32>,
    beyond: u32,
}

impl Nearest {
    /// Computes the distances exactly by minimising the squared distance one axis at a time.
    ///
    /// `seed` returns the offset of a seed, 0 to 1 steps, and `None` for other samples. Distances above `cap` steps are not
    /// distinguished. Samples beyond the lattice are not seeds. Of equally near seeds the one with the smaller offset is used.
    ///
    /// # Source
    /// Saito & Toriwaki, New algorithms for Euclidean distance transformation, 1994.
    pub(super) fn of(seed: impl Fn(usize) -> Option<f32> + Sync, dims: [usize; 3], cap: u16) -> Self {
        let [nx, ny, nz] = dims;
        let cap = usize::from(cap);
        let beyond = ((cap + 1) * (cap + 1)) as u32;
        let key = |at: usize| match seed(at) {
            Some(offset) => (offset * OFFSET_SCALE).clamp(0.0, LARGEST_OFFSET) as u32,
            None => beyond << OFFSET_BITS,
        };
        let mut keys: Vec<u32> = (0..nx * ny * nz).into_par_iter().map(key).collect();
        keys.par_chunks_mut(nx).for_each_init(
            || vec![0; nx],
            |copy, row| {
                copy.copy_from_slice(row);
                for step in 1..=cap.min(nx - 1) {
                    lower(&mut row[step..], &copy[..nx - step], step);
                    lower(&mut row[..nx - step], &copy[step..], step);
                }
            },
        );
        let keys = nearest_row(&keys, nx, cap, |row| (row % ny, ny, 1));
        let keys = nearest_row(&keys, nx, cap, |row| (row / ny, nz, ny));
        Self { keys, beyond }
    }

    /// Distance to the nearest seed and that seed's offset, both in steps; `None` beyond the cap.
    pub(super) fn get(&self, at: usize) -> Option<(f32, f32)> {
        let squared = self.keys[at] >> OFFSET_BITS;
        let offset = (self.keys[at] & ((1 << OFFSET_BITS) - 1)) as f32 / OFFSET_SCALE;
        (squared < self.beyond).then(|| ((squared as f32).sqrt(), offset))
    }

    /// Whether the nearest seed is farther than `steps`, which must not exceed the cap.
    pub(super) fn is_farther(&self, at: usize, steps: f64) -> bool {
        f64::from(self.keys[at] >> OFFSET_BITS) > steps * steps
    }
}

fn lower(out: &mut [u32], values: &[u32], step: usize) {
    let add = ((step * step) as u32) << OFFSET_BITS;
    for (o, v) in out.iter_mut().zip(values) {
        *o = (*o).min(v + add);
    }
}

/// Minimum over the rows at most `cap` steps away along one axis.
/// For a row, `axis` returns its index along the axis, the axis's length, and the number of rows per step.
fn nearest_row(keys: &[u32], nx: usize, cap: usize, axis: impl Fn(usize) -> (usize, usize, usize) + Sync) -> Vec<u32> {
    let mut nearest = keys.to_vec();
    nearest.par_chunks_mut(nx).enumerate().for_each(|(row, out)| {
        let (at, length, stride) = axis(row);
        for step in 1..=cap {
            if at >= step {
                lower(out, &keys[(row - step * stride) * nx..][..nx], step);
            }
            if at + step < length {
                lower(out, &keys[(row + step * stride) * nx..][..nx], step);
            }
        }
    });
    nearest
}

/// Distance in steps from sample `at`, where `value` is negative, to the zero of `value`.
/// `None` when all six neighbours are negative too. The value is taken as linear, with the slopes towards the larger
/// neighbours.
pub(super) fn to_zero(value: impl Fn(usize) -> f32, dims: [usize; 3], at: usize) -> Option<f32> {
    let here = value(at);
    if here >= 0.0 {
        return None;
    }
    let place = [at % dims[0], at / dims[0] % dims[1], at / dims[0] / dims[1]];
    let strides = [1, dims[0], dims[0] * dims[1]];
    let (mut slope_sq, mut crossed) = (0.0, false);
    for a in 0..3 {
        let below = if place[a] > 0 { value(at - strides[a]) } else { here };
        let above = if place[a] + 1 < dims[a] { value(at + strides[a]) } else { here };
        let larger = below.max(above).max(here);
        crossed |= larger >= 0.0;
        slope_sq += (larger - here) * (larger - here);
    }
    crossed.then(|| -here / slope_sq.sqrt())
}

#[cfg(test)]
mod tests {
    use super::super::test_masks::{place, speckle};
    use super::*;

    #[test]
    fn distances_are_those_of_brute_force() {
        let dims = [13, 9, 11];
        let cap = 4;
        for n in [2, 40, 400] {
            let mask = speckle(dims, n);
            let found = Nearest::of(|at| mask[at].then_some(at as f32 / 4096.0), dims, cap);
            for at in 0..mask.len() {
                let p = place(at, dims);
                let to = |q: &usize| (0..3).map(|a| (p[a] - place(*q, dims)[a]).pow(2)).sum::<i64>();
                let nearest = (0..mask.len()).filter(|&q| mask[q]).min_by_key(|q| (to(q), *q));
                match nearest.map(|q| (to(&q), q)) {
                    Some((squared, q)) if squared <= i64::from(cap * cap) => {
                        let (distance, offset) = found.get(at).unwrap();
                        assert_eq!(distance, (squared as f32).sqrt());
                        assert_eq!((offset * 4096.0) as usize, q);
                        assert_eq!(found.is_farther(at, 2.5), squared > 6);
                    }
                    // Distances up to the next whole square beyond the cap may still be returned.
                    _ => assert!(found.get(at).is_none_or(|(d, _)| d > f32::from(cap))),
                }
            }
        }
    }

    #[test]
    fn distances_from_planes_have_subvoxel_accuracy() {
        let dims = [24, 24, 24];
        for normal in [[1.0, 0.0, 0.0], [0.48, 0.6, 0.64], [0.0, 0.6, 0.8], [0.36, 0.48, 0.8], [0.8, -0.6, 0.0]] {
            let depth = |at: usize| (0..3).map(|a| normal[a] * (place(at, dims)[a] as f64 - 11.37)).sum::<f64>();
            let found = Nearest::of(|at| to_zero(|b| depth(b) as f32, dims, at), dims, 6);
            let middle = |at: usize| place(at, dims).iter().all(|c| (8..16).contains(c));
            for at in (0..dims.iter().product()).filter(|at| middle(*at) && depth(*at) < 0.0 && depth(*at) > -4.0) {
                let (distance, offset) = found.get(at).unwrap();
                let error = f64::from(distance + offset) + depth(at);
                // The distance is never too small; it may be too large because the nearest seed need not be the foot of the
                // perpendicular.
                assert!((-0.01..0.4).contains(&error), "{error} at depth {} below {normal:?}", depth(at));
            }
        }
    }
}
