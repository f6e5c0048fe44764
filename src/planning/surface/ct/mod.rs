//! Extracts skin, skull and inner air from a head CT.

mod bone_and_air;
mod components;
mod cuts;
mod depth;
mod distance;
mod head;
mod histogram;
mod levels;
mod metal;
mod noise;
mod resample;
mod soft_tissue;
#[cfg(test)]
mod test_masks;
mod tuning;
mod units;

pub use levels::Levels;
pub use units::levels_of;

use super::SurfaceError;
use cuts::{Cuts, View};
use depth::Depth;
use head::{Head, NoHead};
use metal::Metal;
use prosopon_geometry::control::{Cancelled, Control};
use prosopon_geometry::{
    ScalarGrid, TriMesh, Volume, Warning, decimate_with, drop_small_parts, isosurface, largest_part, smooth,
};
use tuning::{INNER_ITERATIONS, MIN_BONE_MM, MIN_TRIANGLES, SKIN_ITERATIONS};
use units::InHu;

/// Thresholds and tolerance of [`from_ct`].
///
/// The thresholds are in the units of the volume and must lie within its values, the one of skin below that of bone.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CtSettings {
    /// Skin threshold; -300 HU, or what corresponds to it in a volume of other units, when `None`.
    pub skin_hu: Option<f64>,
    /// Bone threshold; 300 HU, or what corresponds to it in a volume of other units, when `None`.
    pub bone_hu: Option<f64>,
    /// Largest geometric error of the simplification, mm, 0 to 5.
    pub max_error_mm: f64,
}

impl Default for CtSettings {
    fn default() -> Self {
        Self { skin_hu: None, bone_hu: None, max_error_mm: 0.1 }
    }
}

/// Surfaces of one head, LPS mm.
#[derive(Debug, Clone, PartialEq)]
pub struct CtSurfaces {
    /// Outer skin: closed, one part; nostrils and ear canals are plugged.
    pub skin: TriMesh,
    /// Bone with teeth: closed, may have many parts and cavities. It is as clean as the CT allows.
    pub skull: TriMesh,
    /// Air inside the head (mouth, nose, sinuses), closed; `None` when there is none.
    pub air: Option<TriMesh>,
    /// Local mean of soft tissue on a lattice of about 2 mm, HU; NaN where there is hardly any soft tissue.
    pub soft_tissue: ScalarGrid,
    /// What was removed, repaired or is doubtful.
    pub warnings: Vec<Warning>,
}

/// Smallest and largest error of the simplification allowed, mm.
const MAX_ERRORS_MM: [f64; 2] = [0.0, 5.0];

