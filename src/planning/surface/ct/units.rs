//! Brings a volume of any units to HU, to which the constants of the extraction refer.

use std::borrow::Cow;

use super::CtSettings;
use super::components::Components;
use super::levels::{Levels, Values};
use super::tuning::{AIR_HU, BONE_HU, PADDING_STEP, SKIN_HU};
use crate::surface::SurfaceError;
use prosopon_geometry::{Volume, Warning};

/// A volume in HU and the thresholds in it.
pub(super) struct InHu<'a> {
    pub(super) volume: Cow<'a, Volume>,
    pub(super) skin_hu: f64,
    pub(super) bone_hu: f64,
    /// Value that fills the corners of the given volume.
    pub(super) filling: Option<i16>,
    pub(super) warnings: Vec<Warning>,
}

/// Finds the units of a volume and converts other values than HU linearly: air to -1000 and soft tissue to 40 HU.
///
/// A volume in HU stays as it is, except that padding denser than air becomes air.
///
/// # Errors
/// [`SurfaceError::Level`] when a given threshold does not fit the values, [`SurfaceError::Volume`] when the values show no air
/// and soft tissue and the thresholds are not given.
pub(super) fn in_hu<'a>(volume: &'a Volume, settings: &CtSettings) -> Result<InHu<'a>, SurfaceError> {
    let values = Values::of(volume);
    check_given(&values, settings)?;
    let mut warnings = Vec::new();
    let levels = if values.in_hu { Levels::HU } else { other_levels(&values, settings, &mut warnings)? };
    let mut converted = if values.in_hu { Cow::Borrowed(volume) } else { Cow::Owned(scaled(volume, &levels)) };
    let threshold = |given: Option<f64>, default: f64| match given {
        Some(given) if values.in_hu => given,
        Some(given) => levels.to_hu(given),
        None => default,
    };
    let (skin_hu, bone_hu) = (threshold(settings.skin_hu, SKIN_HU), threshold(settings.bone_hu, BONE_HU));
    if skin_hu >= bone_hu {
        return Err(level("skin_hu", levels.at_hu(skin_hu), &values, "it must be below the level of bone"));
    }
    let step = levels.soft_tissue - levels.air;
    let is_dense = |value: &i16| f64::from(*value) - levels.air > PADDING_STEP * step;
    if let Some(padding) = values.filling.filter(|_| values.is_padding).filter(is_dense) {
        let n = fill_with_air(converted.to_mut(), volume, padding);
        let message = format!("{n} voxels outside the scanned circle with the value {padding} were set to air");
        warnings.push(Warning::info("padding-set-to-air", message));
    }
    Ok(InHu { volume: converted, skin_hu, bone_hu, filling: values.filling, warnings })
}

/// Levels of air and soft tissue of a volume, in its own units; [`Levels::HU`] when it is in HU.
///
/// # Errors
/// [`SurfaceError::Volume`] when its values show no air and soft tissue.
pub fn levels_of(volume: &Volume) -> Result<Levels, SurfaceError> {
    super::resample::check(volume)?;
    let values = Values::of(volume);
    if values.in_hu { Ok(Levels::HU) } else { values.levels.ok_or_else(|| not_found(&values)) }
}

/// Checks each given threshold against the range of the values, and both against each other.
fn check_given(values: &Values, settings: &CtSettings) -> Result<(), SurfaceError> {
    let [min, max] = [0.0, 1.0].map(|q| f64::from(values.histogram.quantile(q)));
    for (name, given) in [("skin_hu", settings.skin_hu), ("bone_hu", settings.bone_hu)] {
        if let Some(given) = given.filter(|given| !(min..max).contains(given)) {
            return Err(level(name, given, values, "it must lie within them"));
        }
    }
    match (settings.skin_hu, settings.bone_hu) {
        (Some(skin), Some(bone)) if skin >= bone => {
            Err(level("skin_hu", skin, values, "it must be below the level of bone"))
        }
        _ => Ok(()),
    }
}

