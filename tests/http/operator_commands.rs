//! Operator commands of the real binary.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Command, Output};
use std::time::{Duration, Instant};

use serde_json::json;

use crate::support::binary::{Server, serve};
use crate::support::shapes::skin;

fn prosopon(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_prosopon")).args(arguments).env_remove("PROSOPON_DATA").output().unwrap()
}

fn text_of(path: &Path) -> &str {
    path.to_str().unwrap()
}

#[test]
fn all_faults_of_a_configuration_are_told_at_once() {
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("prosopon.toml");
    std::fs::write(&file, "listen = \"0.0.0.0:80\"\nmax_waiting = 0\nspeed = 3\n").unwrap();
    let refused = prosopon(&["config", "check", "--config", text_of(&file)]);
    let told = String::from_utf8(refused.stderr).unwrap();
    assert!(!refused.status.success());
    for word in ["loopback", "max_waiting", "speed", "data"] {
        assert!(told.contains(word), "{word}: {told}");
    }
    let served = prosopon(&["serve", "--config", text_of(&file), "--data", text_of(directory.path())]);
    assert!(!served.status.success() && String::from_utf8(served.stderr).unwrap().contains("loopback"));

    std::fs::write(&file, "max_waiting = 5\n").unwrap();
    let fine = prosopon(&["config", "check", "--config", text_of(&file), "--data", "d"]);
    let printed = String::from_utf8(fine.stdout).unwrap();
    assert!(
        fine.status.success() && printed.contains("max_waiting = 5") && printed.contains("data = \"d\""),
        "{printed}"
    );
}

/// The check reports settings that would make `serve` fail later.
#[test]
fn certificates_levels_and_times_that_cannot_be_used_are_faults_of_the_configuration() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name);
    let tls = |name: &str| Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/tls").join(name);
    std::fs::write(at("no.pem"), "no certificate").unwrap();
    std::fs::write(at("jwks.json"), "{\"keys\": []}").unwrap();
    let check = |text: String| {
        std::fs::write(at("prosopon.toml"), text).unwrap();
        let done = prosopon(&["config", "check", "--config", text_of(&at("prosopon.toml")), "--data", "d"]);
        (done.status.success(), String::from_utf8(done.stderr).unwrap())
    };
    let with_tls = |cert: &Path, key: &Path| format!("[tls]\ncert = {cert:?}\nkey = {key:?}\n");
    let jwt = |issuer: &str| {
        format!("[auth.jwt]\nissuer = {issuer:?}\naudience = \"a\"\njwks_file = {:?}\n", at("jwks.json"))
    };
    for (text, words) in [
        (with_tls(&at("no.pem"), &tls("key.pem")), "no.pem"),
        (with_tls(&tls("cert.pem"), &at("no.pem")), "no.pem"),
        (with_tls(&tls("cert.pem"), &tls("other-key.pem")), "cannot be used together"),
        (with_tls(&at("absent.pem"), &tls("key.pem")), "absent.pem"),
        ("[log]\nlevel = \"inof\"\n".to_owned(), "log.level"),
        (jwt(""), "auth.jwt.issuer"),
        (jwt("https://id.example"), "contains no key"),
        ("heartbeat_s = 0\n".to_owned(), "heartbeat_s"),
        ("answer_timeout_s = 0\n".to_owned(), "answer_timeout_s"),
        ("body_timeout_s = 0\n".to_owned(), "body_timeout_s"),
        ("upload_idle_s = 0\n".to_owned(), "upload_idle_s"),
        ("parallel_jobs = 0\n".to_owned(), "parallel_jobs"),
    ] {
        let (fine, told) = check(text.clone());
        assert!(!fine && told.contains(words), "{text}: {told}");
    }
    let (fine, told) = check(with_tls(&tls("cert.pem"), &tls("key.pem")));
    assert!(fine, "{told}");
}

