//! The service in process, with its directory and the stand-in.

use std::sync::Arc;
use std::time::{Duration, Instant};

use axum::Router;
use axum::body::{Body, Bytes, to_bytes};
use axum::http::{HeaderMap, HeaderValue, Method, Request, StatusCode};
use object_store::ObjectStore;
use prosopon_service::config::ServeConfig;
use prosopon_service::http::{AppState, app};
use prosopon_service::serve;
use prosopon_session::{Engine, Numerics};
use prosopon_store::Store;
use serde_json::{Value, json};
use tempfile::TempDir;
use tower::ServiceExt;

use crate::support::shapes::{skin, skull};
use crate::support::stand_in::StandIn;

pub(crate) struct TestApp {
    pub(crate) router: Router,
    pub(crate) state: AppState,
    pub(crate) stand_in: Arc<StandIn>,
    config: ServeConfig,
    directory: TempDir,
}

/// Time after which a job that has not ended counts as hanging.
const HANGS_AFTER: Duration = Duration::from_secs(300);

/// A completely read answer.
#[derive(Debug)]
pub(crate) struct Answer {
    pub(crate) status: StatusCode,
    pub(crate) headers: HeaderMap,
    pub(crate) body: Bytes,
}

impl Answer {
    #[track_caller]
    pub(crate) fn json(&self) -> Value {
        serde_json::from_slice(&self.body).unwrap_or_else(|_| panic!("no JSON: {self:?}"))
    }

    pub(crate) fn header(&self, name: &str) -> &str {
        self.headers.get(name).map_or("", |v| v.to_str().unwrap())
    }

    #[track_caller]
    pub(crate) fn ok(&self) -> Value {
        assert!(self.status.is_success(), "{self:?}");
        self.json()
    }

    /// The answer must be a problem of this kind; returns its document.
    #[track_caller]
    pub(crate) fn problem(&self, status: u16, kind: &str) -> Value {
        assert_eq!(self.header("content-type"), "application/problem+json", "{self:?}");
        let document = self.json();
        assert_eq!(document["type"], format!("/problems/{kind}"), "{document}");
        assert_eq!((self.status.as_u16(), &document["status"]), (status, &json!(status)), "{document}");
        assert!(document["detail"].as_str().is_some_and(|d| !d.is_empty()), "{document}");
        assert_eq!(document["request_id"], self.header("x-request-id"));
        document
    }
}

impl TestApp {
    pub(crate) async fn new() -> Self {
        Self::with(|_| {}).await
    }

    pub(crate) async fn with(change: impl FnOnce(&mut ServeConfig)) -> Self {
        let directory = tempfile::tempdir().unwrap();
        let mut config = ServeConfig::new(directory.path().to_owned());
        config.threads = 2;
        change(&mut config);
        Self::open(config, directory, Arc::new(StandIn::default())).await
    }

    /// With large values in another object store.
    pub(crate) async fn with_objects(objects: Arc<dyn ObjectStore>) -> Self {
        let directory = tempfile::tempdir().unwrap();
        let config = ServeConfig::new(directory.path().to_owned());
        let store = Store::open(&config.data).await.unwrap().with_objects(objects);
        let stand_in = Arc::new(StandIn::default());
        Self::over(config, directory, store, Arc::clone(&stand_in), stand_in).await
    }

    /// With the real numerics.
    pub(crate) async fn real() -> Self {
        Self::numerics(|numerics| numerics).await
    }

    /// With real numerics whose cache keeps only the latest entry.
    pub(crate) async fn real_and_forgetful() -> Self {
        Self::numerics(|numerics| numerics.with_cache_bytes(1)).await
    }

    async fn numerics(change: impl FnOnce(Numerics) -> Numerics) -> Self {
        let directory = tempfile::tempdir().unwrap();
        let mut config = ServeConfig::new(directory.path().to_owned());
        config.threads = 2;
        let engine = Arc::new(change(Numerics::new(config.service.import)));
        Self::open_with(config, directory, Arc::new(StandIn::default()), engine).await
    }

