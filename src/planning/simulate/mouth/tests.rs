//! The slit of the phantom, found and meshed.

use super::{Face, Mouth, find};
use crate::phantom::{Phantom, head, head_with_mouth, surface_of};
use crate::simulate::{Anatomy, FieldsSettings, TissueSettings, build_fields, build_tissue};
use prosopon_geometry::control::Control;
use prosopon_geometry::{Aabb, Point, TriMesh, Vector};
use prosopon_tissue::mesh::{MeshSettings, Slit};

fn lower_face(solid: &dyn prosopon_geometry::Implicit, spacing: f64) -> TriMesh {
    let bounds = Aabb { min: Point::new(-60.0, -115.0, -55.0), max: Point::new(60.0, -20.0, 75.0) };
    surface_of(solid, &bounds, spacing).unwrap()
}

fn found(phantom: &Phantom, mouth: &Mouth, landmarks: &[(String, Point)]) -> (Option<Slit>, Vec<&'static str>) {
    let (skin, skull) = (lower_face(phantom.skin.as_ref(), 1.5), lower_face(phantom.skull.as_ref(), 2.0));
    let (bone, air) = (phantom.skull.as_ref(), Some(phantom.air.as_ref()));
    let face =
        Face { skin: &skin, skull: &skull, bone, air: air.map(|a| a as &dyn prosopon_geometry::Implicit), landmarks };
    let (slit, warnings) = find(&face, mouth);
    (slit, warnings.iter().map(|w| w.code).collect())
}

/// Largest distance in height from the analytic slit, and the distances of both ends along x, mm.
fn off(phantom: &Phantom, slit: &Slit) -> (f64, [f64; 2]) {
    let mouth = phantom.mouth.unwrap();
    let [right, left] = slit.span();
    let places = (0..=40).map(|i| right + (left - right) * f64::from(i) / 40.0);
    let height = places.map(|x| slit.height(&Point::new(x, -95.0, mouth.z_at(x))).abs()).fold(0.0, f64::max);
    (height, [(right + mouth.half_width_mm).abs(), (left - mouth.half_width_mm).abs()])
}

#[test]
fn the_slit_of_the_phantom_is_found_within_a_millimetre() {
    let phantom = head_with_mouth();
    let all = &phantom.landmarks.points;
    let without: Vec<(String, Point)> =
        all.iter().filter(|(n, _)| n != "stomion" && !n.starts_with("cheilion")).cloned().collect();
    let mut proposed = without.clone();
    proposed.push(("incisor_upper".to_owned(), Point::new(0.0, -86.0, 1.1)));
    for (name, landmarks, ends) in [("landmarks", all, 0.5), ("incisors", &proposed, 2.0)] {
        let (slit, codes) = found(&phantom, &Mouth::Auto, landmarks);
        let slit = slit.unwrap_or_else(|| panic!("{name}: {codes:?}"));
        let (height, at_ends) = off(&phantom, &slit);
        println!("{name}: {height:.2} mm, ends {at_ends:.2?} mm, {codes:?}");
        assert_eq!(codes, ["mouth-parted"], "{name}");
        assert!(height < 1.0, "{name}: {height}");
        // The groove is rounded at its ends, within a millimetre; a commissure that is a landmark is kept.
        assert!(at_ends.iter().all(|e| *e < ends), "{name}: {at_ends:?}");
        for k in slit.knots() {
            // The lips end at the vestibule, one step of the search or an average over 8 mm beside it.
            let air = phantom.air.value(&Point::new(k.front.x, k.back_y + 0.3, k.front.z));
            assert!(k.front.x.abs() > 14.0 || air < 1.0, "{name}: {} {air}", k.front);
        }
    }
}

