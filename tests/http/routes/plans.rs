use axum::http::StatusCode;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde_json::{Value, json};

use super::osteotomies::plane;
use crate::support::app::{TestApp, pointers};
use crate::support::binary::Server;

/// Creates an osteotomy; returns the path of the plans of its session, and its id.
async fn osteotomy(app: &TestApp) -> (String, Value) {
    let session = app.session_with_field().await;
    let id = app.post(&format!("{session}/osteotomies"), plane(0.0)).await.ok()["id"].clone();
    (format!("{session}/plans"), id)
}

#[tokio::test]
async fn a_plan_stores_its_motions_and_reports_each_path() {
    let app = TestApp::new().await;
    let (path, osteotomy) = osteotomy(&app).await;
    let quarter = 0.5f64.sqrt();
    let rotations = [
        json!({"quaternion_xyzw": [0, 0, quarter, quarter], "pivot_mm": [10, 0, 0]}),
        json!({"axis_angle": {"axis": [0, 0, 3], "angle_deg": 90}, "pivot_mm": [10, 0, 0]}),
        json!({"pitch_roll_yaw": {"yaw_deg": 90}, "pivot_mm": [10, 0, 0]}),
    ];
    for rotation in rotations {
        let waypoints = json!([{"t": 0.5, "translation_mm": [0, -3, 0]}, {"t": 1, "rotation": rotation}]);
        let body = json!({"osteotomy": osteotomy, "paths": [{"segment": 1, "waypoints": waypoints}]});
        let made = app.post(&path, body).await.ok();
        let last = made["paths"][0]["waypoints"].as_array().unwrap().last().unwrap().clone();
        // A quarter turn about z through (10, 0, 0) brings the origin to (10, -10, 0).
        for (found, expected) in last["translation_mm"].as_array().unwrap().iter().zip([10.0, -10.0, 0.0]) {
            assert!((found.as_f64().unwrap() - expected).abs() < 1e-12, "{last}");
        }
        // Overlaps and gaps are measured once, when the plan is read.
        assert_eq!((&made["measured"], &made["reports"][0]["along"]), (&json!(false), &json!([])));
        let own = format!("{path}/{}", made["id"].as_str().unwrap());
        let read = app.get(&own).await.ok();
        assert_eq!((&read["measured"], &read["paths"]), (&json!(true), &made["paths"]));
        assert_eq!(read["reports"][0]["segment"], 1);
        assert_eq!(read["reports"][0]["along"].as_array().unwrap().len(), 2);
        assert_eq!(read["warnings"][0]["code"], "stand-in");
        assert_eq!(app.get(&own).await.ok(), read);
        assert_eq!(app.get(&path).await.ok()["plans"], json!([read]));
        assert_eq!(app.delete(&own).await.status, StatusCode::NO_CONTENT);
        app.get(&own).await.problem(410, "gone");
    }
    assert_eq!(app.get(&path).await.ok()["plans"], json!([]));
}

#[tokio::test]
async fn a_hinge_turns_about_its_axis() {
    let app = TestApp::new().await;
    let (path, osteotomy) = osteotomy(&app).await;
    let hinge = json!({"point_mm": [0, 10, 0], "axis": [1, 0, 0], "angle_deg": 10});
    let waypoints = json!([{"t": 1, "hinge": hinge}]);
    let body = json!({"osteotomy": osteotomy, "paths": [{"segment": 1, "waypoints": waypoints}]});
    let made = app.post(&path, body).await.ok();
    let moved = made["paths"][0]["waypoints"][1]["translation_mm"][2].as_f64().unwrap();
    assert!((moved + 10.0 * 10f64.to_radians().sin()).abs() < 1e-12);
}

#[tokio::test]
async fn the_mandible_turns_about_its_condyles() {
    let app = TestApp::new().await;
    let (path, osteotomy) = osteotomy(&app).await;
    let hinge = json!([{"segment": 1, "waypoints": [{"t": 1, "hinge": {"angle_deg": 10}}]}]);
    let body = json!({"osteotomy": osteotomy, "paths": hinge});
    assert_eq!(pointers(&app.post(&path, body.clone()).await), ["/paths/0/waypoints/0/hinge"]);
    let alone = json!({"osteotomy": osteotomy, "paths": [{"segment": 1, "autorotate": {"follows": 2}}]});
    let expected = ["/paths/0/autorotate/follows", "/paths/0/autorotate", "/paths/0/autorotate"];
    assert_eq!(pointers(&app.post(&path, alone).await), expected);
    let landmarks = json!({"points": {"condylion_left": [50, 10, 0], "condylion_right": [-50, 10, 0]}});
    app.put_json(&format!("{}/landmarks", path.trim_end_matches("/plans")), landmarks).await.ok();
    let made = app.post(&path, body).await.ok();
    let moved = made["paths"][0]["waypoints"][1]["translation_mm"][2].as_f64().unwrap();
    // The origin lies 10 mm before the axis: opening lowers it.
    assert!((moved + 10.0 * 10f64.to_radians().sin()).abs() < 1e-12, "{moved}");
}

