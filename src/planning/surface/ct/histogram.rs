//! Histogram of a volume's values and its peaks.

use super::tuning::{BINS, MERGE_RATIO, MIN_PEAK_SHARE, SMOOTH_BINS};

/// Number of voxels for each 16-bit value.
#[derive(Clone)]
pub(super) struct Histogram {
    counts: Vec<u64>,
    total: u64,
}

/// A maximum of the smoothed histogram.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Peak {
    /// Mean of the values around the maximum.
    pub(super) value: f64,
    /// Share of all voxels between the valleys on both sides.
    pub(super) share: f64,
    /// Height in the smoothed histogram, in voxels for each bin.
    height: f64,
    /// Bin of the maximum.
    bin: usize,
}

/// Peaks of a histogram in ascending order, and the smoothed bins they were found in.
pub(super) struct Peaks {
    pub(super) peaks: Vec<Peak>,
    bins: Vec<f64>,
}

impl Peaks {
    /// Lowest point between two peaks as a share of the lower peak.
    pub(super) fn valley(&self, a: &Peak, b: &Peak) -> f64 {
        let between = self.bins.get(a.bin..=b.bin).unwrap_or_default();
        let lowest = between.iter().copied().fold(f64::MAX, f64::min);
        lowest / a.height.min(b.height)
    }
}

impl Histogram {
    pub(super) fn of(values: impl Iterator<Item = i16>) -> Self {
        let mut counts = vec![0u64; 1 << 16];
        for value in values {
            counts[index(value)] += 1;
        }
        let total = counts.iter().sum();
        Self { counts, total }
    }

    /// The same without `n` voxels of one value.
    pub(super) fn without(mut self, value: i16, n: u64) -> Self {
        let count = &mut self.counts[index(value)];
        let n = n.min(*count);
        *count -= n;
        self.total -= n;
        self
    }

    /// Number of voxels.
    pub(super) fn total(&self) -> u64 {
        self.total
    }

    /// Number of voxels with this value.
    pub(super) fn count(&self, value: i16) -> u64 {
        self.counts[index(value)]
    }

    /// Number of different values.
    #[cfg(test)]
    fn n_values(&self) -> usize {
        self.counts.iter().filter(|n| **n > 0).count()
    }

    /// Smallest value that at least the share `q` of the voxels do not exceed; 0 without voxels.
    pub(super) fn quantile(&self, q: f64) -> i16 {
        let wanted = ((q * self.total as f64).ceil() as u64).max(1);
        let mut below = 0;
        let found = self.counts.iter().position(|n| {
            below += n;
            below >= wanted
        });
        found.map_or(0, value)
    }

    /// Share of the voxels above a level.
    pub(super) fn share_above(&self, level: f64) -> f64 {
        let above = self.counts.iter().enumerate().filter(|(at, _)| f64::from(value(*at)) > level).map(|(_, n)| n);
        above.sum::<u64>() as f64 / self.total.max(1) as f64
    }

    /// Peaks that stand out of the histogram between its 0.05 and 99.5 % quantiles.
    pub(super) fn peaks(&self) -> Peaks {
        let (low, high) = (i64::from(self.quantile(0.0005)), i64::from(self.quantile(0.995)));
        let width = (high - low).div_euclid(BINS) + 1;
        let n = ((high - low) / width + 1) as usize;
        let mut raw = vec![0.0; n];
        for (at, count) in self.counts.iter().enumerate() {
            let bin = (i64::from(value(at)) - low).div_euclid(width);
            if let Some(bin) = usize::try_from(bin).ok().and_then(|bin| raw.get_mut(bin)) {
                *bin += *count as f64;
            }
        }
        let bins = smoothed(&raw);
        let peaks = standing_out(&bins, &raw).into_iter().map(|(bin, share)| Peak {
            value: self.mean_around(low + width * bin as i64 + width / 2, 2 * width),
            share,
            height: bins[bin],
            bin,
        });
        Peaks { peaks: peaks.collect(), bins }
    }

    /// Mean of the values within `reach` of `middle`.
    fn mean_around(&self, middle: i64, reach: i64) -> f64 {
        let (mut sum, mut n) = (0.0, 0.0);
        for (at, count) in self.counts.iter().enumerate() {
            let value = value(at);
            if (i64::from(value) - middle).abs() <= reach {
                sum += f64::from(value) * *count as f64;
                n += *count as f64;
            }
        }
        if n > 0.0 { sum / n } else { middle as f64 }
    }
}

fn index(value: i16) -> usize {
    (i32::from(value) - i32::from(i16::MIN)) as usize
}

fn value(index: usize) -> i16 {
    (index as i64 + i64::from(i16::MIN)) as i16
}

