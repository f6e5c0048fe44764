//! The direction of imports between rooms, and what pure rooms may not name, as stated in `src/lib.rs`.

#![allow(clippy::unwrap_used, reason = "a test's own reading of the tree")]

use std::fs;
use std::path::{Path, PathBuf};

/// Rooms from the bottom up; a room may import only rooms listed before it.
const ROOMS: &[&str] = &[
    "control",
    "geometry",
    "import",
    "export",
    "surface",
    "phantom",
    "field",
    "mesh",
    "fem",
    "plan",
    "evaluate",
    "simulate", // wall
    "bench",
    "trace",
    "store",
    "session",
    "jobs",
    "http",
    "config",
    "telemetry",
    "serve",
    "demo",
    "cli",
];
const FIRST_ROOM_ABOVE_WALL: &str = "bench";
const FOREIGN_BELOW_WALL: &[&str] = &[
    "axum",
    "tokio",
    "tower",
    "serde_json",
    "sqlx",
    "object_store",
    "std::fs",
    "std::net",
    "std::env",
    "std::time",
    "SystemTime",
    "Instant",
    "tracing",
    "println!",
    "ThreadPoolBuilder",
];

fn files_below(path: &Path, found: &mut Vec<PathBuf>) {
    let mut entries: Vec<_> = fs::read_dir(path).unwrap().map(|e| e.unwrap().path()).collect();
    entries.sort();
    for entry in entries {
        if entry.is_dir() {
            files_below(&entry, found);
        } else if entry.extension().is_some_and(|e| e == "rs") {
            found.push(entry);
        }
    }
}

/// Breaches in one file of `room`: upward imports, and foreign words in pure rooms. Comment lines and what follows
/// `#[cfg(test)]` at the margin do not count.
fn breaches(room: &str, text: &str) -> Vec<String> {
    let rank = |name: &str| ROOMS.iter().position(|r| *r == name);
    let Some(own) = rank(room) else { return vec![format!("room `{room}` is not in the list")] };
    let pure = own < rank(FIRST_ROOM_ABOVE_WALL).unwrap();
    let mut found = Vec::new();
    let production = text.split("\n#[cfg(test)]\nmod ").next().unwrap_or(text);
    for line in production.lines().map(str::trim).filter(|l| !l.starts_with("//")) {
        for (at, _) in line.match_indices("crate::") {
            let name: String = line[at + 7..].chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
            if let Some(other) = rank(&name)
                && other > own
            {
                found.push(format!("imports `{name}` from below: {line}"));
            }
        }
        if pure {
            for word in FOREIGN_BELOW_WALL.iter().filter(|w| line.contains(**w)) {
                found.push(format!("names `{word}`: {line}"));
            }
        }
    }
    found
}

#[test]
fn rooms_import_only_rooms_above_them_and_pure_rooms_stay_pure() {
    let src = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut files = Vec::new();
    files_below(&src, &mut files);
    let mut found = Vec::new();
    for file in files {
        let inside = file.strip_prefix(&src).unwrap();
        let first = inside.components().next().unwrap().as_os_str().to_string_lossy().replace(".rs", "");
        let is_test = inside.components().any(|c| {
            let name = c.as_os_str().to_string_lossy();
            name == "tests" || name.trim_end_matches(".rs").ends_with("tests") || name.starts_with("test_")
        });
        if is_test || matches!(first.as_str(), "lib" | "main") {
            continue;
        }
        for breach in breaches(&first, &fs::read_to_string(&file).unwrap()) {
            found.push(format!("{}: {breach}", inside.display()));
        }
    }
    assert!(found.is_empty(), "{}", found.join("\n"));
}

#[test]
fn a_planted_breach_is_caught() {
    assert_eq!(breaches("field", "use crate::simulate::Fields;").len(), 1);
    assert_eq!(breaches("field", "let t = std::time::Instant::now();").len(), 2);
    assert_eq!(breaches("http", "use crate::field::DistanceField;").len(), 0);
    assert_eq!(breaches("attic", "").len(), 1);
}
