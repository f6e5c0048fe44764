//! The deformed volume of a head, with the real numerics on a phantom.

use serde_json::json;

use crate::support::binary::Server;
use prosopon_formats::import::{Limits, volume_mesh};
use prosopon_geometry::VolumeMesh;

/// Its points are at rest whatever the plan, nodes tied to a segment move with it, and what is fixed stays.
#[test]
fn the_volume_says_what_was_solved() {
    let directory = tempfile::tempdir().unwrap();
    let server = Server::start(directory.path(), &[]);
    let session = server.session_with_field();
    let (osteotomy, jaw) = server.cut(&session);
    let mesh =
        server.finish(&server.post(&format!("{session}/mesh"), &json!({ "osteotomy": osteotomy, "edge_mm": 9 })));
    let solved = |forward_mm: f64| -> VolumeMesh {
        let waypoints = json!([{ "t": 1, "translation_mm": [0, -forward_mm, 0] }]);
        let plan = json!({ "osteotomy": osteotomy, "paths": [{ "segment": jaw, "waypoints": waypoints }] });
        let plan = server.post(&format!("{session}/plans"), &plan).ok()["id"].clone();
        let solve = json!({ "plan": plan, "mesh": mesh["id"], "model": "linear", "steps": 1, "outputs": ["tissue"] });
        let job = server.finish(&server.post(&format!("{session}/jobs"), &solve));
        volume_mesh(&server.get(job["links"]["tissue"].as_str().unwrap()).body, &Limits::default()).unwrap().0
    };
    let [near, far] = [2.0, 4.0].map(solved);
    assert_eq!(near.points, far.points);
    let segment = jaw.as_f64().unwrap();
    for (file, forward_mm) in [(&near, 2.0), (&far, 4.0)] {
        let attachment = &file.point_array("attachment").unwrap().values;
        let displacement = file.point_array("displacement_mm").unwrap().values.as_chunks::<3>().0;
        let of = |wanted: f64| {
            let all = attachment.iter().zip(displacement).filter(move |(a, _)| **a == wanted);
            all.map(|(_, u)| *u).collect::<Vec<_>>()
        };
        // Near a saw line and at the teeth most tissue glides on the segment.
        let (tied, gliding, still) = (of(segment), of(-3.0 - segment), of(0.0));
        let counts = [tied.len(), gliding.len(), still.len()];
        assert!(counts[0] > 0 && counts[1] > 20 && counts[2] > 20, "{counts:?}");
        assert!(tied.iter().all(|u| u[0].abs() < 1e-9 && (u[1] + forward_mm).abs() < 1e-9 && u[2].abs() < 1e-9));
        assert!(still.iter().all(|u| u.iter().all(|c| c.abs() < 1e-9)));
    }
}
