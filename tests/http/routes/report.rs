use serde_json::json;

use crate::support::app::{TestApp, warnings_of};

#[tokio::test]
async fn a_finished_solve_has_a_report() {
    let app = TestApp::new().await;
    let (session, plan) = app.session_with_plan().await;
    let body = json!({"plan": plan, "model": "mixed", "steps": 3, "outputs": ["skin", "tissue"]});
    let accepted = app.post(&format!("{session}/jobs"), body).await;
    assert_eq!(accepted.json()["status"], "accepted");
    let job = app.finish(accepted).await;
    assert_eq!((&job["status"], &job["progress"], &job["step"]), (&json!("succeeded"), &json!(1.0), &json!(3)));
    assert_eq!(warnings_of(&job), ["a stand-in"]);
    let report = app.get(job["links"]["report"].as_str().unwrap()).await.ok();
    assert_eq!((&report["model"], &report["version"]), (&json!("mixed"), &json!(env!("CARGO_PKG_VERSION"))));
    assert_eq!(report["regions"]["upper_lip"]["forward_mm"], 6.0);
    assert_eq!(report["mesh"]["tetrahedra"], 60_000);
    assert_eq!(report["steps"][2]["newton_iterations"], 4);
    assert_eq!(report["steps"][2]["converged"], true);
    assert_eq!(report["inputs"]["skin"]["sha256"].as_str().unwrap().len(), 64);
    for phase in ["surfaces_s", "field_s", "cut_s", "mesh_s", "solve_s", "total_s"] {
        assert!(report["phases"][phase].as_f64().unwrap() >= 0.0, "{phase}");
    }
    assert_eq!(warnings_of(&report), ["a stand-in", "the skull has crumbs", "a wide gap", "thin over the nose"]);
    assert_eq!(app.get(job["links"]["tissue"].as_str().unwrap()).await.body.as_ref(), b"<VTKFile/>");
    let listed = app.get(&format!("/v1/jobs?session={}&status=succeeded", job["session"].as_str().unwrap())).await.ok();
    let kinds: Vec<&str> = listed["jobs"].as_array().unwrap().iter().map(|j| j["kind"].as_str().unwrap()).collect();
    assert_eq!(kinds, ["solve", "mesh", "field"]);
}

#[tokio::test]
async fn a_job_that_is_no_solve_has_no_report() {
    let app = TestApp::new().await;
    let session = app.session_with_surfaces().await;
    let field = app.post(&format!("{session}/field"), json!({})).await.header("location").to_owned();
    app.ended(&field).await.ok();
    let problem = app.get(&format!("{field}/report")).await.problem(404, "not-found");
    assert!(problem["detail"].as_str().unwrap().contains("field"), "{problem}");
}