/// One motion as a matrix, and as the files that other programs write for it.
#[tokio::test]
async fn a_segment_moves_as_a_matrix_or_a_transform_file_says() {
    let app = TestApp::new().await;
    let (path, osteotomy) = osteotomy(&app).await;
    // A quarter turn about z, then 1.5, -6, -1.25 mm; 3D Slicer shows this matrix and writes its inverse.
    let matrix = json!([[0, -1, 0, 1.5], [1, 0, 0, -6], [0, 0, 1, -1.25], [0, 0, 0, 1]]);
    let slicer = "#Insight Transform File V1.0\n#Transform 0\nTransform: AffineTransform_double_3_3\n\
        Parameters: 0 1 0 -1 0 0 0 0 1 6 1.5 1.25\nFixedParameters: 0 0 0\n";
    let forward = "#Insight Transform File V1.0\n#Transform 0\nTransform: AffineTransform_double_3_3\n\
        Parameters: 0 -1 0 1 0 0 0 0 1 1.5 -6 -1.25\nFixedParameters: 0 0 0\n";
    let file = |text: &str| json!({ "base64": STANDARD.encode(text) });
    let json_file = file(&json!({ "matrix": matrix }).to_string());
    for (motion, notes) in [
        (json!({ "matrix": matrix }), 0),
        (json!({"waypoints": [{"t": 1, "matrix": matrix}]}), 0),
        (json!({"waypoints": [{"t": 0.5, "translation_mm": [0, 1, 0]}, {"t": 1, "transform_file": file(slicer)}]}), 1),
        (json!({ "transform_file": file(slicer) }), 1),
        (json!({"transform_file": {"base64": STANDARD.encode(forward), "direction": "forward"}}), 1),
        (json!({ "transform_file": json_file }), 1),
    ] {
        let mut segment = motion.clone();
        segment["segment"] = json!(1);
        let made = app.post(&path, json!({"osteotomy": osteotomy, "paths": [segment]})).await.ok();
        let last = made["paths"][0]["waypoints"].as_array().unwrap().last().unwrap().clone();
        let numbers =
            |name: &str| last[name].as_array().unwrap().iter().map(|n| n.as_f64().unwrap()).collect::<Vec<_>>();
        let (half, moved) = (0.5f64.sqrt(), [1.5, -6.0, -1.25]);
        assert!(numbers("translation_mm").iter().zip(moved).all(|(a, b)| (a - b).abs() < 1e-12), "{motion}: {last}");
        let turn = numbers("quaternion_xyzw").into_iter().zip([0.0, 0.0, half, half]);
        assert!(turn.into_iter().all(|(a, b)| (a - b).abs() < 1e-12), "{motion}: {last}");
        let count = |plan: &Value| {
            plan["notes"].as_array().map_or(0, |all| all.iter().filter(|n| n["code"] == "transform-file").count())
        };
        assert_eq!(count(&made), notes, "{made}");
        // The note stays when the plan is measured.
        let read = app.get(&format!("{path}/{}", made["id"].as_str().unwrap())).await.ok();
        assert_eq!((count(&read), &read["measured"]), (notes, &json!(true)));
    }
    let refused = async |motion: Value, pointer: &str, words: &str| {
        let mut segment = motion;
        segment["segment"] = json!(1);
        let answer = app.post(&path, json!({"osteotomy": osteotomy, "paths": [segment]})).await;
        let problem = answer.problem(422, "invalid-request");
        let error = &problem["errors"][0];
        assert!(error["pointer"] == pointer && error["detail"].as_str().unwrap().contains(words), "{problem}");
    };
    let with = |row: usize, column: usize, value: f64| {
        let mut changed = matrix.clone();
        changed[row][column] = json!(value);
        json!({ "matrix": changed })
    };
    refused(with(2, 2, -1.0), "/paths/0/matrix", "mirror image").await;
    refused(with(2, 2, 1.02), "/paths/0/matrix", "1.0200").await;
    refused(with(3, 3, 2.0), "/paths/0/matrix", "0 0 0 1").await;
    refused(with(1, 3, 250.0), "/paths/0/matrix", "centroid").await;
    let mut both = json!({ "matrix": matrix });
    both["waypoints"] = json!([{"t": 1, "matrix": matrix}]);
    refused(both, "/paths/0/waypoints", "matrix").await;
    let both = json!({"waypoints": [{"t": 1, "matrix": matrix, "translation_mm": [0, 0, 0]}]});
    refused(both, "/paths/0/waypoints/0/matrix", "another form").await;
    refused(json!({"transform_file": file("solid a")}), "/paths/0/transform_file/base64", "ITK").await;
    let short = json!({"matrix": [[1, 0, 0, 0]]});
    refused(short, "/paths/0/matrix", "list of 4").await;
}

