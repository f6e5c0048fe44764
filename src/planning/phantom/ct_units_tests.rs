//! Compares surfaces extracted from cone-beam-like CTs of the phantom with those extracted from the CT in HU.

use super::head;
use crate::surface::{CtSettings, CtSurfaces, SurfaceError, from_ct, levels_of};
use prosopon_field::ExactDistance;
use prosopon_geometry::control::Control;
use prosopon_geometry::{Point, Severity, TopologyFaults, TriMesh, Volume};

const SPACING: f64 = 2.5;
const UNITS: &str = "levels-from-histogram";

fn run(volume: &Volume, settings: &CtSettings) -> Result<CtSurfaces, SurfaceError> {
    from_ct(volume, settings, &Control::new())
}

/// The volume with each value replaced by that of a function of the value, in HU, and the position.
fn changed(volume: &Volume, mut value: impl FnMut(f64, &Point) -> f64) -> Volume {
    let [nx, ny, _] = volume.dims;
    let one = |(at, old): (usize, &i16)| {
        let [i, j, k] = [at % nx, at / nx % ny, at / nx / ny].map(|c| c as f64);
        let p = volume.origin + volume.axes[0] * i + volume.axes[1] * j + volume.axes[2] * k;
        value(f64::from(*old), &p).round() as i16
    };
    Volume { hu: volume.hu.iter().enumerate().map(one).collect(), ..volume.clone() }
}

/// Grey values of 12 bits: air is 50, and 2050 is 3000 HU.
fn grey(volume: &Volume) -> Volume {
    changed(volume, |hu, _| 50.0 + 0.5 * (hu + 1000.0))
}

/// Adds noise with a standard deviation, HU, of about normal distribution.
fn noisy(volume: &Volume, deviation: f64) -> Volume {
    let mut state = 1_u64;
    let mut uniform = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f64 / f64::from(1 << 24) - 0.5
    };
    // The sum of four even distributions has a variance of 4/12.
    changed(volume, |hu, _| hu + deviation * 3f64.sqrt() * (uniform() + uniform() + uniform() + uniform()))
}

/// Distance that 95 % of the vertices of `mesh` at `counted` positions keep from `reference`, mm.
fn p95(mesh: &TriMesh, reference: &TriMesh, counted: impl Fn(&Point) -> bool) -> f64 {
    let exact = ExactDistance::new(reference);
    let mut found: Vec<f64> =
        mesh.positions().iter().filter(|p| counted(p)).map(|p| exact.closest(p).2.abs()).collect();
    found.sort_by(f64::total_cmp);
    found[(0.95 * (found.len() - 1) as f64) as usize]
}

/// Radius around the z axis, moved forward.
fn radius(p: &Point) -> f64 {
    p.x.hypot(p.y + 40.0)
}

fn always(_: &Point) -> bool {
    true
}

/// A changed volume, where its surfaces are compared, the tolerance of both as a share of a voxel, and the codes of severity `check`.
struct Case {
    name: &'static str,
    volume: Volume,
    counted: fn(&Point) -> bool,
    tolerance: f64,
    codes: &'static [&'static str],
}

