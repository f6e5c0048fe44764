//! A later job of a session uses the factorisation of an earlier one.

use serde_json::{Value, json};

use crate::support::app::TestApp;
use crate::support::boxes::{scene, solved};

/// Forces on the bones at each step, with all digits, and the number of factorisations of the first step.
async fn solve(app: &TestApp, session: &str, osteotomy: &Value, forward_mm: f64, more: Value) -> (Vec<Value>, u64) {
    let job = solved(app, session, osteotomy, forward_mm, more).await;
    let report = app.get(&format!("{job}/report")).await.ok();
    let steps = report["steps"].as_array().unwrap();
    (steps.iter().map(|s| s["reactions"].clone()).collect(), steps[0]["factorisations"].as_u64().unwrap())
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_job_with_a_reused_factor_gives_the_same_bits_as_alone() {
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