#[test]
fn addresses_of_other_places_are_checked_and_printed_without_passwords() {
    let check = |database: &str, blobs: &str, endpoint: &str| {
        let arguments = ["config", "check", "--data", "d", "--database", database, "--blobs", blobs];
        let mut command = Command::new(env!("CARGO_BIN_EXE_prosopon"));
        let done =
            command.args(arguments).env("AWS_ENDPOINT_URL", endpoint).env_remove("PROSOPON_DATA").output().unwrap();
        (done.status.success(), String::from_utf8([done.stdout, done.stderr].concat()).unwrap())
    };
    let (fine, printed) = check("postgres://anna:secret@db.example/plans", "s3://plans/a", "http://127.0.0.1:1");
    assert!(fine && !printed.contains("secret"), "{printed}");
    let expected = "database = \"postgres://anna@db.example/plans\"\nblobs = \"s3://plans/a\"\n";
    assert!(printed.contains(expected), "{printed}");
    let (fine, told) = check("mysql://anna:secret@db.example/plans", "plans", "http://127.0.0.1:1");
    assert!(!fine && !told.contains("secret"), "{told}");
    assert!(told.contains("database: is no address") && told.contains("blobs: `plans` is no address"), "{told}");
    assert!(told.contains("(command line)") && !told.contains(".rs"), "{told}");
    let database = ["--data", "d", "--database", "postgres://db.example/plans"];
    for role in [&["worker"][..], &["serve", "--no-worker"]] {
        let told = String::from_utf8(prosopon(&[role, &database].concat()).stderr).unwrap();
        assert!(told.contains("blobs: API and worker processes on one database need a common bucket"), "{told}");
    }
    for command in ["migrate", "audit"] {
        let verify: &[&str] = if command == "audit" { &["verify", "--data", "d"] } else { &[] };
        let database = ["--database", "mysql://anna:secret@db.example/plans"];
        let refused = prosopon(&[&[command], verify, &database].concat());
        let told = String::from_utf8(refused.stderr).unwrap();
        assert!(!refused.status.success() && told.contains("is no address") && !told.contains("secret"), "{told}");
    }
}

#[test]
fn keys_are_made_as_the_configuration_takes_them() {
    for (arguments, words) in [
        (["--id", "a b", "--tenant", "local"], "letters"),
        (["--id", "front", "--tenant", "Hospital A"], "tenant"),
        (["--id", "front", "--scopes", "read,fly"], "fly"),
    ] {
        let refused = prosopon(&[&["auth", "key"], &arguments[..]].concat());
        let told = String::from_utf8(refused.stderr).unwrap();
        assert!(!refused.status.success() && told.contains(words) && refused.stdout.is_empty(), "{told}");
    }
    let directory = tempfile::tempdir().unwrap();
    let made = prosopon(&["auth", "key", "--id", "front", "--tenant", "hospital-a", "--scopes", "read,admin"]);
    assert!(made.status.success());
    let file = directory.path().join("prosopon.toml");
    std::fs::write(&file, made.stdout).unwrap();
    let checked = prosopon(&["config", "check", "--config", text_of(&file), "--data", "d"]);
    let printed = String::from_utf8(checked.stdout).unwrap();
    assert!(checked.status.success() && printed.contains("front (hospital-a; read admin)"), "{printed}");
}

#[test]
fn backups_go_elsewhere_and_of_nothing_there_is_none() {
    let directory = tempfile::tempdir().unwrap();
    let data = directory.path().join("data");
    let refused = |arguments: &[&str], words: &str| {
        let done = prosopon(arguments);
        let told = String::from_utf8(done.stderr).unwrap();
        assert!(!done.status.success() && told.contains(words), "{arguments:?}: {told}");
    };
    let out = directory.path().join("out");
    refused(&["backup", "--data", text_of(&data), "--out", text_of(&out)], "there is no store in");
    refused(&["audit", "verify", "--data", text_of(&data)], "there is no audit log in");
    refused(&["scrub", "--data", text_of(&data)], "there is no store");
    assert!(!data.exists() && !out.exists());
    let server = Server::start(&data, &[]);
    server.session();
    for inside in [data.join("backup"), data.join("new/deeper"), data.join("blobs/../x")] {
        refused(&["backup", "--data", text_of(&data), "--out", text_of(&inside)], "inside the data directory");
        assert!(!inside.exists());
    }
}

