//! Authentication, authorisation and separation of tenants.

use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use axum::body::Body;
use axum::http::{Method, StatusCode};
use base64::Engine;
use base64::engine::general_purpose::URL_SAFE_NO_PAD;
use prosopon_service::http::auth::{Access, ApiKey, AuthSettings, JwtSettings, Scope, new_key};
use prosopon_store::Audit;
use ring::rand::SystemRandom;
use ring::signature::{ECDSA_P256_SHA256_FIXED_SIGNING, EcdsaKeyPair, KeyPair};
use rustls::pki_types::PrivateKeyDer;
use rustls::pki_types::pem::PemObject;
use serde_json::{Value, json};

use crate::support::app::{Answer, TestApp};
use crate::support::binary::{Server, serve};
use crate::support::shapes::{skin, skull};

const KEY: &[u8] = include_bytes!("../data/tls/key.pem");
const OTHER_KEY: &[u8] = include_bytes!("../data/tls/other-key.pem");

/// Starts a service with two tenants; returns their tokens.
pub(crate) async fn two_tenants() -> (TestApp, String, String) {
    let (mut keys, mut tokens) = (Vec::new(), Vec::new());
    for (id, tenant) in [("front-a", "a"), ("front-b", "b")] {
        let new = new_key(id).unwrap();
        let tenant = tenant.parse().unwrap();
        let scopes = [Scope::Read, Scope::Write].into_iter().collect();
        keys.push(ApiKey { id: id.to_owned(), tenant, scopes, hash: new.hash });
        tokens.push(new.token);
    }
    let app = TestApp::with(|config| config.auth = Some(AuthSettings { keys, jwt: None })).await;
    let [a, b] = tokens.try_into().unwrap();
    (app, a, b)
}

pub(crate) async fn call(app: &TestApp, token: &str, method: Method, path: &str, body: Value) -> Answer {
    let authorization = format!("Bearer {token}");
    let headers = [("authorization", authorization.as_str()), ("content-type", "application/json")];
    let body = if body.is_null() { Body::empty() } else { body.to_string().into() };
    app.call(method, path, &headers, body).await
}

#[tokio::test]
async fn without_a_token_only_public_paths_are_answered() {
    let (app, token, _) = two_tenants().await;
    for path in ["/livez", "/readyz", "/openapi.json", "/docs/", "/"] {
        assert!(app.get(path).await.status.is_success(), "{path}");
    }
    let faulty =
        ["Basic abc", "Bearer", "Bearer ", "Bearer front-a.wrong", "Bearer nobody.x", "Bearer a.b.c", "Bearer x"];
    for path in ["/v1/sessions", "/v1/jobs", "/metrics", "/nowhere", "/v1/materials"] {
        let refused = app.get(path).await;
        refused.problem(401, "unauthenticated");
        assert_eq!(refused.header("www-authenticate"), "Bearer", "{path}");
    }
    for authorization in faulty {
        let headers = [("authorization", authorization)];
        app.call(Method::GET, "/v1/sessions", &headers, Body::empty()).await.problem(401, "unauthenticated");
    }
    assert_eq!(call(&app, &token, Method::GET, "/v1/sessions", Value::Null).await.status, StatusCode::OK);
    call(&app, &token, Method::GET, "/nowhere", Value::Null).await.problem(404, "not-found");
    let no_admin = call(&app, &token, Method::GET, "/metrics", Value::Null).await.problem(403, "forbidden");
    assert_eq!(no_admin["scope"], "admin");
}