/// Gaussian mean over bins, with a standard deviation of [`SMOOTH_BINS`].
fn smoothed(raw: &[f64]) -> Vec<f64> {
    let reach = (3.0 * SMOOTH_BINS).ceil() as usize;
    let weight = |d: usize| (-0.5 * (d as f64 / SMOOTH_BINS).powi(2)).exp();
    let total: f64 = weight(0) + 2.0 * (1..=reach).map(weight).sum::<f64>();
    let at = |bin: usize| {
        let range = bin.saturating_sub(reach)..(bin + reach + 1).min(raw.len());
        range.map(|other| raw[other] * weight(other.abs_diff(bin))).sum::<f64>() / total
    };
    (0..raw.len()).map(at).collect()
}

/// Maxima that stand out of `bins`, ascending, with the share of `raw` between their valleys.
///
/// Of two neighbours, the lower one goes when the valley between them is hardly lower than it. Then peaks with few voxels go.
fn standing_out(bins: &[f64], raw: &[f64]) -> Vec<(usize, f64)> {
    let n = bins.len();
    let rises = |b: usize| b == 0 || bins[b] > bins[b - 1];
    let falls = |b: usize| b + 1 == n || bins[b] >= bins[b + 1];
    let mut peaks: Vec<usize> = (0..n).filter(|&b| bins[b] > 0.0 && rises(b) && falls(b)).collect();
    let lowest = |a: usize, b: usize| (a..=b).min_by(|x, y| bins[*x].total_cmp(&bins[*y])).unwrap_or(a);
    loop {
        let shallow = |pair: &[usize]| bins[lowest(pair[0], pair[1])] / bins[pair[0]].min(bins[pair[1]]);
        let worst = peaks.windows(2).map(shallow).enumerate().max_by(|a, b| a.1.total_cmp(&b.1));
        let Some((at, _)) = worst.filter(|(_, ratio)| *ratio > MERGE_RATIO) else { break };
        let lower = if bins[peaks[at]] < bins[peaks[at + 1]] { at } else { at + 1 };
        peaks.remove(lower);
    }
    let total: f64 = raw.iter().sum();
    let share = |peaks: &[usize], at: usize| {
        let from = if at == 0 { 0 } else { lowest(peaks[at - 1], peaks[at]) };
        let to = if at + 1 == peaks.len() { n } else { lowest(peaks[at], peaks[at + 1]) };
        raw[from..to].iter().sum::<f64>() / total.max(1.0)
    };
    while let Some(few) = (0..peaks.len()).find(|&at| share(&peaks, at) < MIN_PEAK_SHARE) {
        peaks.remove(few);
    }
    (0..peaks.len()).map(|at| (peaks[at], share(&peaks, at))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Values of two or more normal distributions: (mean, standard deviation, number), by the quantiles of a logistic curve.
    fn values(of: &[(f64, f64, usize)]) -> Vec<i16> {
        let one = |&(mean, deviation, n): &(f64, f64, usize)| {
            (0..n).map(move |i| {
                let q = (i as f64 + 0.5) / n as f64;
                (mean + 0.551 * deviation * (q / (1.0 - q)).ln()).round() as i16
            })
        };
        of.iter().flat_map(one).collect()
    }

    #[test]
    fn peaks_are_found_in_any_units() {
        let cases: [(&str, &[(f64, f64, usize)], &[f64]); 5] = [
            ("HU", &[(-1000.0, 10.0, 50_000), (40.0, 20.0, 40_000), (900.0, 300.0, 9_000)], &[-1000.0, 40.0]),
            ("8 bits", &[(12.0, 2.0, 5_000), (90.0, 4.0, 60_000), (160.0, 25.0, 9_000)], &[12.0, 90.0]),
            ("little air", &[(60.0, 30.0, 2_000), (1100.0, 60.0, 90_000), (1900.0, 200.0, 5_000)], &[60.0, 1100.0]),
            ("noise", &[(500.0, 150.0, 40_000), (1540.0, 150.0, 40_000)], &[500.0, 1540.0]),
            ("one", &[(1000.0, 40.0, 90_000)], &[1000.0]),
        ];
        for (name, distributions, expected) in cases {
            let histogram = Histogram::of(values(distributions).into_iter());
            let found: Vec<f64> = histogram.peaks().peaks.iter().map(|p| p.value).collect();
            let widest = distributions.iter().map(|d| d.1).fold(0.0, f64::max).min(150.0);
            assert!(
                found.len() >= expected.len()
                    && expected.iter().zip(&found).all(|(e, f)| (e - f).abs() < 0.2 * widest + 2.0),
                "{name}: {found:?}"
            );
        }
    }

    #[test]
    fn quantiles_and_shares_count_voxels() {
        let histogram = Histogram::of([1, 1, 2, 3, 5, 5, 5, 9].into_iter());
        assert_eq!([0.0, 0.25, 0.5, 1.0].map(|q| histogram.quantile(q)), [1, 1, 3, 9]);
        assert_eq!((histogram.share_above(4.0), histogram.n_values(), histogram.total()), (0.5, 5, 8));
        let rest = histogram.without(5, 2);
        assert_eq!((rest.count(5), rest.total(), rest.quantile(1.0)), (1, 6, 9));
        assert_eq!(Histogram::of(std::iter::empty()).quantile(0.5), 0);
    }
}