#[test]
fn an_audit_log_whose_end_was_cut_off_is_found_out() {
    let directory = tempfile::tempdir().unwrap();
    let mut server = Server::start(directory.path(), &[]);
    for _ in 0..5 {
        server.session();
    }
    let pid = server.child.id().to_string();
    assert!(Command::new("kill").args(["-TERM", &pid]).status().unwrap().success());
    assert!(server.child.wait().unwrap().success());
    let verify = || prosopon(&["audit", "verify", "--data", text_of(directory.path())]);
    let fine = String::from_utf8(verify().stdout).unwrap();
    assert!(fine.contains("5 entries, none changed") && fine.contains("0 entries are later"), "{fine}");

    let log = std::fs::read_dir(directory.path().join("audit")).unwrap().next().unwrap().unwrap().path();
    let whole = std::fs::read_to_string(&log).unwrap();
    let cut: String = whole.lines().take(3).map(|line| format!("{line}\n")).collect();
    std::fs::write(&log, cut).unwrap();
    let told = String::from_utf8(verify().stderr).unwrap();
    assert!(told.contains("after number 3 were removed"), "{told}");
    // A start of the service on this log records the gap.
    let server = Server::start(directory.path(), &[]);
    server.session();
    drop(server);
    let told = String::from_utf8(verify().stderr).unwrap();
    assert!(told.contains("removed"), "{told}");
    assert!(std::fs::read_to_string(&log).unwrap().contains("entries before this one were removed"));
}

