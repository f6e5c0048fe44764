//! The requests of `api/examples`.

use axum::http::Method;
use serde_json::Value;

use crate::support::app::TestApp;

/// A request that a reader may copy, and the expected status.
pub(crate) struct Example {
    pub(crate) name: String,
    pub(crate) method: Method,
    pub(crate) path: String,
    pub(crate) body: Value,
    pub(crate) status: u64,
}

/// All requests in the order of their names, each for a separate session that contains everything the request names.
pub(crate) async fn examples(app: &TestApp) -> Vec<Example> {
    let mut paths: Vec<_> = std::fs::read_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/api/examples"))
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|e| e == "json"))
        .collect();
    paths.sort();
    let mut all = Vec::new();
    for path in paths {
        let example: Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
        let (session, plan) = app.session_with_plan().await;
        let osteotomy = app.get(&session).await.ok()["osteotomies"][0].clone();
        let fill = |text: &str| {
            text.replace("{session}", session.rsplit('/').next().unwrap())
                .replace("{plan}", &plan)
                .replace("{osteotomy}", osteotomy.as_str().unwrap())
        };
        all.push(Example {
            name: path.display().to_string(),
            method: example["method"].as_str().unwrap().parse().unwrap(),
            path: fill(example["path"].as_str().unwrap()),
            body: serde_json::from_str(&fill(&example["body"].to_string())).unwrap(),
            status: example["status"].as_u64().unwrap(),
        });
    }
    all
}

/// The service accepts the form of every body in `api/examples`.
#[tokio::test]
async fn the_service_accepts_every_example() {
    let app = TestApp::new().await;
    let all = examples(&app).await;
    assert!(all.len() >= 6);
    for Example { name, method, path, body, status } in all {
        let answer = app.call(method, &path, &[("content-type", "application/json")], body.to_string()).await;
        assert_eq!(u64::from(answer.status.as_u16()), status, "{name}: {answer:?}");
    }
}