#[test]
fn a_given_curve_is_taken_and_a_wrong_one_leaves_the_lips_joined() {
    let phantom = head_with_mouth();
    let mouth = phantom.mouth.unwrap();
    let on_skin = |x: f64| mouth.on_skin(phantom.skin.as_ref(), x).unwrap();
    let curve: Vec<Point> = [-23.0, -12.0, 0.0, 12.0, 23.0].map(on_skin).to_vec();
    let (slit, codes) = found(&phantom, &Mouth::Curve(curve.clone()), &[]);
    assert_eq!(codes, ["mouth-parted"]);
    assert!(off(&phantom, &slit.unwrap()).0 < 0.1);
    let far = curve.iter().map(|p| p - Vector::y() * 12.0).collect();
    assert_eq!(found(&phantom, &Mouth::Curve(far), &[]), (None, vec!["mouth-not-parted"]));
    assert_eq!(found(&phantom, &Mouth::Curve(curve[..2].to_vec()), &[]), (None, vec!["mouth-not-parted"]));
    assert_eq!(found(&phantom, &Mouth::Glued, &[]), (None, vec![]));
}

#[test]
fn a_curve_where_the_landmarks_place_no_mouth_parts_with_a_warning() {
    let phantom = head_with_mouth();
    let mouth = phantom.mouth.unwrap();
    let landmarks = &phantom.landmarks.points;
    let all_around = [Point::new(-50.0, 0.0, -50.0), Point::new(50.0, 0.0, 50.0)];
    let front = super::Front::of(&lower_face(phantom.skin.as_ref(), 1.5), &all_around, 1.0).unwrap();
    let curve = |dx: f64, dz: f64| -> Vec<Point> {
        let on_skin = |x: f64| {
            let (x, z) = (x + dx, mouth.z_at(x) + dz);
            Point::new(x, front.at(x, z).unwrap(), z)
        };
        [-20.0, -10.0, 0.0, 10.0, 20.0].map(on_skin).to_vec()
    };
    let codes = |dx, dz| found(&phantom, &Mouth::Curve(curve(dx, dz)), landmarks).1;
    assert!(!codes(0.0, 0.0).contains(&"mouth-elsewhere"));
    assert!(codes(0.0, -20.0).contains(&"mouth-elsewhere"), "over the chin");
    assert!(codes(25.0, 0.0).contains(&"mouth-elsewhere"), "on one cheek");
}

#[test]
fn a_chin_without_a_mouth_is_not_parted() {
    let mut phantom = head();
    phantom.landmarks.points.push(("stomion".to_owned(), Point::new(0.0, -78.0, -33.0)));
    let (slit, codes) = found(&phantom, &Mouth::Auto, &phantom.landmarks.points);
    assert_eq!((slit, codes), (None, vec!["mouth-not-parted"]));
}

#[test]
fn corners_on_the_wrong_side_and_landmarks_off_the_skin_leave_the_lips_joined() {
    let phantom = head_with_mouth();
    let moved = |name: &str, to: fn(Point) -> Point| -> Vec<(String, Point)> {
        let all = phantom.landmarks.points.iter();
        all.map(|(n, p)| (n.clone(), if n.starts_with(name) { to(*p) } else { *p })).collect()
    };
    let mirrored = |p: Point| Point::new(-p.x, p.y, p.z);
    let cases = [
        moved("cheilion", mirrored),
        moved("cheilion_left", mirrored),
        moved("stomion", |p| Point::new(p.x, 0.0, p.z)),
    ];
    for landmarks in cases {
        assert_eq!(found(&phantom, &Mouth::Auto, &landmarks), (None, vec!["mouth-not-parted"]));
    }
}

