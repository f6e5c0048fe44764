//! Values of air and soft tissue in a volume of unknown units.

use super::histogram::{Histogram, Peak, Peaks};
use super::tuning::{
    AIR_LEVEL_HU, AIR_PEAK_SHARE, AIR_WIDTH, BONE_HU, BONE_STEPS, HU_AIR, HU_SOFT, PADDING_SHARE, PADDING_STEP,
    SEPARATION, SKIN_HU, SOFT_LEVEL_HU, SOFT_SHARE, SOFT_STEP,
};
use prosopon_geometry::Volume;

/// Values of air and soft tissue in a volume, in its own units. They fix its linear relation to HU.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Levels {
    /// Value of air, -1000 in HU.
    pub air: f64,
    /// Value of soft tissue, 40 in HU.
    pub soft_tissue: f64,
}

impl Levels {
    /// Those of a volume in HU.
    pub const HU: Self = Self { air: AIR_LEVEL_HU, soft_tissue: SOFT_LEVEL_HU };

    /// The levels with which `skin` and `bone` are the default thresholds.
    pub(super) fn from_thresholds(skin: f64, bone: f64) -> Self {
        let step = (bone - skin) / (BONE_HU - SKIN_HU);
        let at = |hu: f64| skin + step * (hu - SKIN_HU);
        Self { air: at(AIR_LEVEL_HU), soft_tissue: at(SOFT_LEVEL_HU) }
    }

    /// The volume's value at `hu`.
    #[must_use]
    pub fn at_hu(&self, hu: f64) -> f64 {
        self.air + (hu - AIR_LEVEL_HU) * (self.soft_tissue - self.air) / (SOFT_LEVEL_HU - AIR_LEVEL_HU)
    }

    /// The HU of one of the volume's values.
    #[must_use]
    pub fn to_hu(&self, value: f64) -> f64 {
        AIR_LEVEL_HU + (value - self.air) * (SOFT_LEVEL_HU - AIR_LEVEL_HU) / (self.soft_tissue - self.air)
    }

    /// Whether these are plausible levels of a volume in HU.
    fn are_hu(&self) -> bool {
        within(HU_AIR, self.air) && within(HU_SOFT, self.soft_tissue)
    }
}

fn within([min, max]: [f64; 2], value: f64) -> bool {
    (min..=max).contains(&value)
}

/// What the histogram of a volume shows.
pub(super) struct Values {
    /// Levels of air and soft tissue; `None` when they were not found.
    pub(super) levels: Option<Levels>,
    /// Whether the values are taken for HU.
    pub(super) in_hu: bool,
    /// Value that fills the corners of the volume: padding, or air without noise.
    pub(super) filling: Option<i16>,
    /// Whether air was found beside the filling, which is padding then.
    pub(super) is_padding: bool,
    /// All voxels.
    pub(super) histogram: Histogram,
    peaks: Vec<Peak>,
}

impl Values {
    pub(super) fn of(volume: &Volume) -> Self {
        let histogram = Histogram::of(volume.hu.iter().copied());
        let filling = filling(volume, &histogram);
        let all = histogram.peaks();
        let of_all = levels(&all, &histogram);
        // Beside air without noise, the lowest peak that remains is the mixture of air and tissue in one voxel, a little above it.
        let is_far = |value: i16, rest: &Levels| {
            (f64::from(value) - rest.air).abs() > PADDING_STEP * (rest.soft_tissue - rest.air)
        };
        let of_rest = filling.and_then(|value| beside_padding(value, &histogram).filter(|rest| is_far(value, rest)));
        // The filling of a volume in HU is air without noise, and what remains is the mixture of air and tissue in one voxel.
        let is_padding = of_rest.is_some_and(|rest| rest.are_hu() || !of_all.is_some_and(|all| all.are_hu()));
        let levels = if is_padding { of_rest } else { of_all };
        let in_hu = match levels {
            Some(levels) => levels.are_hu(),
            // A volume that shows only air, or only tissue, may be in HU.
            None => match all.peaks.as_slice() {
                [one] => within(HU_AIR, one.value) || within(HU_SOFT, one.value),
                _ => within(HU_AIR, f64::from(histogram.quantile(0.0005))),
            },
        };
        Self { levels, in_hu, filling, is_padding, histogram, peaks: all.peaks }
    }

    /// Text of the percentiles and peaks.
    pub(super) fn description(&self) -> String {
        let at = |q: f64| self.histogram.quantile(q);
        let peaks: Vec<String> =
            self.peaks.iter().map(|p| format!("{:.0} ({:.0} % of the voxels)", p.value, 100.0 * p.share)).collect();
        format!(
            "the percentiles 1, 50 and 99 are {}, {} and {}, and the histogram has {} at {}",
            at(0.01),
            at(0.5),
            at(0.99),
            if peaks.len() == 1 { "its only peak" } else { "peaks" },
            peaks.join(", ")
        )
    }
}

/// Levels of the voxels without the value of the padding, when these show a peak of air.
fn beside_padding(padding: i16, histogram: &Histogram) -> Option<Levels> {
    let rest = histogram.clone().without(padding, u64::MAX);
    let found = levels(&rest.peaks(), &rest)?;
    let step = found.soft_tissue - found.air;
    let share = |from: f64, to: f64| rest.share_above(from) - rest.share_above(to);
    // Values of voxels that air and tissue share lie evenly between both and have no narrow peak.
    let near = share(found.air - AIR_WIDTH * step, found.air + AIR_WIDTH * step);
    let lower = 1.0 - rest.share_above(found.air + 0.5 * step);
    let is_peak = near > AIR_PEAK_SHARE * lower;
    is_peak.then_some(found)
}

/// Levels of a histogram whose lowest peak is air.
fn levels(found: &Peaks, histogram: &Histogram) -> Option<Levels> {
    let (air, upper) = found.peaks.split_first()?;
    let largest = upper.iter().max_by(|a, b| a.share.total_cmp(&b.share))?;
    let reach = SOFT_STEP * (largest.value - air.value);
    let is_muscle =
        |p: &&Peak| p.value > largest.value && p.value - largest.value < reach && p.share > SOFT_SHARE * largest.share;
    let soft = upper.iter().rfind(is_muscle).unwrap_or(largest);
    let step = soft.value - air.value;
    // The 98 % quantile of tissue.
    let not_air = histogram.share_above(air.value + 0.5 * step);
    let bone_steps = (f64::from(histogram.quantile(1.0 - 0.02 * not_air)) - soft.value) / step;
    let usable = found.valley(air, soft) <= SEPARATION && within(BONE_STEPS, bone_steps);
    usable.then_some(Levels { air: air.value, soft_tissue: soft.value })
}

/// Value of at least six corners of the volume when it fills a good part of it.
fn filling(volume: &Volume, histogram: &Histogram) -> Option<i16> {
    let [nx, ny, nz] = volume.dims;
    let corner = |c: usize| {
        let place = [(c & 1) * (nx - 1), (c >> 1 & 1) * (ny - 1), (c >> 2) * (nz - 1)];
        volume.hu.get(place[0] + nx * (place[1] + ny * place[2])).copied()
    };
    let corners: Vec<i16> = (0..8).filter_map(corner).collect();
    let value = *corners.iter().find(|value| corners.iter().filter(|other| other == value).count() >= 6)?;
    let enough = PADDING_SHARE * histogram.total() as f64;
    (histogram.count(value) as f64 >= enough).then_some(value)
}
