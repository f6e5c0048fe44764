use serde_json::{Value, json};

use crate::support::app::TestApp;
use crate::support::boxes::{scene, solved};

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
async fn a_warm_start_ends_where_the_path_from_rest_ends() {
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
