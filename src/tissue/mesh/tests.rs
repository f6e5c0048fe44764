use super::test_domain::{Nothing, Shape, face_region};
use super::*;
use prosopon_geometry::control::Control;
use prosopon_geometry::{Aabb, Point, ScalarGrid, Vector};

fn head(edge: f64) -> (MixedMesh, MeshReport) {
    let (skin, bone, region) = (Shape::head_skin(), Shape::head_bone(), face_region());
    let domain = Domain { skin: &skin, bone: &bone, air: None, soft_tissue: None, region: &region };
    build(&domain, &MeshSettings { edge_mm: edge, ..MeshSettings::default() }, &Control::new()).unwrap()
}

/// Guarantees of the mesh on a head with a nose, lips, thin tissue on the forehead and bone that penetrates the skin.
#[test]
fn a_head_is_meshed_as_promised() {
    let (mesh, report) = head(4.0);
    assert!(report.tetrahedra > 60_000 && report.prisms > 6_000, "{report:?}");
    assert_eq!((report.inverted, report.nonmanifold_edges), (0, 0));
    // The stuffing alone guarantees 10.7 degrees; pressing, splitting and repair must not fall below.
    assert!(report.min_dihedral_deg > 10.7, "{report:?}");
    assert!(report.volume_error.abs() < 0.02, "{report:?}");
    assert!(report.max_skin_distance_mm <= 0.3, "{report:?}");
    assert_eq!(mesh.attachment.len(), mesh.positions.len());
}

/// A CT with fat on the right, muscle on the left and no values above z = 20, where depth decides as without a CT.
#[test]
fn a_ct_tells_fat_from_muscle_and_depth_does_where_it_says_nothing() {
    let (skin, bone, region) = (Shape::head_skin(), Shape::head_bone(), face_region());
    let mut hu = ScalarGrid::covering(&region.bounds.grown(10.0), 2.0, 0.0);
    for at in 0..hu.values.len() {
        let [i, j, k] = [at % hu.dims[0], at / hu.dims[0] % hu.dims[1], at / hu.dims[0] / hu.dims[1]];
        let p = hu.position(i, j, k);
        hu.values[at] = if p.z > 20.0 { f32::NAN } else { (10.0 * p.x - 25.0).clamp(-100.0, 60.0) as f32 };
    }
    let by_depth = Domain { skin: &skin, bone: &bone, air: None, soft_tissue: None, region: &region };
    let settings = MeshSettings { edge_mm: 8.0, ..MeshSettings::default() };
    let built = |domain: &Domain<'_>| build(domain, &settings, &Control::new()).unwrap();
    let (plain, depth_report) = built(&by_depth);
    let (mesh, report) = built(&Domain { soft_tissue: Some(&hu.into()), ..by_depth });
    assert_eq!((&mesh.tetrahedra, &mesh.positions), (&plain.tetrahedra, &plain.positions));
    assert!(report.tissue_from_ct && !depth_report.tissue_from_ct);
    assert!((0.05..0.95).contains(&depth_report.muscle_share), "{depth_report:?}");
    let mut seen = [0; 3];
    for (t, corners) in mesh.tetrahedra.iter().enumerate() {
        let p = corners.map(|i| mesh.positions[i as usize]);
        let centre = Point::from(p.iter().map(|q| q.coords).sum::<Vector>() / 4.0);
        let all = |fits: &dyn Fn(&Point) -> bool| p.iter().all(fits);
        let expected = if all(&|q| q.z > 24.0) {
            seen[0] += 1;
            plain.tetrahedron_tissue[t]
        } else if all(&|q| q.z < 16.0) && centre.x.abs() > 1.0 {
            seen[1 + usize::from(centre.x > 0.0)] += 1;
            if centre.x < 0.0 { Tissue::Fat } else { Tissue::Muscle }
        } else {
            continue;
        };
        assert_eq!(mesh.tetrahedron_tissue[t], expected, "{centre}");
    }
    assert!(seen.iter().all(|n| *n > 100), "{seen:?}");
}

/// A wing of skin 3.5 mm thick with a round rim on thick tissue.
/// Lattices of 4 mm do not resolve it, refined cubes do. Its prisms cover both sides; their flat outer triangles have the sides'
/// area, up to the triangles that cross the sample's border.
#[test]
fn a_thin_wing_is_covered_with_prisms() {
    let skin = Shape(Box::new(|p| {
        let q = (p - Point::new(0.0, 0.0, 5.0)).abs() - Vector::new(0.05, 14.0, 10.0);
        let wing = q.sup(&Vector::zeros()).norm() + q.max().min(0.0) - 1.7;
        let h = (3.0 - (wing - p.z).abs()).max(0.0) / 3.0;
        wing.min(p.z) - h * h * 0.75
    }));
    let region = Region {
        bounds: Aabb { min: Point::new(-20.0, -22.0, -15.0), max: Point::new(20.0, 22.0, 25.0) },
        half_spaces: vec![],
    };
    let domain = Domain { skin: &skin, bone: &Nothing, air: None, soft_tissue: None, region: &region };
    let (mesh, report) = build(&domain, &MeshSettings::default(), &Control::new()).unwrap();
    assert!(report.warnings.iter().all(|w| w.code != "mesh-prisms-left-out"), "{report:?}");
    assert_eq!((report.inverted, report.nonmanifold_edges), (0, 0));
    assert!(report.max_skin_distance_mm <= 0.3, "{report:?}");
    assert!(report.min_dihedral_deg > 8.0, "{report:?}");
    let sampled = |p: &Point| p.x.abs() < 3.0 && p.y.abs() < 11.0 && (5.0..13.0).contains(&p.z);
    let mut area = 0.0;
    for prism in &mesh.prisms {
        let [a, b, c] = [prism[0], prism[1], prism[2]].map(|i| mesh.positions[i as usize]);
        if sampled(&Point::from((a.coords + b.coords + c.coords) / 3.0)) {
            area += 0.5 * (b - a).cross(&(c - a)).norm();
        }
    }
    let sides = 2.0 * 22.0 * 8.0;
    assert!((area / sides - 1.0).abs() < 0.08, "{area} of {sides} mm²");
}

#[test]
fn the_same_bits_on_a_second_run() {
    assert_eq!(head(8.0), head(8.0));
}