/// The user's vertices keep their order and place, every vertex at the mouth has its prism, and pulling the lips' nodes apart
/// opens the skin without a triangle across the gap.
#[test]
fn the_skin_parts_with_the_lips() {
    let phantom = head_with_mouth();
    let anatomy = Anatomy {
        skin: surface_of(phantom.skin.as_ref(), &phantom.bounds(), 2.0).unwrap(),
        skull: surface_of(phantom.skull.as_ref(), &phantom.bounds(), 2.0).unwrap(),
        air: None,
        soft_tissue: None,
        landmarks: phantom.landmarks.points.clone(),
        midline_x_mm: None,
    };
    let fields = build_fields(&anatomy, &FieldsSettings::default(), &Control::new()).unwrap();
    let region = Aabb { min: Point::new(-45.0, -112.0, -45.0), max: Point::new(45.0, -45.0, 35.0) };
    let settings = TissueSettings {
        mesh: MeshSettings::default(),
        region: Some(region),
        mouth: Mouth::Auto,
        ..TissueSettings::default()
    };
    let tissue = build_tissue(&anatomy, &fields, None, &settings, &Control::new()).unwrap();
    let codes: Vec<_> = tissue.report.warnings.iter().map(|w| w.code).collect();
    println!("{codes:?} {:?}", tissue.report);
    assert!(codes.contains(&"mouth-parted") && codes.contains(&"mouth-skin-cut"), "{codes:?}");
    let (slit, parted) = (tissue.slit.as_ref().unwrap(), tissue.parted.as_ref().unwrap());
    assert_eq!(parted.skin.positions()[..parted.own], anatomy.skin.positions()[..]);
    assert_eq!(tissue.embedding.anchors.len(), tissue.skin(&anatomy).positions().len());

    // Nodes above the slit go up, those below go down, by 2.5 mm in the middle and less towards the corners.
    let [right, left] = slit.span();
    let mut upper: Vec<bool> = tissue.mesh.positions.iter().map(|p| slit.height(p) > 0.0).collect();
    tissue.mesh.facing[0].sides[0].iter().flatten().for_each(|n| upper[*n as usize] = true);
    tissue.mesh.facing[0].sides[1].iter().flatten().for_each(|n| upper[*n as usize] = false);
    let up = |x: f64| 2.5 * (((x - right).min(left - x)) / 10.0).clamp(0.0, 1.0);
    let u: Vec<f64> = tissue
        .mesh
        .positions
        .iter()
        .zip(&upper)
        .map(|(p, up_side)| if *up_side { up(p.x) } else { -up(p.x) })
        .collect();
    let moved: Vec<Point> = (parted.skin.positions().iter().zip(&tissue.embedding.anchors))
        .map(|(p, anchor)| {
            let Some((prism, l)) = anchor else { return *p };
            let nodes = tissue.mesh.prisms[*prism as usize];
            p + Vector::z() * (0..3).map(|i| u[nodes[i] as usize] * l[i]).sum::<f64>()
        })
        .collect();
    let moved = parted.skin.with_positions(moved).unwrap();
    let (mut longest, mut gap, mut without) = (0.0f64, 0.0f64, 0);
    for (t, nodes) in moved.triangles().iter().enumerate() {
        let at_mouth = nodes.iter().any(|v| *v as usize >= parted.own);
        if !at_mouth {
            continue;
        }
        without += nodes.iter().filter(|v| tissue.embedding.anchors[**v as usize].is_none()).count();
        let length = |m: &TriMesh| {
            let [a, b, c] = m.corners(t);
            (b - a).norm().max((c - b).norm()).max((a - c).norm())
        };
        longest = longest.max(length(&moved) - length(&parted.skin));
    }
    for pair in (parted.own..moved.positions().len()).step_by(2) {
        if moved.positions()[pair].x.abs() < 10.0 {
            gap = gap.max(5.0 - (moved.positions()[pair].z - moved.positions()[pair + 1].z));
        }
    }
    println!("longer by {longest:.2} mm, gap lacks {gap:.2} mm, {without} without a prism");
    assert_eq!(without, 0);
    // Towards the corners the lips' motion changes by a quarter of the distance, within a triangle 3 mm long by under 1 mm.
    assert!(longest < 1.2, "{longest}");
    assert!(gap < 0.1, "{gap}");
}
