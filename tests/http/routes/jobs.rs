use std::process::Command;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use axum::http::StatusCode;
use prosopon_geometry::Warning;
use prosopon_tissue::fem::material::{Material, Materials};
use prosopon_tissue::fem::{Locking, Model, SkinElement, SolveSettings, UnstableMaterial};
use serde_json::{Value, json};

use super::mesh_choice::operation;
use crate::support::app::{TestApp, pointers, warnings_of};
use crate::support::binary::{Server, serve};
use crate::support::shapes::{cube, skin, stl};
use crate::support::tissue_mesh::slab;

#[tokio::test]
async fn a_running_job_reports_its_progress_and_residuals() {
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
    let entries =
        events.lines().filter_map(|l| serde_json::from_str::<serde_json::Value>(l.strip_prefix("data: ")?).ok());
    assert!(entries.filter_map(|data| data["progress"].as_f64()).all(|share| share < 1.0));
}

#[tokio::test]
async fn missing_inputs_are_listed() {
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
async fn invalid_members_are_refused_with_their_pointer() {
    let app = TestApp::new().await;
    let (session, plan) = app.session_with_plan().await;
    let path = format!("{session}/jobs");
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
    for (budget, pointer) in [
        (json!({}), "/budget"),
        (json!({"max_error_mm": 0}), "/budget/max_error_mm"),
        (json!({"max_wall_s": 0.5}), "/budget/max_wall_s"),
        (json!({"max_wall_s": 1e9}), "/budget/max_wall_s"),
    ] {
        check(json!({"plan": plan, "budget": budget}), pointer).await;
    }
    let budget = json!({"max_error_mm": 0.5});
    check(json!({"plan": plan, "model": "linear", "budget": budget}), "/budget").await;
    check(json!({"plan": plan, "locking": "smoothed", "budget": budget}), "/budget").await;
    check(json!({"plan": plan, "skin_element": "c1_prism", "budget": budget}), "/skin_element").await;
    // The skull is a box of eight vertices.
    let painted = |n: usize| json!({"plan": plan, "attachment": {"skull_classes": vec!["tied"; n]}});
    check(painted(7), "/attachment/skull_classes").await;
    check(painted(9), "/attachment/skull_classes").await;
    assert_eq!(app.post(&path, painted(8)).await.status, StatusCode::ACCEPTED);
    check(json!({}), "").await;
}

#[tokio::test]
async fn a_material_of_a_tissue_that_the_mesh_lacks_is_warned_of() {
    let app = TestApp::new().await;
    let (session, plan) = app.session_with_plan().await;
    let cartilage = json!({"law": "neo_hookean", "shear_modulus_mpa": 0.3, "poisson": 0.45});
    let job = app.solve(&session, &plan, json!({"model": "nonlinear", "materials": {"cartilage": cartilage}})).await;
    let warnings = warnings_of(&app.ended(&job).await.ok());
    assert!(warnings.iter().any(|w| w.starts_with("materials.cartilage was not used")), "{warnings:?}");
}

#[tokio::test]
async fn a_warning_of_a_step_is_listed_once_in_job_events_and_report() {
    let app = TestApp::new().await;
    let (session, plan) = app.session_with_plan().await;
    *app.stand_in.step_warning.lock().unwrap() = Some(Warning::unreliable("inside-out", "3 elements are inside out"));
    app.stand_in.hold_after(1);
    let job = app.solve(&session, &plan, json!({"model": "linear", "steps": 2})).await;
    app.until_step(&job, 1).await;
    let warning = |k: u32| format!("step {k}: 3 elements are inside out");
    assert_eq!(warnings_of(&app.get(&job).await.ok()), [warning(1)], "while it runs");
    app.stand_in.release();
    let ended = app.ended(&job).await.ok();
    assert_eq!(warnings_of(&ended), [warning(1), warning(2), "a stand-in".to_owned()]);
    let events = app.call(axum::http::Method::GET, &format!("{job}/events"), &[], axum::body::Body::empty()).await;
    let events = String::from_utf8(events.body.to_vec()).unwrap();
    assert_eq!((events.matches(&warning(1)).count(), events.matches("a stand-in").count()), (1, 1), "{events}");
    let report = app.get(&format!("{job}/report")).await.ok();
    let warnings = warnings_of(&report);
    assert_eq!(warnings.iter().filter(|w| w.contains("inside out")).count(), 2, "{warnings:?}");
}

#[tokio::test]
async fn a_panic_or_refusal_of_the_numerics_fails_only_its_job() {
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
async fn a_cancelled_job_stops_within_two_seconds() {
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

/// The job ends for its client; the next one waits until the processors are free.
#[tokio::test]
async fn a_cancelled_job_ends_although_its_computation_does_not_see_it() {
    let app = TestApp::new().await;
    let (session, plan) = app.session_with_plan().await;
    app.stand_in.hold_after(2);
    app.stand_in.is_deaf.store(true, Ordering::SeqCst);
    let job = app.solve(&session, &plan, json!({})).await;
    let next = app.solve(&session, &plan, json!({"steps": 5})).await;
    app.until_step(&job, 2).await;
    app.post(&format!("{job}/cancel"), json!({})).await.ok();
    let ended = app.ended(&job).await.ok();
    assert_eq!((&ended["status"], &ended["step"]), (&json!("cancelled"), &json!(2)));
    let events = app.get(&format!("{job}/events")).await;
    assert!(String::from_utf8_lossy(&events.body).contains("event: end"), "{:?}", events.body);
    assert_eq!(app.stand_in.solves.load(Ordering::SeqCst), 1);
    assert_eq!(app.get(&next.to_string()).await.ok()["status"], "accepted");
    app.post(&format!("{job}/cancel"), json!({})).await.problem(409, "wrong-state");

    app.stand_in.is_deaf.store(false, Ordering::SeqCst);
    app.stand_in.release();
    assert_eq!(app.ended(&next).await.ok()["status"], "succeeded");
    let view = app.get(&job.to_string()).await.ok();
    assert_eq!((&view["status"], &view["step"]), (&json!("cancelled"), &json!(2)), "nothing is added later");
}

#[tokio::test]
async fn a_long_poll_ends_with_the_job_or_after_its_time() {
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
async fn a_waiting_job_whose_inputs_are_replaced_fails_as_stale() {
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

#[tokio::test]
async fn every_model_element_and_material_is_solved() {
    let app = TestApp::new().await;
    let (session, plan) = app.session_with_plan().await;
    let solved = async |more: Value| {
        let before = app.stand_in.solves.load(Ordering::SeqCst);
        let mut body = json!({"plan": plan, "steps": 1});
        more.as_object().unwrap().iter().for_each(|(k, v)| body[k] = v.clone());
        let job = app.finish(app.post(&format!("{session}/jobs"), body).await).await;
        assert_eq!(job["status"], "succeeded", "{job}");
        assert_eq!(app.stand_in.solves.load(Ordering::SeqCst), before + 1);
        let report = app.get(job["links"]["report"].as_str().unwrap()).await.ok();
        (app.stand_in.settings.lock().unwrap().clone().unwrap(), report)
    };
    let stable = |model| SolveSettings::new(model, Materials::wang2009_stable());
    for (name, model, skin_element) in [
        ("auto", Model::Nonlinear, SkinElement::Tetrahedron),
        ("linear", Model::Linear, SkinElement::Wedge),
        ("mass_tensor", Model::MassTensor, SkinElement::Wedge),
        ("nonlinear", Model::Nonlinear, SkinElement::Tetrahedron),
        ("mixed", Model::Mixed, SkinElement::C1Prism),
    ] {
        let (settings, report) = solved(json!({"model": name})).await;
        assert_eq!(settings, SolveSettings { skin_element, ..stable(model) });
        assert_eq!(report["model"], if name == "auto" { "nonlinear" } else { name });
    }
    let (settings, report) = solved(json!({
        "model": "nonlinear", "skin_element": "wedge", "locking": "smoothed", "preset": "wang_2009",
        "d1_reading": "per_mpa", "relative_residual": 1e-6, "penetration_tolerance_mm": 0.01,
        "unstable_material": "stabilise",
        "materials": {"fat": {"law": "ogden", "shear_modulus_mpa": 0.01, "alpha": 4, "poisson": 0.45}}
    }))
    .await;
    let mut materials = Materials::wang2009_reading(prosopon_tissue::fem::material::D1Reading::PerMpa);
    materials.fat = Material::ogden(0.01, 4.0, 0.45);
    let expected = SolveSettings {
        skin_element: SkinElement::Wedge,
        locking: Locking::Smoothed,
        materials,
        relative_residual: 1e-6,
        penetration_tolerance_mm: 0.01,
        unstable_material: UnstableMaterial::Stabilise,
        ..stable(Model::Nonlinear)
    };
    assert_eq!(settings, expected);
    let parameters = &report["parameters"];
    assert_eq!((&parameters["preset"], &parameters["d1_reading"]), (&json!("wang_2009"), &json!("per_mpa")));
    assert_eq!(parameters["materials"]["fat"]["alpha"], 4.0);
    assert_eq!((&parameters["skin_element"], &parameters["locking"]), (&json!("wedge"), &json!("smoothed")));

    for (more, pointer) in [
        (json!({"skin_element": "hex"}), "/skin_element"),
        (json!({"locking": "magic"}), "/locking"),
        (json!({"unstable_material": "hope"}), "/unstable_material"),
        (json!({"preset": "wang_2010"}), "/preset"),
        (json!({"d1_reading": "per_mpa"}), "/d1_reading"),
        (json!({"relative_residual": 1}), "/relative_residual"),
        (json!({"penetration_tolerance_mm": 0}), "/penetration_tolerance_mm"),
        (json!({"materials": {"bone": {}}}), "/materials/bone"),
        (
            json!({"materials": {"fat": {"law": "neo_hookean", "shear_modulus_mpa": 1, "poisson": 0.5}}}),
            "/materials/fat/poisson",
        ),
    ] {
        let mut body = json!({"plan": plan});
        more.as_object().unwrap().iter().for_each(|(k, v)| body[k] = v.clone());
        let problem = app.post(&format!("{session}/jobs"), body).await.problem(422, "invalid-request");
        assert_eq!(problem["errors"][0]["pointer"], pointer, "{problem}");
    }
}

#[tokio::test]
async fn a_reference_job_with_another_plan_is_refused() {
    let app = TestApp::new().await;
    let session = app.session_with_field().await;
    let (_, chin_plan) = operation(&app, &session, -20.0).await;
    let (_, maxilla_plan) = operation(&app, &session, 10.0).await;
    let reference = app.solve(&session, &chin_plan, json!({"steps": 1})).await;
    let reference = app.ended(&reference).await.ok()["id"].clone();
    let solves = app.stand_in.solves.load(Ordering::SeqCst);
    let body = json!({"plan": maxilla_plan, "reference_job": reference});
    let problem = app.post(&format!("{session}/jobs"), body).await.problem(409, "wrong-state");
    for plan in [&chin_plan, &maxilla_plan] {
        assert!(problem["detail"].as_str().unwrap().contains(plan.as_str()), "{problem}");
    }
    assert_eq!(app.stand_in.solves.load(Ordering::SeqCst), solves);
    let body = json!({"plan": chin_plan, "reference_job": reference});
    assert_eq!(app.post(&format!("{session}/jobs"), body).await.status, StatusCode::ACCEPTED);
}

/// A process whose memory limit leaves nothing for a solve refuses the job and keeps running.
/// A limit of the process (`ulimit -v`) that is nearer than the memory of the machine; beyond it, an allocation ends the process.
#[cfg(target_os = "linux")]
#[test]
fn a_job_beyond_the_address_space_is_refused() {
    let directory = tempfile::tempdir().unwrap();
    let server = Server::start(directory.path(), &[]);
    let session = server.session();
    server.upload(&format!("{session}/tissue"), &slab(1.0)).ok();
    let paths = json!([{"segment": 1, "waypoints": [{"t": 1, "translation_mm": [0.5, 0, 2]}]}]);
    let plan = server.post(&format!("{session}/plans"), &json!({"paths": paths})).ok()["id"].clone();
    let pid = server.child.id();
    let status = std::fs::read_to_string(format!("/proc/{pid}/status")).unwrap();
    let mapped = status.lines().find_map(|line| line.strip_prefix("VmSize:")).unwrap();
    let mapped_kb: u64 = mapped.trim().trim_end_matches(" kB").parse().unwrap();
    // 256 MB are kept for stacks and heaps, and nearly nothing is left for the job.
    let limit = (mapped_kb << 10) + (260 << 20);
    let set = Command::new("prlimit").args(["--pid", &pid.to_string(), &format!("--as={limit}")]).status();
    assert!(set.expect("prlimit (util-linux) is there").success());
    let ended = server.end(&server.post(&format!("{session}/jobs"), &json!({"plan": plan, "model": "linear"})));
    let problem = &ended["problem"];
    assert_eq!(
        (&ended["status"], &problem["type"]),
        (&json!("failed"), &json!("/problems/not-enough-memory")),
        "{ended}"
    );
    assert!(problem["allowed_mb"].as_f64().unwrap() < 30.0, "{problem}");
    assert_eq!(server.get("/readyz").status, 200);
}

#[test]
fn a_job_beyond_the_memory_limit_is_refused() {
    let directory = tempfile::tempdir().unwrap();
    let mut command = serve(directory.path(), "127.0.0.1:0");
    command.env("PROSOPON_MEMORY_MB", "1");
    let server = Server::spawn(command);
    let session = server.session();
    server.upload(&format!("{session}/tissue"), &slab(1.0)).ok();
    let paths = json!([{"segment": 1, "waypoints": [{"t": 1, "translation_mm": [0.5, 0, 2]}]}]);
    let plan = server.post(&format!("{session}/plans"), &json!({"paths": paths})).ok()["id"].clone();
    let ended = server.end(&server.post(&format!("{session}/jobs"), &json!({"plan": plan, "model": "linear"})));
    let problem = &ended["problem"];
    assert_eq!(
        (&ended["status"], &problem["type"]),
        (&json!("failed"), &json!("/problems/not-enough-memory")),
        "{ended}"
    );
    assert!(problem["needed_mb"].as_f64().unwrap() > 30.0 && problem["allowed_mb"] == 0.0, "{problem}");
    assert!(problem["detail"].as_str().unwrap().contains("would fit"), "{problem}");
    assert_eq!(server.get("/readyz").status, 200);
}

#[tokio::test]
async fn a_solve_can_bring_its_plan_and_replace_what_waits() {
    let app = TestApp::new().await;
    let session = app.session_with_field().await;
    app.plan(&session).await;
    let osteotomy = app.get(&format!("{session}/osteotomies")).await.ok()["osteotomies"][0]["id"].clone();
    let path = format!("{session}/jobs");
    let moved = |mm: f64| json!({"osteotomy": osteotomy, "paths": [{"segment": 1, "waypoints": [{"t": 1, "translation_mm": [0, mm, 0]}]}]});
    let plans = async || app.get(&format!("{session}/plans")).await.ok()["plans"].as_array().unwrap().len();
    let refused =
        app.post(&path, json!({"plan": {"osteotomy": osteotomy, "paths": [{"segment": 7, "waypoints": []}]}})).await;
    assert!(pointers(&refused).iter().all(|p| p.starts_with("/plan/paths/0/")), "{refused:?}");
    let nowhere = app.post(&path, json!({"plan": {"osteotomy": osteotomy, "paths": []}})).await;
    assert!(nowhere.json()["detail"].as_str().unwrap().starts_with("/plan/paths"), "{nowhere:?}");
    assert_eq!(pointers(&app.post(&path, json!({"plan": {"pathes": []}})).await), ["/plan/pathes", "/plan"]);
    assert_eq!(pointers(&app.post(&path, json!({"plan": "x"})).await), ["/plan"]);
    assert_eq!(pointers(&app.post(&path, json!({"plan": moved(-1.0), "supersede": "all"})).await), ["/supersede"]);
    assert_eq!(pointers(&app.post(&path, json!({"plan": moved(-1.0), "supersede": true})).await), ["/supersede"]);
    assert_eq!(plans().await, 1);

    // While one runs, the positions of a slider replace each other.
    app.stand_in.hold_after(1);
    let running = app.post(&path, json!({"plan": moved(-1.0), "supersede": "session"})).await;
    assert_eq!(running.status, StatusCode::ACCEPTED);
    let running = running.header("location").to_owned();
    app.until_step(&running, 1).await;
    let mut waiting = Vec::new();
    for mm in [-2.0, -3.0] {
        let job = app.post(&path, json!({"plan": moved(mm), "supersede": "session"})).await;
        waiting.push(job.header("location").to_owned());
        assert!(
            app.get(&format!("{session}/plans/{}", job.json()["plan"].as_str().unwrap())).await.status.is_success()
        );
    }
    assert_eq!(app.get(&waiting[0]).await.ok()["status"], "cancelled");
    app.stand_in.release();
    assert_eq!(app.ended(&waiting[1]).await.ok()["status"], "succeeded");
    assert_eq!(app.ended(&running).await.ok()["status"], "succeeded");
    assert_eq!(plans().await, 4);
    // A plan that the session has is not stored again.
    let again = app.post(&path, json!({"plan": moved(-3.0), "steps": 2})).await;
    assert_eq!(again.json()["plan"], app.get(&waiting[1]).await.ok()["plan"]);
    assert_eq!(plans().await, 4);
}
