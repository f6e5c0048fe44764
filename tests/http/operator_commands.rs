//! Operator commands of the real binary.

use std::path::Path;
use std::process::{Command, Output};

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
fn all_faults_of_a_configuration_are_listed_at_once() {
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("prosopon.toml");
    std::fs::write(&file, "listen = \"0.0.0.0:80\"\nmax_waiting = 0\nspeed = 3\n").unwrap();
    let refused = prosopon(&["config", "check", "--config", text_of(&file)]);
    let message = String::from_utf8(refused.stderr).unwrap();
    assert!(!refused.status.success());
    for word in ["loopback", "max_waiting", "speed", "data"] {
        assert!(message.contains(word), "{word}: {message}");
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
fn unusable_certificates_levels_and_times_fail_the_configuration_check() {
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
        let (fine, message) = check(text.clone());
        assert!(!fine && message.contains(words), "{text}: {message}");
    }
    let (fine, message) = check(with_tls(&tls("cert.pem"), &tls("key.pem")));
    assert!(fine, "{message}");
}

#[test]
fn addresses_are_checked_and_printed_without_passwords() {
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
    let (fine, message) = check("mysql://anna:secret@db.example/plans", "plans", "http://127.0.0.1:1");
    assert!(!fine && !message.contains("secret"), "{message}");
    assert!(
        message.contains("database: is not an address") && message.contains("blobs: `plans` is not an address"),
        "{message}"
    );
    assert!(message.contains("(command line)") && !message.contains(".rs"), "{message}");
    let database = ["--data", "d", "--database", "postgres://db.example/plans"];
    for role in [&["worker"][..], &["serve", "--no-worker"]] {
        let message = String::from_utf8(prosopon(&[role, &database].concat()).stderr).unwrap();
        assert!(message.contains("blobs: API and worker processes on one database need a common bucket"), "{message}");
    }
    for command in ["migrate", "audit"] {
        let verify: &[&str] = if command == "audit" { &["verify", "--data", "d"] } else { &[] };
        let database = ["--database", "mysql://anna:secret@db.example/plans"];
        let refused = prosopon(&[&[command], verify, &database].concat());
        let message = String::from_utf8(refused.stderr).unwrap();
        assert!(
            !refused.status.success() && message.contains("is not an address") && !message.contains("secret"),
            "{message}"
        );
    }
}

#[test]
fn a_new_key_passes_the_configuration_check() {
    for (arguments, words) in [
        (["--id", "a b", "--tenant", "local"], "letters"),
        (["--id", "front", "--tenant", "Hospital A"], "tenant"),
        (["--id", "front", "--scopes", "read,fly"], "fly"),
    ] {
        let refused = prosopon(&[&["auth", "key"], &arguments[..]].concat());
        let message = String::from_utf8(refused.stderr).unwrap();
        assert!(!refused.status.success() && message.contains(words) && refused.stdout.is_empty(), "{message}");
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
fn a_backup_needs_a_store_and_a_directory_outside_it() {
    let directory = tempfile::tempdir().unwrap();
    let data = directory.path().join("data");
    let refused = |arguments: &[&str], words: &str| {
        let done = prosopon(arguments);
        let message = String::from_utf8(done.stderr).unwrap();
        assert!(!done.status.success() && message.contains(words), "{arguments:?}: {message}");
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
fn removed_entries_of_the_audit_log_are_detected() {
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
    let message = String::from_utf8(verify().stderr).unwrap();
    assert!(message.contains("after number 3 were removed"), "{message}");
    // A start of the service on this log records the gap.
    let server = Server::start(directory.path(), &[]);
    server.session();
    drop(server);
    let message = String::from_utf8(verify().stderr).unwrap();
    assert!(message.contains("removed"), "{message}");
    assert!(std::fs::read_to_string(&log).unwrap().contains("entries before this one were removed"));
}

#[test]
fn a_backup_of_a_running_service_can_be_restored() {
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

#[test]
fn a_database_of_another_format_is_refused() {
    let directory = tempfile::tempdir().unwrap();
    std::fs::write(directory.path().join("prosopon.sqlite"), [b'x'; 5000]).unwrap();
    let output = serve(directory.path(), "127.0.0.1:0").output().unwrap();
    assert!(!output.status.success());
    let message = String::from_utf8_lossy(&output.stderr);
    assert!(
        message.contains("not of this version's format") && message.contains("name another directory"),
        "{message}"
    );
    assert!(message.contains(&directory.path().display().to_string()), "{message}");
}

#[test]
fn a_public_address_without_authentication_is_refused() {
    let directory = tempfile::tempdir().unwrap();
    let output = serve(directory.path(), "0.0.0.0:0").output().unwrap();
    assert!(!output.status.success());
    let message = String::from_utf8_lossy(&output.stderr);
    assert!(message.contains("without authentication") && message.contains("0.0.0.0:0"), "{message}");
}

/// The store of an earlier demo may be of any version, and its results must not be mistaken for new ones.
#[test]
fn a_demo_deletes_earlier_results_in_its_directory() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name);
    std::fs::create_dir_all(at("service/blobs/x")).unwrap();
    std::fs::create_dir(at("steps")).unwrap();
    for name in ["service/prosopon.sqlite", "service/blobs/x/y", "report.json", "steps/07.glb", "notes.txt"] {
        std::fs::write(at(name), [b'x'; 5000]).unwrap();
    }
    let output = Command::new(env!("CARGO_BIN_EXE_prosopon"))
        .args(["demo", "--skin", "absent.stl", "--skull", "absent.stl", "--out"])
        .arg(directory.path())
        .output()
        .unwrap();
    let message = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success() && message.contains("absent.stl"), "{message}");
    for (name, stays) in
        [("service/blobs/x/y", false), ("report.json", false), ("steps/07.glb", false), ("notes.txt", true)]
    {
        assert_eq!(at(name).exists(), stays, "{name}");
    }
}

/// `prosopon check` reads files as the service does, and fails when one cannot be used.
#[test]
fn files_are_checked_without_a_session() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        path
    };
    let mut ras = prosopon_formats::export::stl(&crate::support::shapes::cube([10.0, 20.0, 30.0], 100.0));
    ras[..80].fill(b' ');
    ras[..9].copy_from_slice(b"SPACE=RAS");
    let good = [
        file("skin.stl", &ras),
        file("points.fcsv", b"# Markups fiducial file version = 4.11\n# CoordinateSystem = RAS\n# columns = id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label,desc,associatedNodeID\n1,10,-20,30,0,0,0,1,1,1,0,ANS,,\n"),
        file("move.tfm", b"#Insight Transform File V1.0\n#Transform 0\nTransform: TranslationTransform_double_3_3\nParameters: 1.5 -6 -1.25\nFixedParameters:\n"),
    ];
    let check = |files: &[std::path::PathBuf], more: &[&str]| {
        Command::new(env!("CARGO_BIN_EXE_prosopon")).arg("check").args(files).args(more).output().unwrap()
    };
    let checked = check(&good, &["--json"]);
    assert!(checked.status.success(), "{checked:?}");
    let found: serde_json::Value = serde_json::from_slice(&checked.stdout).unwrap();
    let files = &found["files"];
    assert_eq!((&files[0]["kind"], &files[0]["min_mm"][0]), (&json!("surface"), &json!(-110.0)), "{found}");
    assert_eq!(files[0]["notes"][0]["code"], "stated-frame", "{found}");
    assert_eq!(
        (&files[1]["kind"], &files[1]["points"]["ans"]),
        (&json!("landmarks"), &json!([-10.0, 20.0, 30.0])),
        "{found}"
    );
    assert_eq!((&files[2]["kind"], &files[2]["matrix"][1][3]), (&json!("transform"), &json!(-6.0)), "{found}");
    let text = String::from_utf8(check(&good, &[]).stdout).unwrap();
    assert!(
        text.contains("note stated-frame") && text.contains("200.0 mm wide") && text.contains("rigid transform"),
        "{text}"
    );
    let bad = [file("broken.stl", b"solid \0 nothing"), good[0].clone()];
    let refused = check(&bad, &[]);
    assert!(!refused.status.success());
    let text = String::from_utf8(refused.stdout).unwrap();
    assert!(text.contains("broken.stl: CANNOT BE USED") && text.contains("skin.stl: surface"), "{text}");
}
