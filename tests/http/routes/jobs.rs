use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use axum::http::StatusCode;
use serde_json::json;

use crate::support::app::TestApp;
use crate::support::shapes::{cube, skin, stl};

#[tokio::test]
async fn a_solve_goes_its_way_and_leaves_a_report() {
    let app = TestApp::new().await;
    let (session, plan) = app.session_with_plan().await;
    let body = json!({"plan": plan, "model": "mixed", "steps": 3, "outputs": ["skin", "tissue"]});
    let accepted = app.post(&format!("{session}/jobs"), body).await;
    assert_eq!(accepted.json()["status"], "accepted");
    let job = app.finish(accepted).await;
    assert_eq!((&job["status"], &job["progress"], &job["step"]), (&json!("succeeded"), &json!(1.0), &json!(3)));
    assert_eq!(job["warnings"], json!(["a stand-in"]));
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
    assert_eq!(report["warnings"], json!(["a stand-in", "the skull has crumbs", "a wide gap", "thin over the nose"]));
    assert_eq!(app.get(job["links"]["tissue"].as_str().unwrap()).await.body.as_ref(), b"<VTKFile/>");
    let listed = app.get(&format!("/v1/jobs?session={}&status=succeeded", job["session"].as_str().unwrap())).await.ok();
    let kinds: Vec<&str> = listed["jobs"].as_array().unwrap().iter().map(|j| j["kind"].as_str().unwrap()).collect();
    assert_eq!(kinds, ["solve", "mesh", "field"]);
}

#[tokio::test]
async fn progress_is_that_of_the_path_and_residuals_are_those_of_its_steps() {
    let app = TestApp::new().await;
    let (session, plan) = app.session_with_plan().await;
    app.upload(&format!("{session}/target"), skin()).await.ok();
    app.stand_in.hold_after(2);
    let job = app.solve(&session, &plan, json!({"steps": 4})).await;
    app.until_step(&job, 2).await;
    let view = app.get(&job).await.ok();
    // The step is at half of the path; the comparisons of two steps with the target moved nothing.
    let progress = view["progress"].as_f64().unwrap();
    assert!((0.4..0.5).contains(&progress), "{view}");
    assert_eq!((&view["step"], &view["steps"], &view["phase"]), (&json!(2), &json!(4), &json!("solve")));
    assert!(view["eta_s"].as_f64().unwrap() >= 0.0);
    assert_eq!(view["residuals"], json!([1e-6, 1e-6]));
    app.stand_in.release();
    let ended = app.ended(&job).await.ok();
    assert_eq!((&ended["progress"], ended["residuals"].as_array().unwrap().len()), (&json!(1.0), 4));
    let events = app.call(axum::http::Method::GET, &format!("{job}/events"), &[], axum::body::Body::empty()).await;
    let events = String::from_utf8(events.body.to_vec()).unwrap();
    let told = events.lines().filter_map(|l| serde_json::from_str::<serde_json::Value>(l.strip_prefix("data: ")?).ok());
    assert!(told.filter_map(|data| data["progress"].as_f64()).all(|share| share < 1.0));
}

#[tokio::test]
async fn what_a_job_lacks_is_named() {
    let app = TestApp::new().await;
    let nil = json!({"plan": "00000000-0000-0000-0000-000000000000"});
    let empty = app.session().await;
    let problem = app.post(&format!("{empty}/jobs"), nil.clone()).await.problem(409, "missing-input");
    assert_eq!(problem["missing"], json!(["skin", "skull"]));
    let problem = app.post(&format!("{empty}/field"), json!({})).await.problem(409, "missing-input");
    assert_eq!(problem["missing"], json!(["skin", "skull"]));
    let session = app.session_with_surfaces().await;
    let problem = app.post(&format!("{session}/mesh"), json!({})).await.problem(409, "missing-input");
    assert_eq!(problem["missing"], json!(["field"]));
    let problem = app.post(&format!("{session}/jobs"), nil).await.problem(409, "missing-input");
    assert_eq!(problem["missing"], json!(["field"]));
    assert!(problem["detail"].as_str().unwrap().contains("/field first"));
}