/// Every path that contains a session or job, with each of its methods.
#[tokio::test]
async fn another_tenants_sessions_and_jobs_are_not_found() {
    let (app, a, b) = two_tenants().await;
    let made = call(&app, &a, Method::POST, "/v1/sessions", json!({"label": "secret"})).await;
    let session = made.header("location").rsplit('/').next().unwrap().to_owned();
    let owner = format!("Bearer {a}");
    let length = skin().len().to_string();
    for (part, bytes) in [("skin", skin()), ("skull", skull())] {
        let headers = [("authorization", owner.as_str()), ("content-length", length.as_str())];
        app.call(Method::PUT, &format!("/v1/sessions/{session}/{part}"), &headers, bytes).await.ok();
    }
    let field = call(&app, &a, Method::POST, &format!("/v1/sessions/{session}/field"), json!({})).await;
    let job = field.header("location").rsplit('/').next().unwrap().to_owned();
    call(&app, &a, Method::GET, &format!("/v1/jobs/{job}?wait_s=10"), Value::Null).await.ok();

    let api: Value = serde_json::from_str(include_str!("../../api/openapi.json")).unwrap();
    let nil = "00000000-0000-0000-0000-000000000000";
    let mut tried = 0;
    for (path, item) in api["paths"].as_object().unwrap() {
        let below = path.starts_with("/v1/sessions/") || path.starts_with("/v1/jobs/");
        let id = path.split('/').find(|word| word.starts_with('{'));
        let is_guarded = id.is_none_or(|id| ["{session}", "{job}"].contains(&id));
        assert!(!below || is_guarded, "{path}: the guard knows ids by the names `session` and `job` only");
        if !path.contains("{session}") && !path.contains("{job}") {
            continue;
        }
        for method in item.as_object().unwrap().keys() {
            let method: Method = method.to_uppercase().parse().unwrap_or(Method::TRACE);
            if method == Method::TRACE {
                continue;
            }
            let concrete = |session: &str, job: &str| {
                let ids = path.replace("{session}", session).replace("{job}", job);
                ids.replace("{osteotomy}", nil).replace("{plan}", nil).replace("{k}", "1").replace("{segment}", "1")
            };
            let foreign = call(&app, &b, method.clone(), &concrete(&session, &job), json!({})).await;
            let document = foreign.problem(404, "not-found");
            assert!(!document.to_string().contains("secret"));
            let unknown = call(&app, &b, method.clone(), &concrete(nil, nil), json!({})).await;
            // Where the path is checked first, the answer is the same as for an id that never existed.
            if method == Method::GET || method == Method::DELETE {
                assert_eq!(unknown.status, foreign.status, "{method} {path}");
            }
            tried += 1;
        }
    }
    assert!(tried > 30, "{tried}");
    // The other tenant's data are not visible through a body, in a list, or after deletion either.
    let named =
        json!({"prediction": {"session": session, "part": "skin"}, "reference": {"session": session, "part": "skull"}});
    call(&app, &b, Method::POST, "/v1/compare", named).await.problem(404, "not-found");
    for list in ["/v1/sessions", "/v1/jobs"] {
        let listed = call(&app, &b, Method::GET, list, Value::Null).await.ok();
        assert!(!listed.to_string().contains(&session), "{listed}");
        assert!(call(&app, &a, Method::GET, list, Value::Null).await.ok().to_string().contains(&session));
    }
    let path = format!("/v1/sessions/{session}");
    assert_eq!(call(&app, &a, Method::DELETE, &path, Value::Null).await.status, StatusCode::NO_CONTENT);
    call(&app, &a, Method::GET, &path, Value::Null).await.problem(410, "gone");
    call(&app, &b, Method::GET, &path, Value::Null).await.problem(404, "not-found");
}

#[tokio::test]
async fn idempotency_keys_are_separate_for_each_tenant() {
    let (app, a, b) = two_tenants().await;
    let mut made = Vec::new();
    for token in [&a, &b, &a] {
        let authorization = format!("Bearer {token}");
        let headers = [
            ("authorization", authorization.as_str()),
            ("content-type", "application/json"),
            ("idempotency-key", "same"),
        ];
        made.push(app.call(Method::POST, "/v1/sessions", &headers, "{}").await.ok()["id"].clone());
    }
    assert!(made[0] != made[1] && made[0] == made[2]);
}

