//! Results that later jobs of a session reuse from earlier ones, with the real numerics on two boxes.

use serde_json::{Value, json};

use crate::support::app::TestApp;

/// Creates a session with field, osteotomy and a coarse mesh; returns the session and the osteotomy.
async fn scene(app: &TestApp) -> (String, Value) {
    let session = app.session_with_surfaces().await;
    let settings = json!({"method": "uniform", "spacing_mm": 5, "envelope_spacing_mm": 5, "envelope_closing_mm": 10});
    app.put_json(&format!("{session}/field/settings"), settings).await.ok();
    let field = app.finish(app.post(&format!("{session}/field"), json!({})).await).await;
    assert_eq!(field["status"], "succeeded", "{field}");
    let cut = json!({"cuts": [{"plane": {"point_mm": [0, 0, 0], "normal": [0, 0, 1]}}]});
    let osteotomy = app.post(&format!("{session}/osteotomies"), cut).await.ok()["id"].clone();
    let settings = json!({"osteotomy": osteotomy, "edge_mm": 15, "depth_mm": 60, "skin_thickness_mm": 4});
    let mesh = app.finish(app.post(&format!("{session}/mesh"), settings).await).await;
    assert_eq!(mesh["status"], "succeeded", "{mesh}");
    (session, osteotomy)
}

/// Runs a job with a forward movement.
async fn solved(app: &TestApp, session: &str, osteotomy: &Value, forward_mm: f64, more: Value) -> String {
    let waypoints = json!([{"t": 1, "translation_mm": [0, -forward_mm, 0]}]);
    let plan = json!({"osteotomy": osteotomy, "paths": [{"segment": 1, "waypoints": waypoints}]});
    let plan = app.post(&format!("{session}/plans"), plan).await.ok()["id"].as_str().unwrap().to_owned();
    let job = app.solve(session, &plan, more).await;
    let view = app.ended(&job).await.ok();
    assert_eq!(view["status"], "succeeded", "{view}");
    job
}