    async fn open(config: ServeConfig, directory: TempDir, stand_in: Arc<StandIn>) -> Self {
        let engine: Arc<dyn Engine> = Arc::clone(&stand_in) as _;
        Self::open_with(config, directory, stand_in, engine).await
    }

    async fn open_with(
        config: ServeConfig,
        directory: TempDir,
        stand_in: Arc<StandIn>,
        engine: Arc<dyn Engine>,
    ) -> Self {
        let store = Store::open(&config.data).await.unwrap();
        Self::over(config, directory, store, stand_in, engine).await
    }

    async fn over(
        config: ServeConfig,
        directory: TempDir,
        store: Store,
        stand_in: Arc<StandIn>,
        engine: Arc<dyn Engine>,
    ) -> Self {
        let state = serve::state(&config, store, engine).await.unwrap();
        Self { router: app(state.clone()), state, stand_in, config, directory }
    }

    /// Shuts the service down and starts it again on the same directory.
    pub(crate) async fn restart(self) -> Self {
        self.restart_after(async |_| {}).await
    }

    /// Shuts the service down, calls `between` with the directory, and starts it again.
    pub(crate) async fn restart_after(self, between: impl AsyncFnOnce(&std::path::Path)) -> Self {
        let Self { router, state, stand_in, config, directory } = self;
        drop(router);
        state.service.shut_down(Duration::from_secs(5)).await;
        state.service.store().close().await;
        let service = Arc::downgrade(&state.service);
        drop(state);
        let deadline = Instant::now() + Duration::from_secs(5);
        while service.strong_count() > 0 {
            assert!(Instant::now() < deadline, "something still holds the service");
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
        stand_in.release();
        between(directory.path()).await;
        Self::open(config, directory, stand_in).await
    }

    pub(crate) fn directory(&self) -> &std::path::Path {
        self.directory.path()
    }

    pub(crate) async fn send(&self, mut request: Request<Body>) -> Answer {
        request.headers_mut().entry("host").or_insert(HeaderValue::from_static("localhost"));
        let response = self.router.clone().oneshot(request).await.unwrap();
        let (parts, body) = response.into_parts();
        Answer { status: parts.status, headers: parts.headers, body: to_bytes(body, usize::MAX).await.unwrap() }
    }

    pub(crate) async fn call(
        &self,
        method: Method,
        path: &str,
        headers: &[(&str, &str)],
        body: impl Into<Body>,
    ) -> Answer {
        let mut request = Request::builder().method(method).uri(path);
        for (name, value) in headers {
            request = request.header(*name, *value);
        }
        self.send(request.body(body.into()).unwrap()).await
    }

    pub(crate) async fn get(&self, path: &str) -> Answer {
        self.call(Method::GET, path, &[], Body::empty()).await
    }

    pub(crate) async fn delete(&self, path: &str) -> Answer {
        self.call(Method::DELETE, path, &[], Body::empty()).await
    }

    pub(crate) async fn post(&self, path: &str, body: Value) -> Answer {
        self.call(Method::POST, path, &[("content-type", "application/json")], body.to_string()).await
    }

    pub(crate) async fn post_keyed(&self, path: &str, key: &str, body: Value) -> Answer {
        let headers = [("content-type", "application/json"), ("idempotency-key", key)];
        self.call(Method::POST, path, &headers, body.to_string()).await
    }

    pub(crate) async fn put_json(&self, path: &str, body: Value) -> Answer {
        self.call(Method::PUT, path, &[("content-type", "application/json")], body.to_string()).await
    }

    pub(crate) async fn upload(&self, path: &str, bytes: Vec<u8>) -> Answer {
        let length = bytes.len().to_string();
        self.call(Method::PUT, path, &[("content-length", &length)], bytes).await
    }

    // ---- steps to a job ----

    /// Path of a new session.
    pub(crate) async fn session(&self) -> String {
        let answer = self.post("/v1/sessions", json!({})).await;
        assert_eq!(answer.status, StatusCode::CREATED);
        answer.header("location").to_owned()
    }

    pub(crate) async fn session_with_surfaces(&self) -> String {
        let session = self.session().await;
        self.upload(&format!("{session}/skin"), skin()).await.ok();
        self.upload(&format!("{session}/skull"), skull()).await.ok();
        session
    }

    /// Waits for the end of an accepted job and returns its view.
    pub(crate) async fn finish(&self, accepted: Answer) -> Value {
        assert_eq!(accepted.status, StatusCode::ACCEPTED, "{accepted:?}");
        self.ended(accepted.header("location")).await.ok()
    }

    /// Waits for the end of a job and returns its view; a job that hangs is returned unfinished after the time limit.
    pub(crate) async fn ended(&self, job: &str) -> Answer {
        let begin = Instant::now();
        loop {
            let answer = self.get(&format!("{job}?wait_s=20")).await;
            let view: Value = serde_json::from_slice(&answer.body).unwrap_or_default();
            let waits = ["accepted", "running"].iter().any(|status| view["status"] == *status);
            if !waits || begin.elapsed() > HANGS_AFTER {
                return answer;
            }
        }
    }

    pub(crate) async fn session_with_field(&self) -> String {
        let session = self.session_with_surfaces().await;
        let field = self.finish(self.post(&format!("{session}/field"), json!({})).await).await;
        assert_eq!(field["status"], "succeeded", "{field}");
        session
    }

    /// Creates a session with a plan, ready for a job; returns both.
    pub(crate) async fn session_with_plan(&self) -> (String, String) {
        let session = self.session_with_field().await;
        let plan = self.plan(&session).await;
        (session, plan)
    }

    /// Cuts, meshes and plans in a session that has its field; returns the plan.
    pub(crate) async fn plan(&self, session: &str) -> String {
        let cut = json!({"cuts": [{"plane": {"point_mm": [0, 0, 0], "normal": [0, 0, 2]}}]});
        let osteotomy = self.post(&format!("{session}/osteotomies"), cut).await.ok()["id"].clone();
        let mesh = self.post(&format!("{session}/mesh"), json!({"osteotomy": osteotomy})).await;
        assert_eq!(self.finish(mesh).await["status"], "succeeded");
        let waypoints = json!([{"t": 1, "translation_mm": [0, -6, -1.5]}]);
        let plan = json!({"osteotomy": osteotomy, "paths": [{"segment": 1, "waypoints": waypoints}]});
        self.post(&format!("{session}/plans"), plan).await.ok()["id"].as_str().unwrap().to_owned()
    }

    /// Posts a solve, which must be accepted; returns the path of its job.
    pub(crate) async fn solve(&self, session: &str, plan: &str, more: Value) -> String {
        let mut body = json!({"plan": plan});
        body.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
        let answer = self.post(&format!("{session}/jobs"), body).await;
        assert_eq!(answer.status, StatusCode::ACCEPTED, "{answer:?}");
        answer.header("location").to_owned()
    }

    /// Waits until a job has finished `step` steps.
    pub(crate) async fn until_step(&self, job: &str, step: u64) {
        let deadline = Instant::now() + Duration::from_secs(10);
        while self.get(job).await.ok()["step"].as_u64().unwrap() < step {
            assert!(Instant::now() < deadline, "step {step} does not come");
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
    }
}

/// The pointers of a refusal with 422 `invalid-request`.
pub(crate) fn pointers(answer: &Answer) -> Vec<String> {
    let problem = answer.problem(422, "invalid-request");
    problem["errors"].as_array().unwrap().iter().map(|e| e["pointer"].as_str().unwrap().to_owned()).collect()
}

/// Messages of the warnings of an answer, without the notes.
pub(crate) fn warnings_of(answer: &Value) -> Vec<String> {
    let all = answer["warnings"].as_array().unwrap();
    all.iter().map(|w| w["message"].as_str().unwrap().to_owned()).collect()
}