#[tokio::test]
async fn the_audit_log_lists_every_call_and_no_bodies() {
    let (app, a, _) = two_tenants().await;
    let made = call(&app, &a, Method::POST, "/v1/sessions", json!({"label": "tag-of-a-patient"})).await;
    let path = made.header("location").to_owned();
    call(&app, &a, Method::GET, &path, Value::Null).await.ok();
    call(&app, &a, Method::DELETE, &path, Value::Null).await;
    app.get("/v1/sessions").await.problem(401, "unauthenticated");
    let entries = Audit::verify(app.directory(), None).unwrap().entries;
    let file = std::fs::read_dir(app.directory().join("audit")).unwrap().next().unwrap().unwrap().path();
    let text = std::fs::read_to_string(file).unwrap();
    let lines: Vec<Value> = text.lines().map(|l| serde_json::from_str::<Value>(l).unwrap()["entry"].clone()).collect();
    let what: Vec<(&str, u64)> =
        lines.iter().map(|l| (l["what"].as_str().unwrap(), l["status"].as_u64().unwrap())).collect();
    assert_eq!(
        what,
        [("POST /v1/sessions", 201), ("GET /v1/sessions/{session}", 200), ("DELETE /v1/sessions/{session}", 204),]
    );
    assert_eq!(entries, 3);
    let id = path.rsplit('/').next().unwrap();
    assert!(lines.iter().all(|l| l["tenant"] == "a" && l["who"] == "key:front-a" && l["id"] == id));
    assert!(!text.contains("patient"));
}

/// The key pair of a PEM file.
fn key_pair(pem: &[u8]) -> EcdsaKeyPair {
    let key = PrivateKeyDer::from_pem_slice(pem).unwrap();
    EcdsaKeyPair::from_pkcs8(&ECDSA_P256_SHA256_FIXED_SIGNING, key.secret_der(), &SystemRandom::new()).unwrap()
}

/// A token with this header and these claims, signed by `sign`.
fn token(header: &Value, claims: &Value, sign: impl Fn(&[u8]) -> Vec<u8>) -> String {
    let part = |value: &Value| URL_SAFE_NO_PAD.encode(value.to_string());
    let message = format!("{}.{}", part(header), part(claims));
    format!("{message}.{}", URL_SAFE_NO_PAD.encode(sign(message.as_bytes())))
}

/// A token signed with an elliptic curve's key.
fn es256(claims: &Value, key: &EcdsaKeyPair) -> String {
    es256_with(&json!({"typ": "JWT", "alg": "ES256", "kid": "k1"}), claims, key)
}

fn es256_with(header: &Value, claims: &Value, key: &EcdsaKeyPair) -> String {
    token(header, claims, |message| key.sign(&SystemRandom::new(), message).unwrap().as_ref().to_vec())
}

/// A token signed with a secret.
fn hs256(claims: &Value, secret: &[u8]) -> String {
    let key = ring::hmac::Key::new(ring::hmac::HMAC_SHA256, secret);
    token(&json!({"typ": "JWT", "alg": "HS256", "kid": "k1"}), claims, |message| {
        ring::hmac::sign(&key, message).as_ref().to_vec()
    })
}