fn level(name: &'static str, value: f64, values: &Values, rule: &'static str) -> SurfaceError {
    let [min, max] = [0.0, 1.0].map(|q| f64::from(values.histogram.quantile(q)));
    let found = match values.levels {
        Some(Levels { air, soft_tissue }) => format!(", air is {air:.0} and soft tissue {soft_tissue:.0}"),
        None => String::new(),
    };
    SurfaceError::Level { name, value, min, max, found, rule }
}

fn not_found(values: &Values) -> SurfaceError {
    let detail = format!(
        "its values are not Hounsfield units, and air and soft tissue are not found in them: {}. Use a volume that shows the \
         air around the face, or give `skin_hu` and `bone_hu` in the units of the volume, or a rescale to HU",
        values.description()
    );
    SurfaceError::Volume { detail }
}

/// Levels of a volume that is not in HU: those of the histogram, unless both given thresholds contradict them.
fn other_levels(values: &Values, settings: &CtSettings, warnings: &mut Vec<Warning>) -> Result<Levels, SurfaceError> {
    let given = settings.skin_hu.zip(settings.bone_hu);
    let agrees =
        |l: &Levels| given.is_none_or(|(skin, bone)| l.air < skin && skin < l.soft_tissue && l.soft_tissue < bone);
    if let Some(levels) = values.levels.filter(agrees) {
        warnings.push(from_histogram(values, &levels, settings));
        return Ok(levels);
    }
    let (skin, bone) = given.ok_or_else(|| not_found(values))?;
    let message = format!(
        "the values are not Hounsfield units; `skin_hu` {skin} and `bone_hu` {bone} were taken for {SKIN_HU} and {BONE_HU} HU"
    );
    let action = "Check the surfaces, and that fat and muscle are told apart; or send a rescale to HU.";
    warnings.push(Warning::check("levels-from-thresholds", message).act(action));
    Ok(Levels::from_thresholds(skin, bone))
}

fn from_histogram(values: &Values, levels: &Levels, settings: &CtSettings) -> Warning {
    let [skin, bone] = [(settings.skin_hu, SKIN_HU), (settings.bone_hu, BONE_HU)]
        .map(|(given, hu)| given.unwrap_or_else(|| levels.at_hu(hu)));
    let padding = values.filling.filter(|_| values.is_padding);
    let shown = padding.map(|value| values.histogram.clone().without(value, u64::MAX));
    let shown = shown.as_ref().unwrap_or(&values.histogram);
    let [tissue, dense] = [skin, bone].map(|at| 100.0 * shown.share_above(at));
    let message = format!(
        "the values are not Hounsfield units: the histogram shows air at {:.0} and soft tissue at {:.0}, so that skin is taken at \
         {skin:.0} and bone at {bone:.0} (soft tissue is {:.1} % and bone {dense:.1} % of the voxels)",
        levels.air,
        levels.soft_tissue,
        tissue - dense
    );
    let action = "Check the surfaces, or send skin_hu and bone_hu in the volume's units, or a rescale to HU.";
    Warning::check("levels-from-histogram", message).act(action)
}

/// The volume in HU, rounded to whole HU.
fn scaled(volume: &Volume, levels: &Levels) -> Volume {
    let hu =
        |value: &i16| levels.to_hu(f64::from(*value)).round().clamp(f64::from(i16::MIN), f64::from(i16::MAX)) as i16;
    Volume { dims: volume.dims, origin: volume.origin, axes: volume.axes, hu: volume.hu.iter().map(hu).collect() }
}

/// Sets the voxels of `given` with the value `padding` that reach the border through others of it to air, and returns their number.
fn fill_with_air(hu: &mut Volume, given: &Volume, padding: i16) -> usize {
    let mask: Vec<bool> = given.hu.iter().map(|value| *value == padding).collect();
    let components = Components::of(&mask, given.dims);
    let outside = components.mask(|c| components.at_border[c]);
    for (value, _) in hu.hu.iter_mut().zip(&outside).filter(|(_, outside)| **outside) {
        *value = AIR_HU as i16;
    }
    outside.iter().filter(|outside| **outside).count()
}
