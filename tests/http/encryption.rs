//! Encryption at rest, with the real binary.

use std::path::Path;
use std::process::{Command, Output};

use crate::support::binary::{Server, serve};
use crate::support::shapes::skin;

fn is_on_disk(root: &Path, text: &[u8]) -> bool {
    std::fs::read_dir(root).unwrap().map(|e| e.unwrap().path()).any(|p| {
        if p.is_dir() { is_on_disk(&p, text) } else { std::fs::read(p).unwrap().windows(text.len()).any(|w| w == text) }
    })
}

fn prosopon(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_prosopon")).args(arguments).output().unwrap()
}

/// The command must fail with these words.
#[track_caller]
fn refused(done: &Output, words: &str) {
    let message = String::from_utf8_lossy(&done.stderr);
    assert!(!done.status.success() && message.contains(words), "{message}");
}

#[test]
fn a_store_needs_its_key_and_a_backup_shows_nothing() {
    const FACE: &[u8] = b"a recognisable face";
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name).to_str().unwrap().to_owned();
    let (data, out, back, config) = (at("data"), at("out"), at("back"), at("prosopon.toml"));
    let key = || prosopon(&["encryption", "key"]).stdout;
    let key_file = |name: &str, text: &[u8]| {
        std::fs::write(at(name), text).unwrap();
        std::fs::write(&config, format!("[encryption]\nkey_file = {:?}\n", at(name))).unwrap();
    };
    let (old, new) = (key(), key());
    let start = |data: &str| Server::start(Path::new(data), &["--config", &config]);
    key_file("keys", &old);
    let server = start(&data);
    let session = server.session();
    let mut file = skin();
    file[..FACE.len()].copy_from_slice(FACE);
    server.upload(&format!("{session}/skin"), &file).ok();
    let stored = server.get(&format!("{session}/skin")).body;
    assert!(!is_on_disk(Path::new(&data), FACE));
    drop(server);

    // Without the key, with another one, with two ways to give it, with a file that has none.
    refused(&serve(Path::new(&data), "127.0.0.1:0").output().unwrap(), "encrypted with the key");
    let with_config = || prosopon(&["serve", "--data", &data, "--listen", "127.0.0.1:0", "--config", &config]);
    key_file("keys", &new);
    refused(&with_config(), "encrypted with the key");
    std::fs::write(&config, "[encryption]\nkey_file = \"a\"\nkeys = [\"b\"]\n").unwrap();
    refused(&with_config(), "not both");
    key_file("keys", b"# nothing\n");
    refused(&with_config(), "it has no key");
    key_file("keys", &old);
    let printed = prosopon(&["config", "check", "--data", &data, "--config", &config]).stdout;
    let (id, secret) = (&old[2..18], &old[19..83]);
    let holds = |text: &[u8]| printed.windows(text.len()).any(|w| w == text);
    assert!(holds(id) && !holds(secret), "{}", String::from_utf8_lossy(&printed));

    // A new key before the old one: both are read, and the backup is of the new one.
    let both = [new.as_slice(), &old].concat();
    key_file("keys", &both);
    let server = start(&data);
    assert_eq!(server.get(&format!("{session}/skin")).body, stored);
    refused(&prosopon(&["backup", "--data", &data, "--out", &out]), "encrypted with the key");
    let done = prosopon(&["backup", "--data", &data, "--out", &out, "--config", &config]);
    assert!(done.status.success(), "{done:?}");
    assert!(!is_on_disk(Path::new(&out), FACE) && !is_on_disk(Path::new(&out), b"SQLite format 3"));
    drop(server);
    refused(&prosopon(&["restore", "--from", &out, "--data", &back]), "encrypted with the key");
    let done = prosopon(&["restore", "--from", &out, "--data", &back, "--config", &config]);
    assert!(done.status.success(), "{done:?}");
    // `scrub` needs the key too, of a store and of one that was restored.
    for store in [&data, &back] {
        refused(&prosopon(&["scrub", "--data", store]), "encrypted with the key");
        let done = prosopon(&["scrub", "--data", store, "--config", &config]);
        assert!(done.status.success() && String::from_utf8_lossy(&done.stdout).contains("1 values"), "{done:?}");
    }
    assert_eq!(start(&back).get(&format!("{session}/skin")).body, stored);
}
