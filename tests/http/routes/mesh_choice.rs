//! A solve runs on the mesh of its own operation.

use serde_json::{Value, json};

use crate::support::app::TestApp;

/// An osteotomy at the height `z` and a plan on it.
pub(super) async fn operation(app: &TestApp, session: &str, z: f64) -> (Value, String) {
    let cut = json!({"cuts": [{"plane": {"point_mm": [0, 0, z], "normal": [0, 0, 2]}}]});
    let osteotomy = app.post(&format!("{session}/osteotomies"), cut).await.ok()["id"].clone();
    let waypoints = json!([{"t": 1, "translation_mm": [0, -6, -1.5]}]);
    let plan = json!({"osteotomy": osteotomy, "paths": [{"segment": 1, "waypoints": waypoints}]});
    let plan = app.post(&format!("{session}/plans"), plan).await.ok()["id"].as_str().unwrap().to_owned();
    (osteotomy, plan)
}

/// The mesh job's id.
async fn mesh(app: &TestApp, session: &str, body: Value) -> Value {
    let job = app.finish(app.post(&format!("{session}/mesh"), body).await).await;
    assert_eq!(job["status"], "succeeded", "{job}");
    job["id"].clone()
}

/// The report's mesh.
async fn solve(app: &TestApp, session: &str, plan: &str, more: Value) -> Value {
    let job = app.solve(session, plan, more).await;
    assert_eq!(app.ended(&job).await.ok()["status"], "succeeded");
    app.get(&format!("{job}/report")).await.ok()["mesh"].clone()
}

#[tokio::test]
async fn a_solve_uses_or_builds_the_mesh_of_its_osteotomy() {
    let app = TestApp::new().await;
    let session = app.session_with_field().await;
    let (chin, chin_plan) = operation(&app, &session, -20.0).await;
    let (maxilla, maxilla_plan) = operation(&app, &session, 10.0).await;
    // No mesh was requested: the job builds its own with default settings.
    let built = solve(&app, &session, &maxilla_plan, json!({"steps": 1})).await;
    assert_eq!((&built["osteotomy"], &built["settings"]["edge_mm"]), (&maxilla, &json!(4.0)));

    mesh(&app, &session, json!({"osteotomy": chin, "edge_mm": 3})).await;
    let built = solve(&app, &session, &maxilla_plan, json!({"steps": 1})).await;
    assert_eq!((&built["osteotomy"], &built["settings"]["edge_mm"]), (&maxilla, &json!(3.0)));
    let cuts = app.stand_in.meshed_for.lock().unwrap().clone().unwrap();
    assert!(format!("{cuts:?}").contains("10.0"), "{cuts:?}");
    assert!(built["cuts"].is_null(), "surfaces of cuts are not said again");

    // Each operation has its own settings, however often it changes.
    mesh(&app, &session, json!({"osteotomy": maxilla, "edge_mm": 5})).await;
    for (plan, own, edge) in [(&chin_plan, &chin, 3.0), (&maxilla_plan, &maxilla, 5.0), (&chin_plan, &chin, 3.0)] {
        let built = solve(&app, &session, plan, json!({"steps": 1})).await;
        assert_eq!((&built["osteotomy"], &built["settings"]["edge_mm"]), (own, &json!(edge)));
    }
    // A mesh of the front of the face fits every operation.
    mesh(&app, &session, json!({"edge_mm": 6})).await;
    let built = solve(&app, &session, &chin_plan, json!({"steps": 1})).await;
    assert_eq!((&built["osteotomy"], &built["settings"]["edge_mm"]), (&Value::Null, &json!(6.0)));
}

#[tokio::test]
async fn a_named_mesh_must_fit_the_plan_and_the_inputs() {
    let app = TestApp::new().await;
    let session = app.session_with_field().await;
    let (chin, chin_plan) = operation(&app, &session, -20.0).await;
    let (maxilla, maxilla_plan) = operation(&app, &session, 10.0).await;
    let of_chin = mesh(&app, &session, json!({"osteotomy": chin, "edge_mm": 3})).await;
    mesh(&app, &session, json!({"osteotomy": chin, "edge_mm": 5})).await;
    let built = solve(&app, &session, &chin_plan, json!({"steps": 1, "mesh": of_chin})).await;
    assert_eq!(built["settings"]["edge_mm"], 3.0);

    let body = json!({"plan": maxilla_plan, "mesh": of_chin});
    let problem = app.post(&format!("{session}/jobs"), body).await.problem(409, "wrong-state");
    let detail = problem["detail"].as_str().unwrap();
    for osteotomy in [&chin, &maxilla] {
        assert!(detail.contains(osteotomy.as_str().unwrap()), "{detail}");
    }
    assert_eq!(problem["errors"][0]["pointer"], "/mesh");
    let unknown = json!({"plan": maxilla_plan, "mesh": maxilla});
    app.post(&format!("{session}/jobs"), unknown).await.problem(422, "invalid-request");

    app.put_json(&format!("{session}/landmarks"), json!({"points": {"pogonion": [0, -60, -50]}})).await.ok();
    let body = json!({"plan": chin_plan, "mesh": of_chin});
    app.post(&format!("{session}/jobs"), body).await.problem(409, "stale");
}