/// Extracts skin, skull and inner air from a head CT, each as a closed two-manifold.
///
/// The volume may have any orientation and spacing. It is sampled on a lattice along L, P, S with its in-plane spacing, at least
/// 0.8 and at most 1.5 mm (more for very large volumes).
/// - Units: values other than HU (cone-beam CT) are converted linearly, so that the peaks of air and soft tissue in the histogram
///   become -1000 and 40 HU. All lengths and levels below, and the mean of soft tissue, refer to these HU.
/// - Noise: above 70 HU in soft tissue, neighbours on the lattice are averaged.
/// - Skin: the largest body above `skin_hu` after an opening that removes sheets, mask strands and streaks. All air that a ball
///   of 5 mm radius cannot reach from outside belongs to the inside.
/// - Skull: above `bone_hu`, at least 2 mm below the skin and the volume's border, without pieces under 12 mm. In slices with
///   metal the least depth is 4 mm, and structures shorter than 8 mm along S are taken for streaks.
/// - Soft tissue: values between those of air and bone, averaged locally.
/// - Air: below `skin_hu`, at least 1.5 mm inside the skin, in spaces of at least 200 mm³; streaks are treated as for bone.
///
/// # Errors
/// [`SurfaceError`] when the volume or a setting is not usable, when there is no skin or no bone, or on cancellation.
///
/// # Accuracy
/// Skin: within about a third of a voxel where the CT is free of artefacts, plus `max_error_mm`.
///
/// # Examples
///
/// A ball of soft tissue (radius 30 mm) around a ball of bone (radius 15 mm), in voxels of 2 mm.
/// ```
/// use prosopon_geometry::control::Control;
/// use prosopon_geometry::{Point, TopologyFaults, Vector, Volume};
/// use prosopon_planning::surface::{CtSettings, from_ct};
///
/// let dims = [41, 41, 41];
/// let axes = [Vector::x() * 2.0, Vector::y() * 2.0, Vector::z() * 2.0];
/// let mut hu = Vec::new();
/// for at in 0..41 * 41 * 41 {
///     let steps = [at % 41, at / 41 % 41, at / 41 / 41].map(|i| 2.0 * (f64::from(i) - 20.0));
///     let radius = Vector::from(steps).norm();
///     // Partial volume: a voxel on the boundary mixes both values.
///     let share = |boundary: f64| (0.5 + (boundary - radius) / 2.0).clamp(0.0, 1.0);
///     hu.push((-1000.0 + 1040.0 * share(30.0) + 1160.0 * share(15.0)) as i16);
/// }
/// let volume = Volume { dims, origin: Point::new(-40.0, -40.0, -40.0), axes, hu };
/// let found = from_ct(&volume, &CtSettings::default(), &Control::new())?;
/// assert!(TopologyFaults::of(&found.skin).is_closed_manifold());
/// // The default levels of -300 and 300 HU lie 0.35 mm inside the skin and 0.55 mm outside the bone.
/// assert!((found.skin.volume() / 109_000.0 - 1.0).abs() < 0.05);
/// assert!((found.skull.volume() / 15_700.0 - 1.0).abs() < 0.1);
/// assert!(found.air.is_none());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn from_ct(volume: &Volume, settings: &CtSettings, control: &Control) -> Result<CtSurfaces, SurfaceError> {
    resample::check(volume)?;
    check_tolerance(settings)?;
    let InHu { volume: in_hu, skin_hu, bone_hu, filling, mut warnings } = units::in_hu(volume, settings)?;
    let thresholds = Thresholds { skin_hu, bone_hu };
    let Fields { skin, bone, air, soft_tissue, warnings: found } =
        fields(&in_hu, volume, filling, thresholds, control)?;
    drop(in_hu);
    warnings.extend(found);
    control.report(0.3);
    let finish = |field: &ScalarGrid, structure: Structure, progress: &(dyn Fn(f64) + Sync)| {
        finished(field, structure, settings.max_error_mm, control, progress)
    };
    // Only bone reports progress, because it takes longest.
    let (skin, (skull, air)) = rayon::join(
        || finish(&skin, Structure::Skin, &|_| {}),
        || {
            let skull = finish(&bone, Structure::Bone, &|share| control.report(0.3 + 0.6 * share));
            (skull, air.map(|field| finish(&field, Structure::Air, &|share| control.report(0.9 + 0.1 * share))))
        },
    );
    let skin = skin?.ok_or_else(|| nothing("skin", skin_hu, "nothing in the volume crosses this level"))?;
    let no_bone = "nothing inside the skin is as dense over more than a few millimetres";
    let skull = skull?.ok_or_else(|| nothing("bone", bone_hu, no_bone))?;
    if skin.left_out > 0 {
        let message = format!("{} separate parts of the skin surface were left out", skin.left_out);
        warnings.push(Warning::info("skin-parts-dropped", message));
    }
    if skull.left_out > 0 {
        let message =
            format!("{} pieces and cavities of bone smaller than {MIN_BONE_MM} mm were left out", skull.left_out);
        warnings.push(Warning::info("bone-pieces-dropped", message));
    }
    let air = air.transpose()?.flatten().map(|found| found.mesh);
    control.report(1.0);
    Ok(CtSurfaces { skin: skin.mesh, skull: skull.mesh, air, soft_tissue, warnings })
}

/// Fields whose zero levels are the surfaces, negative inside, and the local mean of soft tissue.
struct Fields {
    skin: ScalarGrid,
    bone: ScalarGrid,
    air: Option<ScalarGrid>,
    soft_tissue: ScalarGrid,
    warnings: Vec<Warning>,
}

/// Thresholds in HU.
#[derive(Clone, Copy)]
struct Thresholds {
    skin_hu: f64,
    bone_hu: f64,
}

fn nothing(what: &'static str, threshold_hu: f64, reason: impl Into<String>) -> SurfaceError {
    SurfaceError::NothingFound { what, threshold_hu, reason: reason.into() }
}

