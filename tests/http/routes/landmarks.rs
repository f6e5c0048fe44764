use serde_json::json;

use crate::support::app::{TestApp, pointers};

#[tokio::test]
async fn landmarks_are_checked_and_stored() {
    let app = TestApp::new().await;
    let path = format!("{}/landmarks", app.session().await);
    app.get(&path).await.problem(404, "not-found");
    let landmarks = json!({
        "points": {"ans": [6, -84, 45]}, "midline_x_mm": 6, "occlusal_plane_z_mm": 17,
        "le_fort_1_plane": {"point_mm": [6, -60, 38], "normal": [0, 0, 2]}
    });
    let stored = app.put_json(&path, landmarks).await.ok();
    assert_eq!(stored["le_fort_1_plane"]["normal"], json!([0.0, 0.0, 1.0]));
    let missing = app.put_json(&path, json!({})).await.problem(422, "invalid-request");
    assert!(missing["detail"].as_str().unwrap().contains("points"), "{missing}");
    assert_eq!(app.get(&path).await.ok(), stored);

    // Files of older versions name two members otherwise.
    let older = json!({
        "frame": "LPS, mm", "accuracy_mm": 2, "landmarks": {"ans": [6, -84, 45]}, "midline_x_mm": 6,
        "occlusal_plane_z_mm": 17, "le_fort_1_plane": {"point": [6, -60, 38], "normal": [0, 0, 1]}
    });
    let read = app.put_json(&path, older).await.ok();
    assert_eq!((&read["points"], &read["le_fort_1_plane"]), (&stored["points"], &stored["le_fort_1_plane"]));
    let other_frame = json!({"frame": "RAS, mm", "points": {"ans": [6, -84, 45]}});
    let problem = app.put_json(&path, other_frame).await.problem(422, "invalid-request");
    assert!(problem["detail"].as_str().unwrap().contains("LPS, mm"), "{problem}");

    let faulty = json!({
        "points": {"ans": [1e9, 0, 0], "Nose Tip": [0, 0, 0]},
        "le_fort_1_plane": {"point_mm": [0, 0, 0], "normal": [0, 0, 0]}
    });
    let problem = app.put_json(&path, faulty).await.problem(422, "invalid-request");
    let pointers: Vec<&str> =
        problem["errors"].as_array().unwrap().iter().map(|e| e["pointer"].as_str().unwrap()).collect();
    assert_eq!(pointers, ["/points/Nose Tip", "/points/ans/0", "/le_fort_1_plane/normal"]);

    // A head in metres is smaller than a tooth, one in micrometres larger than a room.
    let scaled = |scale: f64| {
        let points = [("ans", [6.0, -84.0, 45.0]), ("pogonion", [6.0, -71.0, -25.0]), ("menton", [6.0, -67.0, -33.0])];
        let points: serde_json::Map<_, _> =
            points.into_iter().map(|(name, p)| (name.to_owned(), json!(p.map(|c| c * scale)))).collect();
        json!({ "points": points })
    };
    for (scale, ok) in [(1.0, true), (1e-3, false), (50.0, false)] {
        let answer = app.put_json(&path, scaled(scale)).await;
        assert_eq!(answer.status.is_success(), ok, "{scale}");
        if !ok {
            let problem = answer.problem(422, "invalid-request");
            assert_eq!(problem["errors"][0]["pointer"], "/points");
            assert!(problem["detail"].as_str().unwrap().contains("are in mm"), "{problem}");
        }
    }
    let two = json!({"points": {"ans": [0.006, -0.084, 0.045], "pogonion": [0.006, -0.071, -0.025]}});
    app.put_json(&path, two).await.problem(422, "invalid-request");
}

#[tokio::test]
async fn proposed_landmarks_are_marked_and_do_not_replace_given_ones() {
    let app = TestApp::new().await;
    let session = app.session_with_field().await;
    let path = format!("{session}/landmarks");
    app.get(&path).await.problem(404, "not-found");
    let found = app.get(&format!("{path}?propose=true")).await.ok();
    assert_eq!(
        (&found["points"]["ans"], &found["proposed"]),
        (&json!([0.0, -70.0, 20.0]), &json!(["ans", "midline_x_mm"]))
    );
    app.get(&path).await.problem(404, "not-found");
    app.put_json(&path, json!({"points": {"ans": [1, -71, 21]}})).await.ok();
    let found = app.get(&format!("{path}?propose=true")).await.ok();
    assert_eq!((&found["points"]["ans"], &found["proposed"]), (&json!([1.0, -71.0, 21.0]), &json!(["midline_x_mm"])));
    // The answer can be sent back unchanged; marks must name existing landmarks.
    assert_eq!(app.put_json(&path, found.clone()).await.ok(), found);
    let wrong = json!({"points": {}, "proposed": ["ans"]});
    assert_eq!(pointers(&app.put_json(&path, wrong).await), ["/proposed/0"]);
}