#[tokio::test]
async fn what_a_job_asks_for_is_checked() {
    let app = TestApp::new().await;
    let (session, plan) = app.session_with_plan().await;
    let path = format!("{session}/jobs");
    app.post(&path, json!({"plan": plan, "budget": {"max_wall_s": 10}})).await.problem(422, "not-available");
    let check = async |body, pointer| {
        let problem = app.post(&path, body).await.problem(422, "invalid-request");
        assert_eq!(problem["errors"][0]["pointer"], pointer, "{problem}");
    };
    check(json!({"plan": plan, "model": "quick"}), "/model").await;
    check(json!({"plan": plan, "steps": 0}), "/steps").await;
    check(json!({"plan": plan, "steps": 1000}), "/steps").await;
    check(json!({"plan": plan, "outputs": ["skin", "soul"]}), "/outputs/1").await;
    check(json!({"plan": plan, "reference_job": plan}), "/reference_job").await;
    check(json!({"plan": session.rsplit('/').next().unwrap()}), "/plan").await;
    check(json!({"plan": plan, "attachment": {"tie_gap_mm": -1}}), "/attachment/tie_gap_mm").await;
    check(json!({"plan": plan, "speed": 1}), "/speed").await;
    // The skull is a box of eight vertices.
    let painted = |n: usize| json!({"plan": plan, "attachment": {"skull_classes": vec!["tied"; n]}});
    check(painted(7), "/attachment/skull_classes").await;
    check(painted(9), "/attachment/skull_classes").await;
    assert_eq!(app.post(&path, painted(8)).await.status, StatusCode::ACCEPTED);
    check(json!({}), "").await;
}

#[tokio::test]
async fn what_a_step_warns_of_the_job_tells_once_and_the_report_too() {
    let app = TestApp::new().await;
    let (session, plan) = app.session_with_plan().await;
    *app.stand_in.step_warning.lock().unwrap() = Some("3 elements are inside out".to_owned());
    app.stand_in.hold_after(1);
    let job = app.solve(&session, &plan, json!({"model": "linear", "steps": 2})).await;
    app.until_step(&job, 1).await;
    let told = |k: u32| format!("step {k}: 3 elements are inside out");
    assert_eq!(app.get(&job).await.ok()["warnings"], json!([told(1)]), "while it runs");
    app.stand_in.release();
    let ended = app.ended(&job).await.ok();
    assert_eq!(ended["warnings"], json!([told(1), told(2), "a stand-in"]));
    let events = app.call(axum::http::Method::GET, &format!("{job}/events"), &[], axum::body::Body::empty()).await;
    let events = String::from_utf8(events.body.to_vec()).unwrap();
    assert_eq!((events.matches(&told(1)).count(), events.matches("a stand-in").count()), (1, 1), "{events}");
    let report = app.get(&format!("{job}/report")).await.ok();
    let warnings: Vec<&str> = report["warnings"].as_array().unwrap().iter().map(|w| w.as_str().unwrap()).collect();
    assert_eq!(warnings.iter().filter(|w| w.contains("inside out")).count(), 2, "{warnings:?}");
}

