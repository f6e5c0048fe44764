use axum::http::Method;
use serde_json::{Value, json};

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

fn codes(answer: &Value, list: &str) -> Vec<String> {
    let all = answer[list].as_array().cloned().unwrap_or_default();
    all.iter().map(|w| w["code"].as_str().unwrap().to_owned()).collect()
}

const MARKUPS: &str = r#"{"@schema": "https://example/markups-schema-v1.0.3.json#", "markups": [{
    "type": "Fiducial", "coordinateSystem": "RAS", "controlPoints": [
        {"id": "1", "label": "ANS", "position": [-6, 84, 45], "positionStatus": "defined"},
        {"id": "2", "label": "Pog'", "position": [-6, 83, -20]},
        {"id": "3", "label": "Go (L)", "position": [-50, 0, -8]},
        {"id": "4", "label": "Screw 3", "position": [-1, 2, 3]},
        {"id": "5", "label": "B", "position": [0, 0, 0], "positionStatus": "undefined"}]}]}"#;

#[tokio::test]
async fn landmark_files_of_slicer_are_read_by_their_content() {
    let app = TestApp::new().await;
    let path = format!("{}/landmarks", app.session().await);
    let expected = json!({
        "ans": [6.0, -84.0, 45.0], "gonion_left": [50.0, 0.0, -8.0], "screw_3": [1.0, -2.0, 3.0], "soft_pogonion": [6.0, -83.0, -20.0]
    });
    let fcsv = "# Markups fiducial file version = 5.6\n# CoordinateSystem = LPS\n\
        # columns = id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label,desc,associatedNodeID\n\
        1,6,-84,45,0,0,0,1,1,1,0,ANS,,,2,0\n2,6,-83,-20,0,0,0,1,1,1,0,Pog',,,2,0\n3,50,0,-8,0,0,0,1,1,1,0,Go (L),,,2,0\n\
        4,1,-2,3,0,0,0,1,1,1,0,Screw 3,,,2,0\n";
    let form = |file: &str| {
        format!("--x\r\nContent-Disposition: form-data; name=\"file\"; filename=\"a.fcsv\"\r\n\r\n{file}\r\n--x--\r\n")
    };
    let multipart = "multipart/form-data; boundary=x";
    let json_type = "application/json";
    for (kind, body, notes) in [
        (
            json_type,
            MARKUPS.to_owned(),
            &["landmarks-from-ras", "landmarks-not-placed", "landmarks-renamed", "landmarks-not-known"][..],
        ),
        ("", fcsv.to_owned(), &["landmarks-renamed", "landmarks-not-known"]),
        ("application/x-www-form-urlencoded", fcsv.to_owned(), &["landmarks-renamed", "landmarks-not-known"]),
        (multipart, form(fcsv), &["landmarks-renamed", "landmarks-not-known"]),
        (multipart, form(&json!({ "points": expected }).to_string()), &[]),
    ] {
        let headers = [("content-type", kind)];
        let answer = app.call(Method::PUT, &path, if kind.is_empty() { &[] } else { &headers }, body).await.ok();
        assert_eq!(answer["points"], expected, "{kind}");
        assert_eq!(codes(&answer, "notes"), notes, "{kind}");
        assert_eq!(codes(&answer, "warnings"), [""; 0], "{kind}");
        assert_eq!(app.get(&path).await.ok(), answer, "what was stored is what was answered");
        // The answer can be sent back; its findings are not of that request.
        let again = app.put_json(&path, answer).await.ok();
        assert_eq!((&again["points"], codes(&again, "notes").len()), (&expected, 0));
    }
    let unstated = fcsv.replace("# CoordinateSystem = LPS\n", "");
    let answer = app.call(Method::PUT, &path, &[], unstated).await.ok();
    assert_eq!(
        (codes(&answer, "warnings"), &answer["points"]["ans"]),
        (vec!["no-coordinate-system".to_owned()], &json!([-6.0, 84.0, 45.0]))
    );

    let twice = MARKUPS.replace("Screw 3", "Spina nasalis anterior");
    let answer = app.call(Method::PUT, &path, &[("content-type", json_type)], twice).await;
    let problem = answer.problem(422, "invalid-request");
    let detail = problem["detail"].as_str().unwrap();
    assert!(detail.contains("`ANS` and `Spina nasalis anterior`"), "{problem}");
    let answer = app.call(Method::PUT, &path, &[], fcsv.replace("-84", "x")).await;
    assert!(answer.problem(422, "invalid-request")["detail"].as_str().unwrap().contains("line 4"));
    let neither = app.call(Method::PUT, &path, &[], "ans 1 2 3").await.problem(415, "unsupported-format");
    assert!(neither["detail"].as_str().unwrap().contains(".mrk.json"), "{neither}");
    let twice = [form(fcsv), form(fcsv)].concat().replacen("--x--\r\n", "", 1);
    let answer = app.call(Method::PUT, &path, &[("content-type", multipart)], twice).await;
    assert!(answer.problem(400, "malformed-request")["detail"].as_str().unwrap().contains("several files"));
}

#[tokio::test]
async fn landmarks_in_ras_are_converted() {
    let app = TestApp::new().await;
    let path = format!("{}/landmarks", app.session().await);
    let ras = json!({
        "coordinate_system": "RAS", "points": {"ans": [-6, 84, 45], "menton": [-6, 67, -33]}, "midline_x_mm": -6,
        "le_fort_1_plane": {"point_mm": [-6, 60, 38], "normal": [0, 1, 1]}
    });
    let lps = json!({
        "coordinate_system": "LPS", "points": {"ans": [6, -84, 45], "menton": [6, -67, -33]}, "midline_x_mm": 6,
        "le_fort_1_plane": {"point_mm": [6, -60, 38], "normal": [0, -1, 1]}
    });
    let mut converted = app.put_json(&path, ras.clone()).await.ok();
    assert_eq!(codes(&converted, "notes"), ["landmarks-from-ras"]);
    converted.as_object_mut().unwrap().remove("notes");
    assert_eq!(converted, app.put_json(&path, lps).await.ok());
    assert!(converted.get("coordinate_system").is_none(), "answers are in LPS");
    let mut both = ras;
    both["frame"] = json!("LPS, mm");
    assert_eq!(pointers(&app.put_json(&path, both).await), ["/coordinate_system"]);
}
