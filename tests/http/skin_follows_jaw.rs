//! The skin follows the bone, with the real numerics on a coarse phantom.

use serde_json::{Value, json};

use crate::support::binary::Server;

/// Forward movement of each region, mm, when the upper jaw moves `forward` mm.
fn forward_mm(server: &Server, session: &str, (osteotomy, jaw): &(Value, Value), forward: f64) -> Value {
    let waypoints = json!([{ "t": 1, "translation_mm": [0, -forward, 0] }]);
    let plan = json!({ "osteotomy": osteotomy, "paths": [{ "segment": jaw, "waypoints": waypoints }] });
    let plan = server.post(&format!("{session}/plans"), &plan).ok()["id"].clone();
    let solve = json!({ "plan": plan, "model": "mixed", "steps": 2 });
    let job = server.finish(&server.post(&format!("{session}/jobs"), &solve));
    server.get(&format!("/v1/jobs/{}/report", job["id"].as_str().unwrap())).ok()["regions"].clone()
}

/// Tied nodes pull as well as push, so a set-back moves the skin back: the lip by half to all of the bone's movement,
/// distant regions not at all.
#[test]
fn the_skin_follows_the_jaw_forward_and_back() {
    let directory = tempfile::tempdir().unwrap();
    let server = Server::start(directory.path(), &[]);
    let session = server.session_with_field();
    let cut = server.cut(&session);
    server.finish(&server.post(&format!("{session}/mesh"), &json!({ "osteotomy": cut.0, "edge_mm": 8.0 })));
    for way in [4.0, -4.0] {
        let regions = forward_mm(&server, &session, &cut, way);
        let moved = |name: &str| regions[name]["forward_mm"].as_f64().unwrap() / way;
        assert!((0.5..1.0).contains(&moved("upper_lip")), "{way}: {regions}");
        assert!((0.3..1.0).contains(&moved("paranasal_left")), "{way}: {regions}");
        assert!((moved("paranasal_left") - moved("paranasal_right")).abs() < 0.1, "{way}: {regions}");
        assert!(moved("forehead").abs() < 0.02, "{way}: {regions}");
    }
}