#[tokio::test]
async fn a_panic_or_refusal_of_the_numerics_fails_the_job_and_the_service_goes_on() {
    let app = TestApp::new().await;
    let (session, plan) = app.session_with_plan().await;
    app.stand_in.panics.store(true, Ordering::SeqCst);
    let job = app.ended(&app.solve(&session, &plan, json!({})).await).await.ok();
    assert_eq!((&job["status"], &job["problem"]["type"]), (&json!("failed"), &json!("/problems/internal")));
    assert!(!job["problem"]["detail"].as_str().unwrap().contains("planted"), "nothing of the inside leaks");

    app.stand_in.panics.store(false, Ordering::SeqCst);
    app.stand_in.fails_after.store(2, Ordering::SeqCst);
    let job = app.ended(&app.solve(&session, &plan, json!({})).await).await.ok();
    assert_eq!(job["problem"]["type"], "/problems/solver-not-converged");
    assert_eq!(job["problem"]["residual_n"], 0.4);
    assert_eq!((&job["step"], &job["phase"]), (&json!(2), &json!("solve")), "steps before stay");
    let own = job["links"]["self"].as_str().unwrap();
    assert_eq!(app.get(&format!("{own}/steps/2/frame")).await.status, StatusCode::OK);
    app.get(&format!("{own}/report")).await.problem(404, "not-ready");
    app.get(&format!("{own}/steps/3/frame")).await.problem(404, "not-ready");
    app.get(&format!("{own}/steps/7/frame")).await.problem(404, "not-found");

    app.stand_in.fails_after.store(0, Ordering::SeqCst);
    let job = app.ended(&app.solve(&session, &plan, json!({})).await).await.ok();
    assert_eq!(job["status"], "succeeded");
}

#[tokio::test]
async fn one_job_runs_and_the_others_wait_in_line() {
    let app = TestApp::with(|config| config.service.max_waiting = 2).await;
    let (session, plan) = app.session_with_plan().await;
    app.stand_in.hold_after(1);
    let first = app.solve(&session, &plan, json!({})).await;
    app.until_step(&first, 1).await;
    let second = app.solve(&session, &plan, json!({"steps": 2})).await;
    let body = json!({"plan": plan, "steps": 3});
    let accepted = app.post_keyed(&format!("{session}/jobs"), "third", body.clone()).await;
    assert_eq!(accepted.ok()["queue_position"], 2, "told with the 202");
    let replayed = app.post_keyed(&format!("{session}/jobs"), "third", body).await;
    assert_eq!(replayed.json(), accepted.json());
    let third = accepted.header("location").to_owned();
    assert_eq!(app.post(&format!("{session}/jobs"), json!({"plan": plan, "steps": 3})).await.ok()["queue_position"], 2);
    assert_eq!(app.get(&second).await.ok()["queue_position"], 1);
    assert_eq!(app.get(&third).await.ok()["queue_position"], 2);
    let full = app.post(&format!("{session}/jobs"), json!({"plan": plan, "steps": 4})).await;
    full.problem(503, "queue-full");
    assert_eq!(full.header("retry-after"), "10");
    app.stand_in.release();
    for job in [first, second, third] {
        assert_eq!(app.ended(&job).await.ok()["status"], "succeeded");
    }
    assert_eq!(app.stand_in.solves.load(Ordering::SeqCst), 3);
}

#[tokio::test]
async fn a_job_that_is_asked_for_again_is_the_one_that_is_there() {
    let app = TestApp::new().await;
    let (session, plan) = app.session_with_plan().await;
    app.stand_in.hold_after(1);
    let running = app.solve(&session, &plan, json!({})).await;
    app.until_step(&running, 1).await;
    assert_eq!(app.solve(&session, &plan, json!({})).await, running);
    assert_ne!(app.solve(&session, &plan, json!({"steps": 5})).await, running);

    let path = format!("{session}/field");
    let (field, twin) = tokio::join!(app.post(&path, json!({})), app.post(&path, json!({})));
    assert_eq!((twin.status, twin.header("location")), (StatusCode::ACCEPTED, field.header("location")));
    assert_eq!(twin.json()["id"], field.json()["id"]);
    let keyed = app.post_keyed(&path, "k", json!({})).await;
    assert_eq!(keyed.header("location"), field.header("location"));
    app.put_json(&format!("{path}/settings"), json!({"spacing_mm": 3})).await.ok();
    assert_ne!(app.post(&path, json!({})).await.header("location"), field.header("location"), "other settings");
    assert_eq!(app.post_keyed(&path, "k", json!({})).await.header("location"), field.header("location"));
    app.put_json(&format!("{path}/settings"), json!({})).await.ok();

    // The comparison would use another surface.
    app.upload(&format!("{session}/target"), skin()).await.ok();
    assert_ne!(app.solve(&session, &plan, json!({})).await, running);
    app.post(&format!("{running}/cancel"), json!({})).await.ok();
    let after = app.solve(&session, &plan, json!({})).await;
    assert_ne!(after, running, "one that is about to end is no answer");
    app.stand_in.release();
    assert_eq!(app.ended(&after).await.ok()["status"], "succeeded");
    assert_ne!(app.solve(&session, &plan, json!({})).await, after, "one that has ended neither");
}

