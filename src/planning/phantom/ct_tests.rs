//! Compares surfaces extracted from a CT of the phantom with the solids it was sampled from.

use super::head;
use crate::surface::{CtSettings, from_ct};
use prosopon_geometry::control::Control;
use prosopon_geometry::{Implicit, Point, TopologyFaults, TriMesh, Vector, Volume, parts};

/// Pixel size of the stacks, mm; also the width over which `Phantom::ct` mixes values.
const PIXEL: f64 = 1.7;
const STEP: f64 = 2.4;

/// A stack of slices of the lower head, turned by angles about x and z; the crown and the neck are cut off.
fn stack(about_x: f64, about_z: f64) -> Volume {
    let phantom = head();
    let turn = nalgebra::Rotation3::from_euler_angles(about_x, 0.0, about_z);
    let axes = [turn * Vector::x() * PIXEL, turn * Vector::y() * PIXEL, turn * Vector::z() * STEP];
    let dims = [108, 140, 60];
    let middle = axes[0] * 53.5 + axes[1] * 69.5 + axes[2] * 29.5;
    let origin = Point::new(0.0, -8.0, 14.0) - middle;
    let mut hu = Vec::with_capacity(dims.iter().product());
    for k in 0..dims[2] {
        for j in 0..dims[1] {
            for i in 0..dims[0] {
                let p = origin + axes[0] * i as f64 + axes[1] * j as f64 + axes[2] * k as f64;
                hu.push(phantom.hounsfield(&p, PIXEL) as i16);
            }
        }
    }
    Volume { dims, origin, axes, hu }
}

/// Signed distances from the solid, sorted, of the vertices at least 6 mm inside the stack.
fn distances(mesh: &TriMesh, solid: &dyn Implicit, volume: &Volume) -> Vec<f64> {
    let inside = |p: &&Point| {
        (0..3).all(|a| {
            let unit = volume.axes[a].normalize();
            let along = (**p - volume.origin).dot(&unit);
            (6.0..=(volume.dims[a] - 1) as f64 * volume.axes[a].norm() - 6.0).contains(&along)
        })
    };
    let distance = |p: &Point| {
        let (value, gradient) = solid.value_gradient(p);
        value / gradient.norm()
    };
    let mut found: Vec<f64> = mesh.positions().iter().filter(inside).map(distance).collect();
    found.sort_by(f64::total_cmp);
    found
}

#[test]
fn surfaces_of_a_tilted_stack_lie_where_the_solids_are() {
    let phantom = head();
    let volume = stack(0.25, 0.1);
    let found = from_ct(&volume, &CtSettings::default(), &Control::new()).unwrap();
    let air = found.air.unwrap();
    assert_eq!(parts(&found.skin).len(), 1);
    assert_eq!(parts(&found.skull).len(), 3, "upper skull, mandible and hyoid");
    // Where half a voxel mixes the values a and b linearly, the level lies (0.5 - (level - a) / (b - a)) voxels outside.
    let expected = |outside: f64, inside: f64, level: f64| (0.5 - (level - outside) / (inside - outside)) * PIXEL;
    let cases = [
        ("skin", &found.skin, &phantom.skin, expected(-1000.0, 40.0, -300.0)),
        ("skull", &found.skull, &phantom.skull, expected(40.0, 1200.0, 300.0)),
        ("air", &air, &phantom.air, expected(40.0, -1000.0, -300.0)),
    ];
    for (name, mesh, solid, expected) in cases {
        assert!(TopologyFaults::of(mesh).is_closed_manifold(), "{name}");
        let d = distances(mesh, solid.as_ref(), &volume);
        let [low, median, high] = [0.02, 0.5, 0.98].map(|q| d[((d.len() - 1) as f64 * q) as usize] - expected);
        // Slices 2.4 mm apart smooth thin bone and narrow air by up to half a pixel.
        assert!(median.abs() < 0.25, "{name}: {median} mm");
        assert!(low > -0.85 && high < 0.85, "{name}: {low} to {high} mm");
    }
    assert!(found.skull.positions().iter().all(|p| phantom.skin.value(p) < -2.0));
}
