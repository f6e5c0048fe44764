//! Frames of turned heads.

use super::*;
use crate::phantom::{head_with_mouth, surface_of};

fn phantom() -> [TriMesh; 2] {
    let head = head_with_mouth();
    [head.skin.as_ref(), head.skull.as_ref()].map(|solid| surface_of(solid, &head.bounds(), 3.0).unwrap())
}

#[test]
fn a_turned_phantom_has_the_same_frame() {
    let [skin, skull] = phantom();
    let upright = head_frame(&skin, &skull, &Control::new()).unwrap();
    println!("{upright:?} {}", upright.turned_deg());
    assert_eq!(upright.basis, FrameBasis::Landmarks);
    assert!(upright.turned_deg() < 6.0);
    let turns = [
        [0.4, 0.0, 0.0],
        [-0.7, 0.0, 0.0],
        [0.0, 0.6, 0.0],
        [0.0, 0.0, 0.7],
        [0.5, 0.4, -0.3],
        [0.0, 0.0, 3.1],
        [1.6, 0.0, 0.0],
    ];
    for turn in turns {
        let motion =
            Motion::from_parts(Vector::new(120.0, -40.0, 900.0).into(), UnitQuaternion::from_scaled_axis(turn.into()));
        let found = head_frame(&skin.moved(&motion), &skull.moved(&motion), &Control::new()).unwrap();
        let off = found.from_scan * motion * upright.from_scan.inverse();
        println!("{turn:?}: {:.4} deg {:.4} mm", off.rotation.angle().to_degrees(), off.translation.vector.norm());
        assert!(off.rotation.angle().to_degrees() < 0.2 && off.translation.vector.norm() < 0.3, "{turn:?}");
    }
}
