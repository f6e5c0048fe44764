//! Extracts skin, skull and inner air from a head CT.

mod bone_and_air;
mod components;
mod depth;
mod distance;
mod head;
mod metal;
mod resample;
mod soft_tissue;
#[cfg(test)]
mod test_masks;
mod tuning;

use super::SurfaceError;
use depth::Depth;
use head::Head;
use metal::Metal;
use prosopon_geometry::control::{Cancelled, Control};
use prosopon_geometry::{
    ScalarGrid, TriMesh, Volume, Warning, decimate_with, drop_small_parts, isosurface, largest_part, smooth,
};
use tuning::{INNER_ITERATIONS, MIN_BONE_MM, MIN_TRIANGLES, SKIN_ITERATIONS};

/// Thresholds and tolerance of [`from_ct`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CtSettings {
    /// Skin threshold, HU, within [`SKIN_LEVELS_HU`].
    pub skin_hu: f64,
    /// Bone threshold, HU, within [`BONE_LEVELS_HU`].
    pub bone_hu: f64,
    /// Largest geometric error of the simplification, mm, 0 to 5.
    pub max_error_mm: f64,
}

impl Default for CtSettings {
    fn default() -> Self {
        Self { skin_hu: -300.0, bone_hu: 300.0, max_error_mm: 0.1 }
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

/// Smallest and largest skin threshold allowed, HU.
pub const SKIN_LEVELS_HU: [f64; 2] = [-900.0, 0.0];
/// Smallest and largest bone threshold allowed, HU.
pub const BONE_LEVELS_HU: [f64; 2] = [100.0, 1500.0];
/// Smallest and largest error of the simplification allowed, mm.
const MAX_ERRORS_MM: [f64; 2] = [0.0, 5.0];

/// Extracts skin, skull and inner air from a head CT, each as a closed two-manifold.
///
/// The volume may have any orientation and spacing. It is sampled on a lattice along L, P, S with its in-plane spacing, at least
/// 0.8 and at most 1.5 mm (more for very large volumes).
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
    check_settings(settings)?;
    let Fields { skin, bone, air, soft_tissue, mut warnings } = fields(volume, settings, control)?;
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
    let nothing = |what, threshold_hu, reason| SurfaceError::NothingFound { what, threshold_hu, reason };
    let skin = skin?.ok_or(nothing("skin", settings.skin_hu, "nothing in the volume crosses this level"))?;
    let no_bone = "nothing inside the skin is as dense over more than a few millimetres";
    let skull = skull?.ok_or(nothing("bone", settings.bone_hu, no_bone))?;
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

fn fields(volume: &Volume, settings: &CtSettings, control: &Control) -> Result<Fields, SurfaceError> {
    let resampled = resample::resample(volume, settings.skin_hu, &control.stage(0.0, 0.1))?;
    let (hu, mut warnings) = (resampled.grid, resampled.warnings);
    let Head { skin, removed_mm3 } =
        head::head(&hu, settings.skin_hu, &control.stage(0.1, 0.2))?.map_err(|reason| SurfaceError::NothingFound {
            what: "head",
            threshold_hu: settings.skin_hu,
            reason: reason.text(),
        })?;
    if removed_mm3 > 0.0 {
        let cm3 = removed_mm3 / 1e3;
        let message = format!("{cm3:.1} cm³ beside the head or in sheets were left out (head rest, mask, streaks)");
        warnings.push(Warning::info("removed-beside-head", message));
    }
    let depth = Depth::below(&skin);
    control.check()?;
    let metal = Metal::find(&hu, volume, &depth);
    let bone = bone_and_air::bone(&hu, &depth, metal.as_ref(), settings.bone_hu);
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
    let air = bone_and_air::air(&hu, &depth, metal.as_ref(), settings.skin_hu);
    let soft_tissue = soft_tissue::soft_tissue(&hu);
    Ok(Fields { skin, bone: bone.field, air, soft_tissue, warnings })
}

fn check_settings(settings: &CtSettings) -> Result<(), SurfaceError> {
    let CtSettings { skin_hu, bone_hu, max_error_mm } = *settings;
    let checks = [
        ("skin_hu", skin_hu, SKIN_LEVELS_HU),
        ("bone_hu", bone_hu, BONE_LEVELS_HU),
        ("max_error_mm", max_error_mm, MAX_ERRORS_MM),
    ];
    match checks.into_iter().find(|(_, value, [min, max])| !(*min..=*max).contains(value)) {
        Some((name, value, [min, max])) => Err(SurfaceError::Setting { name, value, min, max }),
        None => Ok(()),
    }
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
        for hu in [-1000, i16::MIN, 40, i16::MAX] {
            let error = run(&filled(hu)).unwrap_err().to_string();
            let expected = if hu < 0 { "no body" } else { "no air around" };
            assert!(error.starts_with("no head found at -300 HU: ") && error.contains(expected), "{hu} HU: {error}");
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
        for (settings, message) in [
            (CtSettings { skin_hu: f64::NAN, ..CtSettings::default() }, "`skin_hu` is NaN, allowed is -900 to 0"),
            (CtSettings { bone_hu: -5.0, ..CtSettings::default() }, "`bone_hu` is -5, allowed is 100 to 1500"),
            (CtSettings { max_error_mm: -1.0, ..CtSettings::default() }, "`max_error_mm` is -1, allowed is 0 to 5"),
        ] {
            let error = from_ct(&ball(), &settings, &Control::new()).unwrap_err();
            assert_eq!(error.to_string(), format!("the setting {message}"));
        }
    }
}