/// Tokens of an identity provider, each with one fault.
#[tokio::test]
async fn a_token_must_be_signed_fresh_and_for_this_service() {
    let (signer, other) = (key_pair(KEY), key_pair(OTHER_KEY));
    let (x, y) = signer.public_key().as_ref()[1..].split_at(32);
    let coordinate = |bytes: &[u8]| URL_SAFE_NO_PAD.encode(bytes);
    let jwk = json!({ "kty": "EC", "crv": "P-256", "kid": "k1", "x": coordinate(x), "y": coordinate(y) });
    let directory = tempfile::tempdir().unwrap();
    let jwks_file = directory.path().join("jwks.json");
    std::fs::write(&jwks_file, json!({ "keys": [jwk] }).to_string()).unwrap();
    let jwt = JwtSettings {
        issuer: "https://id.example".to_owned(),
        audience: "prosopon".to_owned(),
        jwks_file,
        tenant_claim: "tenant".to_owned(),
        scope_claim: "scope".to_owned(),
        leeway: std::time::Duration::ZERO,
    };
    let app = TestApp::with(|config| config.auth = Some(AuthSettings { keys: Vec::new(), jwt: Some(jwt) })).await;
    let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap().as_secs();
    let claims = json!({
        "iss": "https://id.example", "aud": "prosopon", "sub": "dr-a", "exp": now + 600, "tenant": "a",
        "scope": "openid read",
    });
    let changed = |name: &str, value: Value| {
        let mut claims = claims.clone();
        claims[name] = value;
        es256(&claims, &signer)
    };
    let good = es256(&claims, &signer);
    assert_eq!(call(&app, &good, Method::GET, "/v1/sessions", Value::Null).await.status, StatusCode::OK);
    call(&app, &good, Method::POST, "/v1/sessions", json!({})).await.problem(403, "forbidden");
    let listed = changed("scope", json!(["read", "write"]));
    assert_eq!(call(&app, &listed, Method::POST, "/v1/sessions", json!({})).await.status, StatusCode::CREATED);
    let mut without_signature = good.rsplit_once('.').unwrap().0.to_owned();
    without_signature.push('.');
    for (wrong, token) in [
        ("expired", changed("exp", json!(now - 10))),
        ("not yet", changed("nbf", json!(now + 600))),
        ("issuer", changed("iss", json!("https://evil.example"))),
        ("audience", changed("aud", json!("another"))),
        ("no tenant", changed("tenant", Value::Null)),
        ("bad tenant", changed("tenant", json!("../a"))),
        ("no subject", changed("sub", Value::Null)),
        ("signer", es256(&claims, &other)),
        ("shared secret", hs256(&claims, KEY)),
        ("no signature", without_signature),
        ("extension", es256_with(&json!({"alg": "ES256", "kid": "k1", "crit": ["x"], "x": 1}), &claims, &signer)),
        ("tampered", good.replacen('.', ".e", 1)),
    ] {
        let refused = call(&app, &token, Method::GET, "/v1/sessions", Value::Null).await;
        assert_eq!(refused.status, StatusCode::UNAUTHORIZED, "{wrong}");
        let detail = refused.problem(401, "unauthenticated")["detail"].clone();
        assert_eq!(detail, "the bearer token is not trusted", "{wrong}: why is for the log");
    }
}

/// The keys of a configuration file can be changed while the service runs; faults in the file change nothing.
#[test]
#[allow(clippy::disallowed_methods, reason = "the service tells nobody that it has read a file")]
fn a_key_is_revoked_without_a_restart() {
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("prosopon.toml");
    let keys = ["old", "new"].map(|id| new_key(id).unwrap());
    let write = |ids: &[usize], more: &str| {
        let of_key = |n: &usize| {
            format!("[[auth.keys]]\nid = \"k{n}\"\ntenant = \"a\"\nscopes = [\"read\"]\nhash = \"{}\"\n", keys[*n].hash)
        };
        std::fs::write(&file, ids.iter().map(of_key).collect::<String>() + more).unwrap();
    };
    write(&[0], "");
    let mut command = serve(directory.path(), "127.0.0.1:0");
    command.env("PROSOPON_CONFIG", &file);
    let server = Server::spawn(command);
    let statuses = || keys.each_ref().map(|key| server.get_as(&key.token, "/v1/sessions").status);
    assert_eq!(statuses(), [200, 401]);
    let until = |expected: [u16; 2]| {
        let deadline = std::time::Instant::now() + std::time::Duration::from_secs(60);
        while statuses() != expected {
            assert!(std::time::Instant::now() < deadline, "{:?}, not {expected:?}", statuses());
            std::thread::sleep(std::time::Duration::from_millis(200));
        }
    };
    write(&[1], "");
    until([401, 200]);
    write(&[0], "max_waiting = \"many\"\n");
    std::thread::sleep(std::time::Duration::from_secs(7));
    assert_eq!(statuses(), [401, 200]);
    write(&[0, 1], "");
    until([200, 200]);
    // Without any key nobody is let in.
    write(&[], "max_waiting = 10\n");
    until([401, 401]);
}