#[tokio::test]
async fn every_fault_of_a_path_is_listed_with_its_pointer() {
    let app = TestApp::new().await;
    let (path, osteotomy) = osteotomy(&app).await;
    let body = json!({"osteotomy": osteotomy, "paths": [
        {"segment": 1, "waypoints": [
            {"t": 0.6, "translation_mm": [0, -3, 0]},
            {"t": 0.4, "translation_mm": [0, -4, 0]},
            {"t": 0.9, "translation_mm": [0, 1e6, 0]},
        ]},
        {"segment": 0, "waypoints": [{"t": 1}]},
        {"segment": 9, "waypoints": []},
        {"segment": 1, "waypoints": [{"t": 1, "rotation": {}}]},
    ]});
    assert_eq!(
        pointers(&app.post(&path, body).await),
        [
            "/paths/0/waypoints/1/t",
            "/paths/0/waypoints/2/translation_mm/1",
            "/paths/0/waypoints/2/t",
            "/paths/1/segment",
            "/paths/1/waypoints/0",
            "/paths/2/segment",
            "/paths/2/waypoints",
            "/paths/3/segment",
            "/paths/3/waypoints/0/rotation",
        ]
    );
    let at_start = json!([{"t": 0, "translation_mm": [0, 1, 0]}, {"t": 1, "translation_mm": [0, 2, 0]}]);
    let body = json!({"osteotomy": osteotomy, "paths": [{"segment": 1, "waypoints": at_start}]});
    let problem = app.post(&path, body).await.problem(422, "plan-not-usable");
    assert_eq!(problem["errors"][0]["pointer"], "/paths/0/waypoints/0");
    let unknown = json!({"osteotomy": "00000000-0000-0000-0000-000000000000", "paths": []});
    assert_eq!(pointers(&app.post(&path, unknown).await), ["/osteotomy"]);
}

#[tokio::test]
async fn a_plan_for_a_stale_osteotomy_is_refused() {
    let app = TestApp::new().await;
    let (plans, osteotomy) = osteotomy(&app).await;
    let session = plans.trim_end_matches("/plans");
    app.put_json(&format!("{session}/field/settings"), json!({"spacing_mm": 2})).await.ok();
    let waypoints = json!([{"t": 1, "translation_mm": [0, -1, 0]}]);
    let body = json!({"osteotomy": osteotomy, "paths": [{"segment": 1, "waypoints": waypoints}]});
    let problem = app.post(&plans, body).await.problem(409, "stale");
    assert_eq!(problem["stale"], "osteotomy");
    let path = format!("{session}/osteotomies/{}", osteotomy.as_str().unwrap());
    assert_eq!(app.get(&path).await.ok()["stale"], true);
}

#[test]
fn the_binary_refuses_unusable_cuts_paths_and_jobs() {
    let directory = tempfile::tempdir().unwrap();
    let server = Server::start(directory.path(), &[]);
    let empty = server.session();
    let no_plan = json!({ "plan": "00000000-0000-0000-0000-000000000000" });
    server.post(&format!("{empty}/jobs"), &no_plan).refused(409, "missing-input", "skin and skull");

    let session = server.session_with_field();
    server.post(&format!("{session}/jobs"), &no_plan).refused(422, "invalid-request", "plan");

    let far = json!({ "cuts": [{ "plane": { "point_mm": [0, 0, 900], "normal": [0, 0, 1] } }] });
    let problem = server.post(&format!("{session}/osteotomies"), &far).refused(422, "cut-misses-bone", "mm");
    assert!(problem["distance_mm"].as_f64().unwrap() > 100.0, "{problem}");
    assert_eq!(problem["errors"][0]["pointer"], "/cuts/0");

    let (osteotomy, jaw) = server.cut(&session);
    let plan = |times: [f64; 2]| {
        let waypoints = times.map(|t| json!({ "t": t, "translation_mm": [0, -t, 0] }));
        json!({ "osteotomy": osteotomy, "paths": [{ "segment": jaw, "waypoints": waypoints }] })
    };
    for times in [[0.7, 0.3], [0.5, 0.5]] {
        let problem = server.post(&format!("{session}/plans"), &plan(times)).json();
        let pointer = problem["errors"][0]["pointer"].as_str().unwrap_or_default();
        assert!(problem["status"] == 422 && pointer.starts_with("/paths/0/waypoints/1"), "{problem}");
    }
    server.post(&format!("{session}/plans"), &plan([0.3, 1.0])).ok();
}
