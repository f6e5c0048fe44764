use serde_json::json;

use crate::support::app::TestApp;
use crate::support::shapes::{cube, skull, stl};

#[tokio::test]
async fn a_field_returns_its_report_distances_and_settings() {
    let app = TestApp::new().await;
    let session = app.session_with_field().await;
    let field = app.get(&format!("{session}/field")).await.ok();
    assert_eq!((&field["state"], &field["report"]["skin"]["max_error_mm"]), (&json!("ready"), &json!(0.05)));
    assert_eq!(field["settings"]["method"], "adaptive");
    let place = json!({"elements": 10, "area_mm2": 4.0, "min_mm": [1.0, 2.0, 3.0], "max_mm": [4.0, 5.0, 6.0]});
    let inverted = json!({"doubt": "inverted", "count": 3, "elements": 12, "area_mm2": 4.5, "largest": [place]});
    assert_eq!(field["report"]["bone"]["regions"], json!([inverted]));
    let body = json!({"points_mm": [[0, -70, 0], [0, 0, 50]], "solid": "bone"});
    let values = app.post(&format!("{session}/field/query"), body).await.ok();
    assert_eq!(values["distances_mm"], json!([10.0, -10.0]));
    assert_eq!(values["gradients"], json!([[0.0, -1.0, 0.0], [0.0, 0.0, 1.0]]));
    assert_eq!(values["closest_points_mm"], json!([[0.0, -60.0, 0.0], [0.0, 0.0, 60.0]]));
    assert_eq!(values["triangles"], json!([7, 7]));
    let far = json!({"points_mm": [[0, 0, 1e30]]});
    let problem = app.post(&format!("{session}/field/query"), far).await.problem(422, "invalid-request");
    assert_eq!(problem["errors"][0]["pointer"], "/points_mm/0/2");
    let settings = format!("{session}/field/settings");
    for method in ["uniform", "frisken", "hybrid", "adaptive"] {
        app.put_json(&settings, json!({"method": method, "resolution": 64, "tolerance_mm": 0.05})).await.ok();
        let seen = app.get(&format!("{session}/field")).await.ok()["settings"].clone();
        assert_eq!(
            (&seen["method"], &seen["resolution"], &seen["tolerance_mm"]),
            (&json!(method), &json!(64), &json!(0.05))
        );
    }
    for (name, value) in [("spacing_mm", json!(0)), ("resolution", json!(4)), ("tolerance_mm", json!(0))] {
        let problem = app.put_json(&settings, json!({name: value})).await;
        assert_eq!(problem.problem(422, "invalid-request")["errors"][0]["pointer"], format!("/{name}"));
    }
}

#[tokio::test]
async fn a_skin_inside_the_skull_is_refused() {
    let app = TestApp::new().await;
    let session = app.session().await;
    app.upload(&format!("{session}/skin"), skull()).await.ok();
    let refused = async |skull| {
        app.upload(&format!("{session}/skull"), stl(&skull)).await.ok();
        let problem = app.post(&format!("{session}/field"), json!({})).await.problem(422, "anatomy-not-usable");
        problem["detail"].as_str().unwrap().to_owned()
    };
    assert!(refused(cube([0.0; 3], 200.0)).await.contains("swapped"));
    assert!(refused(cube([0.0, 0.0, 500.0], 60.0)).await.contains("do not overlap"));
    // When the bounding boxes cross, the numerics decide; here the skull is larger than the skin.
    app.upload(&format!("{session}/skull"), stl(&cube([150.0, 0.0, 0.0], 200.0))).await.ok();
    let job = app.finish(app.post(&format!("{session}/field"), json!({})).await).await;
    assert_eq!((&job["status"], &job["problem"]["status"]), (&json!("failed"), &json!(422)));
    assert_eq!(job["problem"]["type"], "/problems/anatomy-not-usable");
    assert_eq!(job["phase"], "field", "where it failed");
}