/// The events of a job that goes on; the key of their reader is removed.
#[tokio::test]
async fn an_open_stream_ends_with_its_key() {
    let (app, a, _) = two_tenants().await;
    let post = async |path: String, body: Value| call(&app, &a, Method::POST, &path, body).await.json();
    let session = format!("/v1/sessions/{}", post("/v1/sessions".to_owned(), json!({})).await["id"].as_str().unwrap());
    let authorization = format!("Bearer {a}");
    for (part, file) in [("skin", skin()), ("skull", skull())] {
        let headers = [("authorization", authorization.as_str())];
        assert!(app.call(Method::PUT, &format!("{session}/{part}"), &headers, file).await.status.is_success());
    }
    let ended = async |job: Value| {
        let path = format!("{}?wait_s=30", job["links"]["self"].as_str().unwrap());
        assert_eq!(call(&app, &a, Method::GET, &path, Value::Null).await.json()["status"], "succeeded");
    };
    ended(post(format!("{session}/field"), json!({})).await).await;
    let cuts = json!({"cuts": [{"plane": {"point_mm": [0, 0, 0], "normal": [0, 0, 2]}}]});
    let osteotomy = post(format!("{session}/osteotomies"), cuts).await["id"].clone();
    ended(post(format!("{session}/mesh"), json!({"osteotomy": osteotomy})).await).await;
    let paths = json!([{"segment": 1, "waypoints": [{"t": 1, "translation_mm": [0, -6, -1.5]}]}]);
    let plan = post(format!("{session}/plans"), json!({"osteotomy": osteotomy, "paths": paths})).await["id"].clone();
    app.stand_in.hold_after(1);
    let job = post(format!("{session}/jobs"), json!({"plan": plan})).await;
    let events = format!("{}/events", job["links"]["self"].as_str().unwrap());
    let Access::Tokens(authenticator) = &app.state.access else { panic!("the service has keys") };
    let revoke = async {
        tokio::time::sleep(std::time::Duration::from_millis(300)).await;
        authenticator.set_keys(Vec::new());
    };
    let (stream, ()) = tokio::join!(call(&app, &a, Method::GET, &events, Value::Null), revoke);
    let text = String::from_utf8_lossy(&stream.body).into_owned();
    assert!(stream.status == StatusCode::OK && !text.contains("event: end"), "{text}");
    assert_eq!(call(&app, &a, Method::GET, &events, Value::Null).await.status, StatusCode::UNAUTHORIZED);
    app.stand_in.release();
}

#[tokio::test]
async fn browsers_receive_restrictive_headers() {
    let app = TestApp::with(|config| config.origins = vec!["https://plan.example".to_owned()]).await;
    let answer = app.get("/v1/sessions").await;
    for (name, value) in [
        ("x-content-type-options", "nosniff"),
        ("x-frame-options", "DENY"),
        ("referrer-policy", "no-referrer"),
        ("cache-control", "no-store"),
        ("content-security-policy", "default-src 'none'; frame-ancestors 'none'"),
    ] {
        assert_eq!(answer.header(name), value, "{name}");
    }
    assert!(app.get("/docs/").await.header("content-security-policy").contains("'self'"));
    for (origin, allowed) in [("https://plan.example", true), ("https://evil.example", false)] {
        let headers = [("origin", origin), ("access-control-request-method", "POST")];
        let preflight = app.call(Method::OPTIONS, "/v1/sessions", &headers, Body::empty()).await;
        assert_eq!(preflight.header("access-control-allow-origin") == origin, allowed, "{origin}");
        let plain = app.call(Method::GET, "/v1/sessions", &[("origin", origin)], Body::empty()).await;
        assert_eq!(plain.header("access-control-allow-origin") == origin, allowed, "{origin}");
    }
}