/// Fields of `volume`, which is in HU. `given` is the same volume in its own units; `filling` is the value of its corners.
fn fields(
    volume: &Volume,
    given: &Volume,
    filling: Option<i16>,
    Thresholds { skin_hu, bone_hu }: Thresholds,
    control: &Control,
) -> Result<Fields, SurfaceError> {
    let resampled = resample::resample(volume, skin_hu, &control.stage(0.0, 0.1))?;
    let (mut hu, is_open, mut warnings) = (resampled.grid, resampled.is_open, resampled.warnings);
    warnings.extend(noise::reduce(&mut hu));
    let Head { skin, removed_mm3 } = head::head(&hu, is_open, skin_hu, &control.stage(0.1, 0.2))?
        .map_err(|reason| nothing("head", skin_hu, no_head(reason, volume, skin_hu)))?;
    let cuts = Cuts::of(&View { volume, given, filling, skin_hu, bone_hu, skin: &skin });
    if cuts.are_everywhere() {
        let reason = "the field of view cuts the head on all sides, so that the skin is not in it. Use a volume that shows the whole \
                      face with air in front of it";
        return Err(nothing("skin", skin_hu, reason));
    }
    warnings.extend(cuts.warnings());
    if removed_mm3 > 0.0 {
        let cm3 = removed_mm3 / 1e3;
        let message = format!("{cm3:.1} cm³ beside the head or in sheets were left out (head rest, mask, streaks)");
        warnings.push(Warning::info("removed-beside-head", message));
    }
    let depth = Depth::below(&skin);
    control.check()?;
    let metal = Metal::find(&hu, volume, &depth);
    let bone = bone_and_air::bone(&hu, &depth, metal.as_ref(), bone_hu);
    if metal.is_some() {
        let message = "bone, air and skin are inexact in the slices with metal, and flat pieces there were left out";
        warnings.push(Warning::check("metal", message).act("Check the surfaces in these slices."));
    }
    if bone.cut_mm3 > 0.0 {
        let cm3 = bone.cut_mm3 / 1e3;
        let message = format!("{cm3:.2} cm³ as dense as bone were left out: too near the skin, or streaks of metal");
        warnings.push(Warning::info("dense-left-out", message));
    }
    control.check()?;
    let air = bone_and_air::air(&hu, &depth, metal.as_ref(), skin_hu);
    let soft_tissue = soft_tissue::soft_tissue(&hu);
    Ok(Fields { skin, bone: bone.field, air, soft_tissue, warnings })
}

/// Why a volume shows no head.
fn no_head(reason: NoHead, volume: &Volume, skin_hu: f64) -> String {
    match reason {
        NoHead::NoBody => "there is no body denser than this and thicker than a sheet".to_owned(),
        NoHead::NoAirAround => cuts::why_no_air(volume, skin_hu),
        NoHead::OnlyBumps => "everything denser than this is thin; check that the volume shows a head".to_owned(),
    }
}

fn check_tolerance(settings: &CtSettings) -> Result<(), SurfaceError> {
    let (value, [min, max]) = (settings.max_error_mm, MAX_ERRORS_MM);
    if (min..=max).contains(&value) {
        return Ok(());
    }
    Err(SurfaceError::Setting { name: "max_error_mm", value, min, max })
}

#[derive(Clone, Copy)]
enum Structure {
    Skin,
    Bone,
    Air,
}

/// A surface and the number of pieces left out of it.
struct Finished {
    mesh: TriMesh,
    left_out: usize,
}