#[test]
fn surfaces_of_other_units_and_of_cut_or_noisy_volumes_are_those_of_hu() {
    let hu = head().ct(SPACING);
    let clean = run(&hu, &CtSettings::default()).unwrap();
    assert!(clean.warnings.iter().all(|w| w.severity == Severity::Info), "{:?}", clean.warnings);
    let circle = |volume: &Volume, value: f64| changed(volume, |v, p| if radius(p) > 70.0 { value } else { v });
    let in_circle = |p: &Point| radius(p) < 64.0;
    let cases = [
        // The peak of soft tissue is read a few HU off where fat lies beside it (0.03 voxels at the skin). Values are rounded to 2 HU,
        // with 8 bits to 16 HU, of a step of 1040 HU in a voxel.
        Case { name: "grey", volume: grey(&hu), counted: always, tolerance: 0.1, codes: &[UNITS] },
        Case {
            name: "8 bits",
            volume: changed(&hu, |v, _| (v + 1000.0) / 16.0),
            counted: always,
            tolerance: 0.1,
            codes: &[UNITS],
        },
        // The mean over neighbours moves the level by up to a third of a voxel in curved and thin parts.
        Case { name: "noise", volume: grey(&noisy(&hu, 120.0)), counted: always, tolerance: 0.5, codes: &[UNITS] },
        Case {
            name: "circle",
            volume: circle(&grey(&hu), 0.0),
            counted: in_circle,
            tolerance: 0.1,
            codes: &[UNITS, "head-cut"],
        },
        Case {
            name: "circle of dense padding",
            volume: circle(&hu, 0.0),
            counted: in_circle,
            tolerance: 0.1,
            codes: &["head-cut"],
        },
    ];
    for Case { name, volume, counted, tolerance, codes } in cases {
        let found = run(&volume, &CtSettings::default()).unwrap();
        for (what, mesh, reference) in [("skin", &found.skin, &clean.skin), ("skull", &found.skull, &clean.skull)] {
            assert!(TopologyFaults::of(mesh).is_closed_manifold(), "{name}: {what}");
            let distance = p95(mesh, reference, counted);
            assert!(distance < tolerance * SPACING, "{name}: {what} {distance} mm");
        }
        let given: Vec<&str> = found.warnings.iter().filter(|w| w.severity != Severity::Info).map(|w| w.code).collect();
        assert_eq!(given, codes, "{name}: {:?}", found.warnings);
    }
}

#[test]
fn metal_fat_and_muscle_are_found_in_grey_values() {
    let metal = Point::new(20.0, -60.0, 10.0);
    let hu = changed(&head().ct(SPACING), |v, p| if (p - metal).norm() < 4.0 { 3000.0 } else { v });
    let [a, b] = [&hu, &grey(&hu)].map(|volume| run(volume, &CtSettings::default()).unwrap());
    for found in [&a, &b] {
        assert!(found.warnings.iter().any(|w| w.code == "metal"), "{:?}", found.warnings);
    }
    let known = a.soft_tissue.values.iter().zip(&b.soft_tissue.values).filter(|(a, _)| a.is_finite());
    let far = known.clone().filter(|(a, b)| (*a - *b).abs() > 15.0 || b.is_nan()).count();
    // Fat and muscle are 130 HU apart; the peak of soft tissue need not lie at 40 HU exactly.
    assert!(far * 100 < known.count(), "{far}");
}

#[test]
fn given_levels_are_in_the_units_of_the_volume() {
    let hu = head().ct(SPACING);
    let found = levels_of(&grey(&hu)).unwrap();
    assert!((found.air - 50.0).abs() < 5.0 && (found.soft_tissue - 570.0).abs() < 15.0, "{found:?}");
    let given =
        CtSettings { skin_hu: Some(found.at_hu(-300.0)), bone_hu: Some(found.at_hu(300.0)), ..CtSettings::default() };
    assert_eq!(run(&grey(&hu), &given).unwrap().skin, run(&grey(&hu), &CtSettings::default()).unwrap().skin);
    let error = run(&grey(&hu), &CtSettings { skin_hu: Some(-300.0), ..given }).unwrap_err().to_string();
    assert!(
        error.starts_with("the setting `skin_hu` is -300, but the values of the volume are 50 to 1150, air is 50"),
        "{error}"
    );
}

#[test]
fn a_view_inside_the_head_is_refused_with_this_reason() {
    let hu = head().ct(SPACING);
    let radius = |p: &Point| (p.x).hypot(p.y);
    let inside = changed(&hu, |v, p| if radius(p) > 45.0 || p.z.abs() > 25.0 { -1000.0 } else { v.max(40.0) });
    for volume in [grey(&inside), inside] {
        let error = run(&volume, &CtSettings::default()).unwrap_err().to_string();
        assert!(error.contains("the field of view cuts the head on all sides"), "{error}");
    }
}
