use super::test_domain::{Shape, face_region};
use super::*;
use crate::control::Control;

fn head(edge: f64) -> (MixedMesh, MeshReport) {
    let (skin, bone, region) = (Shape::head_skin(), Shape::head_bone(), face_region());
    let domain = Domain { skin: &skin, bone: &bone, air: None, region: &region };
    build(&domain, &MeshSettings { edge_mm: edge, ..MeshSettings::default() }, &Control::new()).unwrap()
}

#[test]
fn study() {
    let t = std::time::Instant::now();
    let (_, report) = head(4.0);
    println!("{report:#?} {:?}", t.elapsed());
}