#[tokio::test]
async fn only_requests_for_this_host_are_served() {
    let app = TestApp::with(|config| config.allowed_hosts = vec!["plan.example".to_owned()]).await;
    for (host, status) in [("127.0.0.1:8080", 200), ("localhost", 200), ("plan.example", 200), ("evil.example", 421)] {
        let answer = app.call(Method::GET, "/v1/sessions", &[("host", host)], Body::empty()).await;
        assert_eq!(answer.status.as_u16(), status, "{host}");
    }
    let refused = app.call(Method::GET, "/", &[("host", "evil.example")], Body::empty()).await;
    refused.problem(421, "foreign-host");
}

#[tokio::test]
async fn a_page_of_another_origin_writes_nothing() {
    let app = TestApp::with(|config| config.origins = vec!["https://plan.example".to_owned()]).await;
    let write = |headers: &'static [(&'static str, &'static str)]| {
        app.call(Method::POST, "/v1/sessions", headers, Body::empty())
    };
    let host = ("host", "127.0.0.1:8080");
    for (headers, status) in [
        (&[("host", "127.0.0.1:8080"), ("origin", "https://evil.example")] as &[_], 403),
        (&[("host", "127.0.0.1:8080"), ("sec-fetch-site", "cross-site")], 403),
        (&[("host", "127.0.0.1:8080"), ("origin", "http://127.0.0.1:8080"), ("sec-fetch-site", "same-origin")], 201),
        (&[("host", "127.0.0.1:8080"), ("origin", "https://plan.example"), ("sec-fetch-site", "cross-site")], 201),
        (&[("host", "127.0.0.1:8080")], 201),
    ] {
        assert_eq!(write(headers).await.status.as_u16(), status, "{headers:?}");
    }
    let foreign = [host, ("origin", "https://evil.example")];
    let sessions = app.call(Method::GET, "/v1/sessions", &foreign, Body::empty()).await.ok();
    assert_eq!(sessions["sessions"].as_array().unwrap().len(), 3, "reads stay possible, and a page cannot see them");
    write(&[("host", "127.0.0.1:8080"), ("origin", "null")]).await.problem(403, "foreign-origin");
}

/// Status and certificate name that Python gets from an HTTPS address, without verifying the certificate.
fn over_tls(url: &str) -> String {
    let script = "import ssl, sys, urllib.request as r\n\
        c = ssl.create_default_context(); c.check_hostname = False; c.verify_mode = ssl.CERT_NONE\n\
        import socket\n\
        h, p = sys.argv[1].split('://')[1].split(':')\n\
        s = c.wrap_socket(socket.create_connection((h, int(p))))\n\
        import hashlib\n\
        print(r.urlopen(sys.argv[1] + '/livez', context=c).status, hashlib.sha256(s.getpeercert(True)).hexdigest())";
    let output = Command::new("python3").args(["-c", script, url]).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

#[test]
fn a_renewed_certificate_is_served_without_a_restart() {
    let directory = tempfile::tempdir().unwrap();
    let [cert, key] = ["cert.pem", "key.pem"].map(|name| directory.path().join(name));
    let put = |from: &str| {
        let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/tls");
        std::fs::copy(source.join(format!("{from}key.pem")), &key).unwrap();
        std::fs::copy(source.join(format!("{from}cert.pem")), &cert).unwrap();
    };
    put("");
    let mut command = serve(&directory.path().join("data"), "127.0.0.1:0");
    command.env("PROSOPON_TLS__CERT", &cert).env("PROSOPON_TLS__KEY", &key);
    let server = Server::spawn(command);
    assert!(server.url.starts_with("https://"), "{}", server.url);
    let first = over_tls(&server.url);
    assert!(first.starts_with("200 "));
    put("other-");
    let deadline = Instant::now() + Duration::from_secs(30);
    while over_tls(&server.url) == first {
        assert!(Instant::now() < deadline, "the old certificate is still served");
        std::thread::park_timeout(Duration::from_millis(250));
    }
}