/// Forces on the bones at each step, with all digits, and the number of factorisations of the first step.
async fn solve(app: &TestApp, session: &str, osteotomy: &Value, forward_mm: f64, more: Value) -> (Vec<Value>, u64) {
    let job = solved(app, session, osteotomy, forward_mm, more).await;
    let report = app.get(&format!("{job}/report")).await.ok();
    let steps = report["steps"].as_array().unwrap();
    (steps.iter().map(|s| s["reactions"].clone()).collect(), steps[0]["factorisations"].as_u64().unwrap())
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_mesh_that_lacks_the_bone_that_moves_is_warned_of() {
    let app = TestApp::real().await;
    let (session, osteotomy) = scene(&app).await;
    let lacking = async |more: Value| {
        let job = solved(&app, &session, &osteotomy, 1.0, more).await;
        let warnings = app.get(&job).await.ok()["warnings"].to_string();
        warnings.contains("lacks").then_some(warnings)
    };
    let linear = json!({"model": "linear", "steps": 1});
    assert_eq!(lacking(linear.clone()).await, None, "its own mesh");
    // The skull is a box from -60 to 60 mm; its lower half moves.
    let region = json!({"min_mm": [-110, -110, -110], "max_mm": [30, 110, 110]});
    let settings = json!({"edge_mm": 15, "depth_mm": 60, "skin_thickness_mm": 4, "region": region});
    let mesh = app.finish(app.post(&format!("{session}/mesh"), settings).await).await;
    assert_eq!(mesh["status"], "succeeded", "{mesh}");
    let warning = lacking(linear).await.unwrap();
    assert!(warning.contains("its region lacks 30 mm on the patient's left of the moving bone"), "{warning}");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_second_job_begins_with_the_factor_of_the_first_and_finds_the_same_bits_as_alone() {
    let linear = json!({"model": "linear", "steps": 2});
    let app = TestApp::real().await;
    let (session, osteotomy) = scene(&app).await;
    let (first, made) = solve(&app, &session, &osteotomy, 3.0, linear.clone()).await;
    // Movements between 2 and 4 mm are in one displacement class: bone is assumed to reach the same tissue.
    let (second, made_again) = solve(&app, &session, &osteotomy, 2.5, linear.clone()).await;
    assert_eq!((made, made_again), (1, 0));
    assert_ne!(first, second);
    // Other materials need another matrix.
    let other = json!({"model": "linear", "steps": 2, "preset": "chabanas_2003"});
    assert_eq!(solve(&app, &session, &osteotomy, 1.5, other).await.1, 1);

    let alone = TestApp::real().await;
    let (session, osteotomy) = scene(&alone).await;
    let (cold, made_alone) = solve(&alone, &session, &osteotomy, 2.5, linear).await;
    assert_eq!(made_alone, 1);
    assert_eq!(cold, second);
}

/// All numbers in the forces on the bones at the last step, N.
async fn forces(app: &TestApp, job: &str) -> Vec<f64> {
    fn numbers(value: &Value) -> Vec<f64> {
        match value {
            Value::Number(n) => n.as_f64().into_iter().collect(),
            Value::Array(values) => values.iter().flat_map(numbers).collect(),
            Value::Object(members) => members.values().flat_map(numbers).collect(),
            Value::Null | Value::Bool(_) | Value::String(_) => Vec::new(),
        }
    }
    let report = app.get(&format!("{job}/report")).await.ok();
    numbers(&report["steps"].as_array().unwrap().last().unwrap()["reactions"])
}

fn farthest(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_job_that_begins_at_the_end_of_another_ends_where_the_way_from_rest_does() {
    let app = TestApp::real().await;
    let (session, osteotomy) = scene(&app).await;
    let rest = |steps: u32| json!({"model": "nonlinear", "skin_element": "wedge", "steps": steps});
    let first = solved(&app, &session, &osteotomy, 3.0, rest(3)).await;
    let id = first.rsplit('/').next().unwrap();
    let warm = |of: &str| json!({"model": "nonlinear", "skin_element": "wedge", "warm_start": of});
    let onwards = solved(&app, &session, &osteotomy, 2.0, warm(id)).await;
    let from_rest = solved(&app, &session, &osteotomy, 2.0, rest(2)).await;
    let report = app.get(&format!("{onwards}/report")).await.ok();
    assert_eq!(report["parameters"]["warm_start"], id);
    assert_eq!(report["steps"].as_array().unwrap().len(), 1, "steps are for looking on: one is enough here");
    let (found, expected) = (forces(&app, &onwards).await, forces(&app, &from_rest).await);
    let largest = expected.iter().fold(0.0, |m: f64, f| m.max(f.abs()));
    // Both are in equilibrium to 1e-4 of the reactions; the result of the first job is far from it.
    assert!(farthest(&found, &expected) < 2e-3 * largest, "{found:?} {expected:?}");
    assert!(farthest(&forces(&app, &first).await, &expected) > 0.1 * largest);

    // When the result of the first job is no longer in memory, it is solved again, and the results are bit-identical.
    let forgetful = TestApp::real_and_forgetful().await;
    let (elsewhere, cut) = scene(&forgetful).await;
    let before = solved(&forgetful, &elsewhere, &cut, 3.0, rest(3)).await;
    let again = solved(&forgetful, &elsewhere, &cut, 2.0, warm(before.rsplit('/').next().unwrap())).await;
    assert_eq!(forces(&forgetful, &again).await, found);

    let waypoints = json!([{"t": 1, "translation_mm": [0, -2, 0]}]);
    let plan = json!({"osteotomy": osteotomy, "paths": [{"segment": 1, "waypoints": waypoints}]});
    let plan = app.post(&format!("{session}/plans"), plan).await.ok()["id"].clone();
    for (more, why) in [
        (json!({"model": "linear", "warm_start": id}), "another model"),
        (
            json!({"model": "nonlinear", "skin_element": "wedge", "warm_start": id, "attachment": {"tie_gap_mm": 1}}),
            "another attachment",
        ),
        (json!({"model": "nonlinear", "warm_start": uuid::Uuid::now_v7()}), "no job"),
    ] {
        let mut body = json!({"plan": plan});
        body.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
        let problem = app.post(&format!("{session}/jobs"), body).await.problem(422, "invalid-request");
        let error = &problem["errors"][0];
        assert_eq!(error["pointer"], "/warm_start", "{problem}");
        assert!(problem.to_string().contains(why), "{problem}");
    }

    // The same patient in another session.
    let (other, cut) = scene(&app).await;
    let plan = json!({"osteotomy": cut, "paths": [{"segment": 1, "waypoints": waypoints}]});
    let plan = app.post(&format!("{other}/plans"), plan).await.ok()["id"].clone();
    let mut body = warm(id);
    body["plan"] = plan;
    let problem = app.post(&format!("{other}/jobs"), body).await.problem(422, "invalid-request");
    assert!(problem.to_string().contains("another session"), "{problem}");
}
