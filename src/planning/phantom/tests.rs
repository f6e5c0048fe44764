//! Tests the phantom against finite differences, its own symmetry and anatomical distances.

use super::{Phantom, head, surface_of};
use prosopon_geometry::{Aabb, Implicit, Point, TopologyFaults, TriMesh, Vector};

/// Deterministic points in the box of the head.
fn points(n: u64) -> impl Iterator<Item = Point> {
    let unit = |x: u64| (x.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 11) as f64 / (1u64 << 53) as f64;
    let b = head().bounds();
    let e = b.max - b.min;
    (0..n).map(move |i| b.min + e.component_mul(&Vector::new(unit(3 * i + 1), unit(3 * i + 2), unit(3 * i + 3))))
}

fn solids(p: &Phantom) -> [(&'static str, &(dyn Implicit + Send)); 3] {
    [("skin", p.skin.as_ref()), ("skull", p.skull.as_ref()), ("air", p.air.as_ref())]
}

/// Samples the air finely, because the airway's gaps are about 2 mm wide.
fn air_surface(phantom: &Phantom) -> TriMesh {
    let bounds = Aabb { min: Point::new(-40.0, -100.0, -40.0), max: Point::new(40.0, 12.0, 70.0) };
    surface_of(phantom.air.as_ref(), &bounds, 1.0).unwrap()
}

#[test]
fn gradients_are_those_of_the_value() {
    let phantom = head();
    let h = 1e-5;
    for (name, solid) in solids(&phantom) {
        let mut near_a_kink = 0;
        for p in points(3000) {
            let (value, gradient) = solid.value_gradient(&p);
            assert_eq!(value, solid.value(&p), "{name} at {p}");
            let slope = |a: usize, s: f64| {
                let mut q = p;
                q[a] += s * h;
                s * (solid.value(&q) - value) / h
            };
            let (up, down) = ([0, 1, 2].map(|a| slope(a, 1.0)), [0, 1, 2].map(|a| slope(a, -1.0)));
            // One-sided slopes differ by curvature times h, about 1e-5, except across a plain minimum.
            if (0..3).any(|a| (up[a] - down[a]).abs() > 1e-3) {
                near_a_kink += 1;
                continue;
            }
            let central = Vector::from_fn(|a, _| 0.5 * (up[a] + down[a]));
            assert!((central - gradient).norm() < 1e-5, "{name} at {p}: {central} but {gradient}");
        }
        assert!(near_a_kink <= 3, "{name}: {near_a_kink} of 3000 points");
    }
}

#[test]
fn left_and_right_are_mirror_images() {
    let phantom = head();
    for (name, solid) in solids(&phantom) {
        for p in points(2000) {
            let mirrored = Point::new(-p.x, p.y, p.z);
            assert!((solid.value(&p) - solid.value(&mirrored)).abs() < 1e-12, "{name} at {p}");
        }
    }
}

#[test]
fn values_are_finite_everywhere_and_near_the_surface_distances() {
    let phantom = head();
    for (name, solid) in solids(&phantom) {
        for p in [Point::origin(), Point::new(0.0, 1.0, 92.0), Point::new(1e4, -1e4, 1e4)] {
            let (value, gradient) = solid.value_gradient(&p);
            assert!(value.is_finite() && gradient.iter().all(|g| g.is_finite()), "{name} at {p}");
        }
        let mesh = surface_of(solid, &phantom.bounds(), 4.0).unwrap();
        let slopes: Vec<f64> = mesh.positions().iter().map(|p| solid.value_gradient(p).1.norm()).collect();
        // Fillets between solids that meet at an angle flatten the value; elsewhere the slope is 1.
        let off = slopes.iter().filter(|s| !(0.7..1.3).contains(*s)).count();
        assert!(off * 20 < slopes.len(), "{name}: {off} of {} vertices", slopes.len());
        assert!(slopes.iter().all(|s| (0.2..2.0).contains(s)), "{name}");
    }
}

#[test]
fn surfaces_are_closed_manifolds_on_the_zero_set_and_inside_the_box() {
    let phantom = head();
    let inner = phantom.bounds().grown(-4.0);
    let expected_cm3 = [("skin", 3500.0..4200.0), ("skull", 600.0..950.0), ("air", 30.0..70.0)];
    for ((name, solid), (_, volumes)) in solids(&phantom).into_iter().zip(expected_cm3) {
        let mesh =
            if name == "air" { air_surface(&phantom) } else { surface_of(solid, &phantom.bounds(), 3.0).unwrap() };
        assert!(TopologyFaults::of(&mesh).is_closed_manifold(), "{name}");
        assert!(volumes.contains(&(mesh.volume() / 1e3)), "{name}: {} cm³", mesh.volume() / 1e3);
        assert!(inner.contains(&mesh.bounds().min) && inner.contains(&mesh.bounds().max), "{name}");
        let off = mesh.positions().iter().filter(|p| solid.value(p).abs() > 1e-6).count();
        assert!(off * 50 < mesh.positions().len(), "{name}: {off} vertices off the surface");
    }
}

#[test]
fn skull_and_air_lie_inside_the_skin_and_apart() {
    let phantom = head();
    let bone = surface_of(phantom.skull.as_ref(), &phantom.bounds(), 2.5).unwrap();
    assert!(bone.positions().iter().all(|p| phantom.skin.value(p) < -1.5));
    let air = air_surface(&phantom);
    for p in air.positions() {
        let (skin, bone) = (phantom.skin.value(p), phantom.skull.value(p));
        assert!(skin < -1.5 && bone > 0.0, "{p}: skin {skin}, bone {bone}");
    }
}

/// First bone from the front at (x, z).
fn bone_from_front(phantom: &Phantom, x: f64, z: f64) -> Point {
    let hit = (0..4000).map(|i| Point::new(x, -130.0 + 0.05 * f64::from(i), z));
    hit.into_iter().find(|p| phantom.skull.value(p) < 0.0).unwrap()
}

/// Distance from a point of the bone outwards along the skin's gradient to the skin, mm.
fn thickness(phantom: &Phantom, bone: Point) -> f64 {
    let mut p = bone;
    let mut length = 0.0;
    while phantom.skin.value(&p) < 0.0 {
        p += phantom.skin.value_gradient(&p).1.normalize() * 0.02;
        length += 0.02;
    }
    length
}

#[test]
fn tissue_has_the_thickness_of_a_face() {
    let phantom = head();
    let named = |name: &str| phantom.landmarks.point(name).unwrap();
    let cases = [
        ("forehead", bone_from_front(&phantom, 0.0, 115.0), 2.5..4.0),
        ("nasal bridge", named("nasal_bone_tip"), 2.5..4.5),
        ("upper lip", bone_from_front(&phantom, 0.0, 6.0), 8.0..13.0),
        ("lower lip", bone_from_front(&phantom, 0.0, -5.0), 8.0..13.0),
        ("chin", named("pogonion"), 8.0..12.0),
        ("chin's edge", named("menton"), 5.0..10.0),
        ("nasal spine", named("ans"), 7.0..13.0),
        ("cheek", bone_from_front(&phantom, 25.0, 15.0), 15.0..25.0),
        ("cheek below the orbit", bone_from_front(&phantom, 40.0, 42.0), 8.0..18.0),
    ];
    for (name, bone, expected) in cases {
        let found = thickness(&phantom, bone);
        assert!(expected.contains(&found), "{name}: {found:.2} mm");
    }
}

#[test]
fn landmarks_lie_on_their_surfaces_in_anatomical_order() {
    let phantom = head();
    let l = &phantom.landmarks;
    for (name, p) in &l.points {
        let solid = if name.starts_with("soft") || name == "pronasale" { &phantom.skin } else { &phantom.skull };
        assert!(solid.value(p).abs() < 1e-6, "{name}");
    }
    let z = |name: &str| l.point(name).unwrap().z;
    let le_fort_z = l.le_fort_1_plane.0.z;
    assert!(z("menton") < z("pogonion") && z("pogonion") < l.occlusal_plane_z_mm);
    assert!(l.occlusal_plane_z_mm < z("ans") && z("ans") < le_fort_z && le_fort_z < z("pronasale"));
    assert!(z("pronasale") < z("nasal_bone_tip"));
}

#[test]
fn mandible_and_hyoid_are_apart_from_the_skull_and_planes_part_a_maxilla() {
    let phantom = head();
    let lower_face = Aabb { min: Point::new(-72.0, -100.0, -64.0), max: Point::new(72.0, 30.0, 56.0) };
    let mesh = surface_of(phantom.skull.as_ref(), &lower_face, 1.0).unwrap();
    assert_eq!(prosopon_geometry::parts(&mesh).len(), 3);

    // Bone between the occlusal and the Le Fort I plane in front of the tuberosities touches neither zygoma nor ramus.
    let cut = |p: &Point| (0.0..32.0).contains(&p.z) && p.y < -28.0;
    let lateral = mesh.positions().iter().filter(|p| cut(p)).map(|p| p.x.abs()).fold(0.0, f64::max);
    assert!(lateral < 36.0, "{lateral}");
}

#[test]
fn the_ct_shows_each_tissue() {
    let phantom = head();
    let ct = phantom.ct(4.0);
    assert_eq!(ct.hu.len(), ct.dims.iter().product::<usize>());
    for hu in [-1000, -90, 40, 1200] {
        assert!(ct.hu.iter().filter(|v| **v == hu).count() > 1000, "{hu} HU");
    }
    let body = ct.hu.iter().filter(|v| **v > -300).count() as f64 * 0.064;
    assert!((3400.0..4300.0).contains(&body), "{body} cm³");
}

#[test]
fn the_orbits_rims_lie_on_the_bone_around_the_orbits() {
    let phantom = head();
    let point = |name: &str| phantom.landmarks.point(name).unwrap();
    for (side, sign) in [("left", 1.0), ("right", -1.0)] {
        let (lower, lateral) = (point(&format!("orbitale_{side}")), point(&format!("frontomalare_{side}")));
        for p in [lower, lateral] {
            assert!(phantom.skull.value(&p).abs() < 0.01, "{side} {p}");
        }
        // Between the rims there is no bone in front of the orbit's middle.
        assert!(bone_from_front(&phantom, sign * 30.0, 69.0).y > lower.y + 20.0);
        let rise = lateral - lower;
        assert!((15.0..30.0).contains(&rise.z) && (10.0..25.0).contains(&(sign * rise.x)), "{side} {rise}");
    }
}

#[test]
fn the_hyoid_is_a_bone_of_its_own_behind_and_below_the_chin() {
    let phantom = head();
    let below = Aabb { min: Point::new(-72.0, -100.0, -64.0), max: Point::new(72.0, 30.0, 38.0) };
    let bone = surface_of(phantom.skull.as_ref(), &below, 1.0).unwrap();
    let menton = phantom.landmarks.point("menton").unwrap();
    let parts = prosopon_geometry::parts(&bone);
    let boxes = parts.iter().map(|part| prosopon_geometry::submesh(&bone, part).unwrap().bounds());
    let hyoids: Vec<Aabb> = boxes.filter(|b| b.max.z < menton.z).collect();
    assert_eq!(hyoids.len(), 1);
    let front = hyoids[0].min;
    // Radiographs put the body about 40 mm behind the chin and up to 20 mm below its lower border.
    assert!((40.0..65.0).contains(&(front.y - menton.y)), "{front} {menton}");
    assert!((2.0..20.0).contains(&(menton.z - front.z)), "{front} {menton}");
}