#[tokio::test]
async fn a_cancelled_job_stops_at_once_and_only_once() {
    let app = TestApp::new().await;
    let (session, plan) = app.session_with_plan().await;
    app.stand_in.hold_after(2);
    let running = app.solve(&session, &plan, json!({})).await;
    let waiting = app.solve(&session, &plan, json!({"steps": 5})).await;
    app.until_step(&running, 2).await;

    let answer = app.post(&format!("{waiting}/cancel"), json!({})).await;
    assert_eq!((answer.status, &answer.json()["status"]), (StatusCode::ACCEPTED, &json!("cancelled")));
    let asked = Instant::now();
    app.post(&format!("{running}/cancel"), json!({})).await.ok();
    let ended = app.ended(&running).await.ok();
    assert!(asked.elapsed() < Duration::from_secs(2));
    assert_eq!((&ended["status"], &ended["step"]), (&json!("cancelled"), &json!(2)));
    assert_eq!(ended["phase"], "solve", "where it was stopped");
    let again = app.post(&format!("{running}/cancel"), json!({})).await.problem(409, "wrong-state");
    assert_eq!(again["job_status"], "cancelled");
    assert_eq!(app.get(&format!("{running}/steps/1/skin")).await.status, StatusCode::OK);
}

#[tokio::test]
async fn a_long_poll_answers_when_the_job_ends_or_the_time_is_up() {
    let app = TestApp::new().await;
    let (session, plan) = app.session_with_plan().await;
    app.stand_in.hold_after(0);
    let job = app.solve(&session, &plan, json!({})).await;
    let asked = Instant::now();
    let state = app.get(&format!("{job}?wait_s=0.2")).await.ok()["status"].clone();
    assert!(asked.elapsed() >= Duration::from_millis(200) && state != "succeeded");
    let release = async {
        tokio::time::sleep(Duration::from_millis(50)).await;
        app.stand_in.release();
    };
    let path = format!("{job}?wait_s=30");
    let (answer, ()) = tokio::join!(app.get(&path), release);
    assert_eq!(answer.ok()["status"], "succeeded");
    assert!(asked.elapsed() < Duration::from_secs(10));
    app.get(&format!("{job}?wait_s=1000")).await.problem(400, "malformed-request");
    app.get("/v1/jobs/00000000-0000-0000-0000-000000000000").await.problem(404, "not-found");
    app.get("/v1/jobs/nonsense").await.problem(404, "not-found");
}

#[tokio::test]
async fn a_job_whose_inputs_were_replaced_while_it_waited_says_so() {
    let app = TestApp::new().await;
    let (session, plan) = app.session_with_plan().await;
    app.stand_in.hold_after(0);
    let first = app.solve(&session, &plan, json!({})).await;
    let second = app.solve(&session, &plan, json!({"steps": 5})).await;
    while app.get(&first).await.ok()["phase"] != "solve" {
        tokio::time::sleep(Duration::from_millis(5)).await;
    }
    app.upload(&format!("{session}/skin"), stl(&cube([1.0; 3], 90.0))).await.ok();
    app.stand_in.release();
    assert_eq!(app.ended(&first).await.ok()["status"], "succeeded", "it has its inputs already");
    let job = app.ended(&second).await.ok();
    assert_eq!(job["problem"]["type"], "/problems/stale");
}