#[test]
fn a_running_service_is_backed_up_and_comes_back_elsewhere() {
    let directory = tempfile::tempdir().unwrap();
    let [data, out, back] = ["data", "out", "back"].map(|name| directory.path().join(name));
    let server = Server::start(&data, &[]);
    let session = server.session();
    server.upload(&format!("{session}/skin"), &skin()).ok();
    let before = server.get(&session).ok();
    let done = prosopon(&["backup", "--data", text_of(&data), "--out", text_of(&out)]);
    assert!(done.status.success(), "{done:?}");
    server.post("/v1/sessions", &json!({})).ok();
    drop(server);

    let done = prosopon(&["restore", "--from", text_of(&out), "--data", text_of(&back)]);
    assert!(done.status.success(), "{done:?}");
    let server = Server::start(&back, &[]);
    assert_eq!(server.get(&session).ok(), before);
    assert_eq!(server.get("/v1/sessions").ok()["sessions"].as_array().unwrap().len(), 1);
    let again = prosopon(&["restore", "--from", text_of(&out), "--data", text_of(&back)]);
    assert!(!again.status.success(), "never over a store");
    let verified = prosopon(&["audit", "verify", "--data", text_of(&data)]);
    assert!(verified.status.success() && String::from_utf8(verified.stdout).unwrap().contains("none changed"));
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
fn tls_is_served_and_a_renewed_certificate_needs_no_restart() {
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

#[test]
fn slow_and_huge_heads_are_not_waited_for() {
    let directory = tempfile::tempdir().unwrap();
    let mut command = serve(directory.path(), "127.0.0.1:0");
    command.env("PROSOPON_HEADER_TIMEOUT_S", "1");
    let server = Server::spawn(command);
    let answer_to = |request: &[u8]| {
        let mut socket = TcpStream::connect(server.address()).unwrap();
        socket.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
        socket.write_all(request).ok();
        let mut answer = Vec::new();
        socket.read_to_end(&mut answer).ok();
        String::from_utf8_lossy(&answer).lines().next().unwrap_or_default().to_owned()
    };
    let begun = Instant::now();
    let slow = answer_to(b"GET /livez HTTP/1.1\r\nHost: localh");
    assert!(slow.is_empty() || slow.contains("408"), "{slow}");
    assert!(begun.elapsed() < Duration::from_secs(15), "{:?}", begun.elapsed());
    let huge = format!("GET /livez HTTP/1.1\r\nHost: localhost\r\nX-Long: {}\r\n\r\n", "x".repeat(200_000));
    assert!(answer_to(huge.as_bytes()).contains("431"));
    let many = format!("GET /livez HTTP/1.1\r\nHost: localhost\r\n{}\r\n", "X-A: b\r\n".repeat(500));
    assert!(answer_to(many.as_bytes()).contains("431"));
    assert_eq!(server.get("/livez").status, 200);
}

/// The first frame can be read while later steps are still being solved.
#[test]
fn the_first_frame_arrives_before_the_last_step_is_solved() {
    let directory = tempfile::tempdir().unwrap();
    let server = Server::start(directory.path(), &[]);
    let session = server.session();
    server.upload(&format!("{session}/tissue"), &crate::routes::tissue::slab(1.0)).ok();
    let paths = json!([{"segment": 1, "waypoints": [{"t": 1, "translation_mm": [0.5, 0, 2]}]}]);
    let plan = server.post(&format!("{session}/plans"), &json!({"paths": paths})).ok()["id"].clone();
    let job = server.post(&format!("{session}/jobs"), &json!({"plan": plan, "model": "nonlinear", "steps": 40})).ok();
    let own = job["links"]["self"].as_str().unwrap();
    let mut stream = server.stream(&format!("{own}/events"));
    loop {
        let event = stream.next_event();
        if event["event"] == "step" {
            assert_eq!(event["data"]["k"], 1);
            let frame = server.get(event["data"]["links"]["frame"].as_str().unwrap());
            assert_eq!(frame.status, 200);
            let view = server.get(own).ok();
            assert!(view["status"] == "running" && view["step"].as_u64().unwrap() < 40, "{view}");
            break;
        }
        assert_ne!(event["event"], "end", "no step came before the end");
    }
    server.post(&format!("{own}/cancel"), &json!({})).ok();
}

/// After SIGTERM no new jobs start, running jobs may finish, and then the process exits.
#[cfg(target_os = "linux")]
#[test]
fn a_stop_waits_for_a_job_that_is_nearly_done() {
    let directory = tempfile::tempdir().unwrap();
    let mut command = serve(directory.path(), "127.0.0.1:0");
    command.env("PROSOPON_DRAIN_S", "60");
    let mut server = Server::spawn(command);
    let session = server.session();
    server.upload(&format!("{session}/tissue"), &crate::routes::tissue::slab(1.0)).ok();
    let paths = json!([{"segment": 1, "waypoints": [{"t": 1, "translation_mm": [0.5, 0, 2]}]}]);
    let plan = server.post(&format!("{session}/plans"), &json!({"paths": paths})).ok()["id"].clone();
    let job = server.post(&format!("{session}/jobs"), &json!({"plan": plan, "model": "nonlinear", "steps": 8})).ok();
    let own = job["links"]["self"].as_str().unwrap().to_owned();
    while server.get(&own).ok()["step"].as_u64().unwrap() < 1 {
        std::thread::park_timeout(Duration::from_millis(10));
    }
    let pid = server.child.id().to_string();
    assert!(Command::new("kill").args(["-TERM", &pid]).status().unwrap().success());
    server.child.wait().unwrap();
    let server = Server::start(directory.path(), &[]);
    let view = server.get(&own).ok();
    assert_eq!((&view["status"], &view["attempt"]), (&json!("succeeded"), &json!(1)), "{view}");
}
