use super::test_domain::{Shape, face_region};
use super::*;
use crate::control::Control;

fn head(edge: f64) -> (MixedMesh, MeshReport) {
    let (skin, bone, region) = (Shape::head_skin(), Shape::head_bone(), face_region());
    let domain = Domain { skin: &skin, bone: &bone, air: None, region: &region };
    build(&domain, &MeshSettings { edge_mm: edge, ..MeshSettings::default() }, &Control::new()).unwrap()
}

/// What the room promises on a head with a nose, lips, thin tissue on the forehead and bone that pokes out.
#[test]
fn a_head_is_meshed_as_promised() {
    let (mesh, report) = head(4.0);
    assert!(report.tetrahedra > 60_000 && report.prisms > 6_000, "{report:?}");
    assert_eq!((report.inverted, report.nonmanifold_edges), (0, 0));
    // The stuffing's own bound is 10.7 degrees; pressing, halving and mending must not fall below.
    assert!(report.min_dihedral_deg > 10.7, "{report:?}");
    assert!(report.volume_error.abs() < 0.02, "{report:?}");
    assert!(report.max_skin_distance_mm <= 0.3, "{report:?}");
    assert_eq!(mesh.attachment.len(), mesh.positions.len());
}

#[test]
fn the_same_bits_on_a_second_run() {
    assert_eq!(head(8.0), head(8.0));
}