/// Extracts, cleans, smooths and simplifies the surface of a field.
fn finished(
    field: &ScalarGrid,
    structure: Structure,
    max_error_mm: f64,
    control: &Control,
    progress: impl Fn(f64) + Sync,
) -> Result<Option<Finished>, Cancelled> {
    let Some(raw) = isosurface(field, 0.0) else { return Ok(None) };
    control.check()?;
    let (iterations, (cleaned, left_out)) = match structure {
        Structure::Skin => (SKIN_ITERATIONS, largest_part(&raw)),
        Structure::Bone => (INNER_ITERATIONS, drop_small_parts(&raw, MIN_BONE_MM)),
        Structure::Air => (INNER_ITERATIONS, (raw, 0)),
    };
    let smoothed = smooth(&cleaned, iterations);
    drop(cleaned);
    let (mesh, _) = decimate_with(&smoothed, max_error_mm, MIN_TRIANGLES, control, progress)?;
    Ok(Some(Finished { mesh, left_out }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use prosopon_geometry::{Point, Severity, TopologyFaults, Vector};

    /// Soft tissue of radius 30 with a shell of bone (16 to 20), an airspace (radius 8) that a tube of radius 4 joins to the
    /// outside, a throat that leaves the volume below, and a sheet beside the ball. Slices are 2 mm apart.
    fn ball() -> Volume {
        let dims = [76, 80, 34];
        let axes = [Vector::x(), Vector::y(), Vector::z() * 2.0];
        let origin = Point::new(-38.0, -38.0, -22.0);
        // Partial volume over the thickness of a slice.
        let share = |d: f64| (0.5 - d / 2.0).clamp(0.0, 1.0);
        let mut hu = Vec::new();
        for at in 0..dims.iter().product::<usize>() {
            let step = [at % 76, at / 76 % 80, at / 76 / 80].map(|c| c as f64);
            let p = (origin + axes[0] * step[0] + axes[1] * step[1] + axes[2] * step[2]).coords;
            let r = p.norm();
            let tube = if p.y < 0.0 { p.x.hypot(p.z) - 4.0 } else { f64::MAX };
            let throat = if p.z < 0.0 { p.x.hypot(p.y - 6.0) - 7.0 } else { f64::MAX };
            let air = (r - 8.0).min(tube).min(throat);
            let sheet = if (37.0..39.0).contains(&p.y) { 0.0 } else { 1.0 };
            let mut value = -1000.0 + 1040.0 * share(r - 30.0).max(1.0 - sheet);
            value += (1200.0 - value) * share((r - 18.0).abs() - 2.0);
            value += (-1000.0 - value) * share(air);
            hu.push(value as i16);
        }
        Volume { dims, origin, axes, hu }
    }

    fn run(volume: &Volume) -> Result<CtSurfaces, SurfaceError> {
        from_ct(volume, &CtSettings::default(), &Control::new())
    }

    #[test]
    fn a_ball_gives_skin_with_plugs_bone_and_air() {
        let found = run(&ball()).unwrap();
        let air = found.air.unwrap();
        for mesh in [&found.skin, &found.skull, &air] {
            assert!(TopologyFaults::of(mesh).is_closed_manifold());
            assert!(mesh.volume() > 0.0);
        }
        // The skin bridges the mouths of tube and throat and excludes the sheet. -300 HU lies 0.35 mm below the surface of the
        // ball, and the cut at z = -22 is capped.
        let radius = |p: &Point| p.coords.norm();
        assert!(found.skin.positions().iter().all(|p| radius(p) < 30.2));
        let free = found.skin.positions().iter().filter(|p| p.z > -17.0 && (p.y > 0.0 || p.x.hypot(p.z) > 8.0));
        assert!(
            free.clone().count() > 200 && free.clone().all(|p| radius(p) > 29.2),
            "{:?}",
            free.min_by(|a, b| radius(a).total_cmp(&radius(b)))
        );
        assert!(found.skin.positions().iter().all(|p| radius(p) > 21.9));
        // Bone ends 2 mm before the cap. 300 HU lies 0.55 mm outside the shell, with an uncertainty from the slice spacing.
        assert!(found.skull.positions().iter().all(|p| p.z > -20.1 && radius(p) < 21.3 && radius(p) > 14.7));
        assert!(air.positions().iter().all(|p| p.z > -20.6 && radius(p) < 29.0));
        let codes: Vec<&str> = found.warnings.iter().map(|w| w.code).collect();
        assert!(codes.contains(&"airways-closed") && codes.contains(&"removed-beside-head"), "{:?}", found.warnings);
        assert!(found.warnings.iter().all(|w| w.severity == Severity::Info), "{:?}", found.warnings);
    }

    #[test]
    fn a_crown_near_the_last_slice_carries_no_stub() {
        // The volume ends 2 mm above the ball, inside a shell of 2 mm with a gap of 5 mm to the ball. The last slice cuts a
        // ring of the shell, and the air within the ring is no airway.
        let mut volume = ball();
        volume.dims[2] = 28;
        volume.hu.truncate(76 * 80 * 28);
        for at in 0..volume.hu.len() {
            let step = [at % 76, at / 76 % 80, at / 76 / 80].map(|c| c as f64);
            let p = volume.origin + volume.axes[0] * step[0] + volume.axes[1] * step[1] + volume.axes[2] * step[2];
            if p.z > 25.0 && (35.0..37.0).contains(&p.coords.norm()) {
                volume.hu[at] = 0;
            }
        }
        // Without the shell the only difficulty is the little air above the crown.
        let mut bare = ball();
        (bare.dims[2], bare.hu) = (28, bare.hu[..76 * 80 * 28].to_vec());
        let ring = volume.hu[27 * 76 * 80..].iter().filter(|v| **v == 0).count();
        assert!(ring > 300, "the last slice cuts the shell at {ring} voxels");
        for volume in [bare, volume] {
            let found = run(&volume).unwrap();
            let highest = found.skin.positions().iter().map(|p| p.z).fold(f64::MIN, f64::max);
            assert!((29.0..30.7).contains(&highest), "{highest}");
            assert!(
                found.warnings.iter().any(|w| w.code == "airways-closed" && w.message.starts_with("1 airways")),
                "{:?}",
                found.warnings
            );
        }
    }

    #[test]
    fn progress_ends_at_one_and_cancelling_stops() {
        let control = Control::new();
        from_ct(&ball(), &CtSettings::default(), &control).unwrap();
        assert!((control.progress() - 1.0).abs() < 1e-12);
        control.cancel();
        let stopped = from_ct(&ball(), &CtSettings::default(), &control);
        assert!(matches!(stopped, Err(SurfaceError::Cancelled(_))));
    }

    #[test]
    fn volumes_without_a_head_are_refused() {
        let filled = |hu: i16| Volume { hu: vec![hu; 76 * 80 * 34], ..ball() };
        let no_head = "no head found at -300 HU: there is no";
        let no_levels =
            "the volume is not usable: its values are not Hounsfield units, and air and soft tissue are not found in";
        for (value, start, end) in [
            (-1000, no_head, "body denser than this and thicker than a sheet"),
            (40, no_head, "Use a volume that shows the whole face with air in front of it"),
            (i16::MIN, no_levels, "or a rescale to HU"),
            (i16::MAX, no_levels, "or a rescale to HU"),
        ] {
            let error = run(&filled(value)).unwrap_err().to_string();
            assert!(error.starts_with(start) && error.ends_with(end), "{value}: {error}");
        }
        let no_bone = Volume { hu: ball().hu.iter().map(|v| (*v).min(60)).collect(), ..ball() };
        assert!(matches!(run(&no_bone), Err(SurfaceError::NothingFound { what: "bone", .. })));
    }

    #[test]
    fn unusable_volumes_and_settings_are_refused() {
        let refused = |v: Volume| matches!(run(&v), Err(SurfaceError::Volume { .. }));
        assert!(refused(Volume { hu: vec![0; 5], ..ball() }));
        assert!(refused(Volume { dims: [usize::MAX, 8, 8], ..ball() }));
        assert!(refused(Volume { dims: [1, 1, 1], hu: vec![0], ..ball() }));
        assert!(refused(Volume { axes: [Vector::x(), Vector::x() * 1.001, Vector::z()], ..ball() }));
        assert!(refused(Volume { axes: [Vector::x(), Vector::y(), Vector::z() * f64::NAN], ..ball() }));
        assert!(refused(Volume { origin: Point::new(f64::INFINITY, 0.0, 0.0), ..ball() }));
        let default = CtSettings::default();
        let range = "but the values of the volume are -1000 to 1200, air is -1000 and soft tissue 40";
        for (settings, message) in [
            (
                CtSettings { skin_hu: Some(f64::NAN), ..default },
                format!("`skin_hu` is NaN, {range}: it must lie within them"),
            ),
            (
                CtSettings { bone_hu: Some(1300.0), ..default },
                format!("`bone_hu` is 1300, {range}: it must lie within them"),
            ),
            (
                CtSettings { skin_hu: Some(400.0), ..default },
                format!("`skin_hu` is 400, {range}: it must be below the level of bone"),
            ),
            (CtSettings { max_error_mm: -1.0, ..default }, "`max_error_mm` is -1, allowed is 0 to 5".to_owned()),
        ] {
            let error = from_ct(&ball(), &settings, &Control::new()).unwrap_err();
            assert_eq!(error.to_string(), format!("the setting {message}"));
        }
    }
}
