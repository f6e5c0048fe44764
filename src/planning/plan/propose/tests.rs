use super::*;
use crate::phantom::{head, surface_of};
use crate::plan::{Template, cut};
use prosopon_field::{EnvelopeSettings, envelope};
use prosopon_geometry::control::Control;

fn surfaces() -> (TriMesh, TriMesh) {
    let head = head();
    let sampled = |solid| surface_of(solid, &head.bounds(), 1.5).unwrap();
    (sampled(head.skin.as_ref()), sampled(head.skull.as_ref()))
}

#[test]
fn proposals_on_the_phantom_lie_at_its_landmarks() {
    let head = head();
    let (skin, skull) = surfaces();
    let found = propose(&skin, &skull);
    // Steps of 0.1 mm on a symmetric head.
    assert!(found.midline_x_mm.abs() < 0.3, "{}", found.midline_x_mm);
    for name in ["pronasale", "ans", "pogonion", "menton", "soft_pogonion", "nasal_bone_tip"] {
        let (p, q) = (found.points.get(name), head.landmarks.point(name).unwrap());
        // Steps of 1 mm, a grid of 1.5 mm, and flat extrema.
        let off = p.map_or(f64::INFINITY, |p| (p.y - q.y).hypot(p.z - q.z));
        assert!(off < 4.0, "{name}: {p:?} and {q}, {off:.1} mm apart");
    }
    let occlusal = found.occlusal_z_mm.unwrap();
    assert!((occlusal - head.landmarks.occlusal_plane_z_mm).abs() < 2.0, "{occlusal}");
    for (side, name) in [(1.0, "left"), (-1.0, "right")] {
        let point = |what: &str| found.points[&format!("{what}_{name}")];
        // The plate of the ramus is 7 mm thick about x = 46, from y = -20 to 4 at its narrowest; lower down it runs into the
        // body, 16 mm thick, and its medial face is taken over both.
        let lingula = point("lingula");
        assert!((38.0..44.0).contains(&(side * lingula.x)) && (-15.0..4.0).contains(&lingula.y), "{lingula}");
        let molar = point("molar");
        assert!(molar.y < lingula.y - 20.0 && molar.z < occlusal - 8.0, "{molar}");
    }
}

#[test]
fn a_tilted_head_with_an_offset_gives_the_same_landmarks() {
    let (skin, skull) = surfaces();
    let tilt = turn_about(&Point::origin(), 0.2);
    let shift = Motion::translation(13.0, -40.0, 250.0) * tilt;
    let (upright, tilted) = (propose(&skin, &skull), propose(&skin.moved(&shift), &skull.moved(&shift)));
    for (name, p) in &upright.points {
        let off = tilted.points.get(name).map_or(f64::INFINITY, |q| (shift * p - q).norm());
        // Other voxels, pitches in whole degrees; extrema are flat.
        assert!(off < 6.0, "{name} {off:.1} mm apart");
    }
    let [(_, n), (_, m)] = [upright, tilted].map(|p| p.le_fort_1_plane.unwrap());
    assert!((shift * n).angle(&m) < 0.06, "{} {m}", shift * n);
}

#[test]
fn templates_part_the_phantom_by_proposals_alone() {
    let (skin, skull) = surfaces();
    let mut landmarks = Landmarks::default();
    let filled = propose(&skin, &skull).fill(&mut landmarks);
    assert!(filled.contains(&"le_fort_1_plane".to_owned()) && filled.contains(&"lingula_left".to_owned()));
    let bone = envelope(
        &skull,
        &EnvelopeSettings { spacing_mm: 1.5, closing_mm: 3.0, ..EnvelopeSettings::default() },
        &Control::new(),
    );
    let bone = bone.unwrap();
    for (template, least_cm3, most_cm3) in [
        (Template::LeFort1, 30.0, 60.0),
        (Template::TwoPieceMaxilla, 15.0, 30.0),
        (Template::BssoLeft, 50.0, 100.0),
        (Template::BssoRight, 50.0, 100.0),
        (Template::Genioplasty, 4.0, 15.0),
    ] {
        let cuts = template.cuts(&landmarks, &bone).unwrap();
        let done = cut(&bone, &cuts, &Control::new()).unwrap();
        let cm3 = done.segments[1].volume_mm3 * 1e-3;
        assert!((least_cm3..most_cm3).contains(&cm3), "{} {cm3:.1} cm3", template.name());
    }
}

#[test]
fn a_block_has_a_midline_and_no_landmarks() {
    let corner = |i: u32| {
        let at = |bit: u32, half: f64| if i >> bit & 1 == 1 { half } else { -half };
        Point::new(4.0 + at(0, 60.0), at(1, 80.0), at(2, 90.0))
    };
    let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let triangles = faces.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).collect();
    let block = TriMesh::new((0..8).map(corner).collect(), triangles).unwrap();
    let found = propose(&block, &block);
    assert!(found.points.is_empty() && found.occlusal_z_mm.is_none() && found.le_fort_1_plane.is_none());
}
