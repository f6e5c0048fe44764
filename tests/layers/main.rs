//! Architecture rules that Cargo cannot enforce.
//!
//! They limit the direction of imports between the top-level modules of a package, the names that pure packages may use, and the
//! dependencies in their manifests.

#![allow(clippy::unwrap_used, reason = "a test's own reading of the tree")]

mod circles;

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

/// A package: its folder and its top-level modules from the bottom up; each may import only those listed before it.
struct Package {
    folder: &'static str,
    rooms: &'static [&'static str],
    /// Synchronous and pure: no HTTP, no files, no network, no environment, no clock, no threads of its own.
    pure: bool,
}

/// From the bottom up; a package may depend only on packages listed before it.
const PACKAGES: &[Package] = &[
    Package { folder: "src/geometry", rooms: &[], pure: true },
    Package { folder: "src/formats", rooms: &["import", "export"], pure: true },
    Package { folder: "src/field", rooms: &[], pure: true },
    Package { folder: "src/tissue", rooms: &["mesh", "fem"], pure: true },
    Package { folder: "src/planning", rooms: &["surface", "phantom", "plan", "evaluate", "simulate"], pure: true },
    // ---- wall ----
    Package { folder: "src/service/store", rooms: &[], pure: false },
    Package { folder: "src/service/contract", rooms: &[], pure: false },
    Package { folder: "src/service/session", rooms: &[], pure: false },
    Package { folder: "src/service/jobs", rooms: &[], pure: false },
    Package { folder: "src/service", rooms: &["http", "config", "telemetry", "serve"], pure: false },
    Package { folder: "src/study", rooms: &[], pure: false },
    Package { folder: "src", rooms: &["demo", "cli"], pure: false },
];

/// Names that pure packages may not use; crates missing from their manifests cannot be used anyway.
const FOREIGN_WORDS: &[&str] =
    &["std::fs", "std::net", "std::env", "std::time", "SystemTime", "Instant", "println!", "ThreadPoolBuilder"];
/// Dependencies that their manifests may not contain.
const FOREIGN_CRATES: &[&str] = &[
    "axum",
    "figment",
    "hyper",
    "object_store",
    "plotters",
    "postcard",
    "reqwest",
    "serde",
    "serde_json",
    "sqlx",
    "tokio",
    "tokio-util",
    "tower",
    "tower-http",
    "tracing",
    "tracing-subscriber",
    "ureq",
    "utoipa",
];

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// The files of a package's production code, with their paths in the package.
fn files_of(package: &Package) -> Vec<PathBuf> {
    fn below(directory: &Path, package: &Path, found: &mut Vec<PathBuf>) {
        let mut entries: Vec<_> = fs::read_dir(directory).unwrap().map(|e| e.unwrap().path()).collect();
        entries.sort();
        for entry in entries {
            let is_other_package = entry.join("Cargo.toml").exists();
            if entry.is_dir() && !is_other_package {
                below(&entry, package, found);
            } else if entry.extension().is_some_and(|e| e == "rs") {
                found.push(entry.strip_prefix(package).unwrap().to_owned());
            }
        }
    }
    let is_test = |file: &PathBuf| {
        file.components().any(|c| {
            let name = c.as_os_str().to_string_lossy();
            name == "tests" || name.trim_end_matches(".rs").ends_with("tests") || name.starts_with("test_")
        })
    };
    let (folder, mut found) = (root().join(package.folder), Vec::new());
    below(&folder, &folder, &mut found);
    found.retain(|file| !is_test(file));
    found
}

/// The production code of a file, without comment lines and without the text after an unindented `#[cfg(test)] mod`.
fn production(text: &str) -> String {
    let mut before = text;
    for (at, begin) in text.match_indices("\n#[cfg(test)]\nmod ") {
        let declared = text[at + begin.len()..].lines().next().unwrap_or("");
        // A declaration `mod tests;` has nothing below it that belongs to the tests.
        if declared.ends_with('{') {
            before = &text[..at];
            break;
        }
    }
    before.lines().filter(|line| !line.trim_start().starts_with("//")).map(|line| format!("{line}\n")).collect()
}

fn identifier(text: &str) -> &str {
    let end = text.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(text.len());
    &text[..end]
}

/// The names at the beginning of a path or of each path of a group in braces.
fn first_names(path: &str) -> Vec<&str> {
    let Some(group) = path.strip_prefix('{') else { return vec![identifier(path)] };
    let (mut names, mut depth, mut begin) = (Vec::new(), 0usize, 0);
    for (at, c) in group.char_indices() {
        match c {
            '{' => depth += 1,
            '}' if depth > 0 => depth -= 1,
            ',' | '}' if depth == 0 => {
                names.push(identifier(group[begin..at].trim()));
                begin = at + 1;
                if c == '}' {
                    break;
                }
            }
            _ => {}
        }
    }
    names
}

/// The top-level modules that a file names, by `crate::` or by enough `super::` to leave its own.
fn rooms_named<'a>(file: &Path, text: &'a str) -> BTreeSet<&'a str> {
    let mut named = BTreeSet::new();
    for (at, _) in text.match_indices("crate::") {
        named.extend(first_names(&text[at + "crate::".len()..]));
    }
    let modules = file.with_extension("");
    let depth = modules.components().filter(|c| !["mod", "lib"].map(AsRef::as_ref).contains(&c.as_os_str())).count();
    let mut rest = text;
    while let Some(at) = rest.find("super::") {
        rest = &rest[at..];
        let mut up = 0;
        while let Some(above) = rest.strip_prefix("super::") {
            (rest, up) = (above, up + 1);
        }
        if up == depth {
            named.extend(first_names(rest));
        }
    }
    named
}

/// Breaches in one file of a package.
fn breaches(package: &Package, file: &Path, text: &str) -> Vec<String> {
    let text = production(text);
    let mut found = Vec::new();
    let room = file.components().next().unwrap().as_os_str().to_string_lossy().replace(".rs", "");
    if !package.rooms.is_empty() && !["lib", "main"].contains(&room.as_str()) {
        match package.rooms.iter().position(|r| *r == room) {
            None => found.push(format!("module `{room}` is not in the list")),
            Some(own) => {
                let named = rooms_named(file, &text);
                let above = package.rooms[own + 1..].iter().filter(|other| named.contains(**other));
                found.extend(above.map(|other| format!("imports `{other}` from below")));
            }
        }
    }
    if package.pure {
        for (at, _) in text.match_indices("std::{") {
            let named = first_names(&text[at + "std::".len()..]);
            let foreign = named.iter().filter(|name| ["env", "fs", "net", "process", "thread", "time"].contains(*name));
            found.extend(foreign.map(|name| format!("names `std::{name}`")));
        }
        found.extend(FOREIGN_WORDS.iter().filter(|word| text.contains(**word)).map(|word| format!("names `{word}`")));
    }
    found
}

/// Dependencies of a package, including dev-dependencies; both names of a renamed one.
fn dependencies(manifest: &str) -> Vec<String> {
    let name = |text: &str| text.chars().take_while(|c| c.is_alphanumeric() || "-_".contains(*c)).collect::<String>();
    let mut is_list = false;
    let mut found = Vec::new();
    for line in manifest.lines() {
        if line.starts_with('[') {
            let section = line.trim_matches(['[', ']']);
            is_list = section.ends_with("dependencies") && section != "workspace.dependencies";
            found.extend(section.split_once("dependencies.").map(|(_, dependency)| name(dependency)));
        } else if is_list {
            found.push(name(line));
        }
        found.extend(line.split_once("package = \"").map(|(_, package)| name(package)));
    }
    found.retain(|name| !name.is_empty());
    found
}

/// Breaches in the manifest of the package at `index`.
fn manifest_breaches(index: usize, manifest: &str) -> Vec<String> {
    let name = |package: &Package| format!("prosopon-{}", package.folder.rsplit('/').next().unwrap());
    let below: Vec<String> = PACKAGES[..index].iter().map(name).collect();
    let mut found = Vec::new();
    for dependency in dependencies(manifest) {
        if dependency.starts_with("prosopon-") && !below.contains(&dependency) {
            found.push(format!("depends on `{dependency}` from below"));
        }
        if PACKAGES[index].pure && FOREIGN_CRATES.contains(&dependency.as_str()) {
            found.push(format!("depends on `{dependency}`"));
        }
    }
    found
}

#[test]
fn rooms_import_only_rooms_above_them_and_pure_packages_stay_pure() {
    let mut found = Vec::new();
    for (index, package) in PACKAGES.iter().enumerate() {
        for file in files_of(package) {
            let path = root().join(package.folder).join(&file);
            for breach in breaches(package, &file, &fs::read_to_string(&path).unwrap()) {
                found.push(format!("{}: {breach}", path.display()));
            }
        }
        let manifest = root().join(package.folder.trim_end_matches("src")).join("Cargo.toml");
        for breach in manifest_breaches(index, &fs::read_to_string(&manifest).unwrap()) {
            found.push(format!("{}: {breach}", manifest.display()));
        }
    }
    assert!(found.is_empty(), "{}", found.join("\n"));
}

#[test]
fn no_files_of_a_package_import_each_other() {
    let circles = PACKAGES.iter().flat_map(|package| {
        let folder = root().join(package.folder);
        let found = circles::circles_of(&folder, &files_of(package), production);
        found.into_iter().map(|circle| format!("{}: {}", package.folder, circle.join(", ")))
    });
    let circles: Vec<String> = circles.collect();
    assert!(circles.is_empty(), "{}", circles.join("\n"));
}

/// Codes of warnings that the code gives: the first text after the constructor's name.
fn warning_codes(text: &str) -> BTreeSet<String> {
    let made = ["Warning::info(", "Warning::check(", "Warning::unreliable("];
    let calls = made.iter().flat_map(|call| text.match_indices(call).map(|(at, _)| &text[at + call.len()..]));
    calls.filter_map(|rest| rest.trim_start().strip_prefix('"')?.split('"').next()).map(str::to_owned).collect()
}

#[test]
fn the_page_of_warnings_lists_every_code() {
    let (mut given, mut sources) = (BTreeSet::new(), String::new());
    for package in PACKAGES {
        for file in files_of(package) {
            let text = production(&fs::read_to_string(root().join(package.folder).join(&file)).unwrap());
            given.extend(warning_codes(&text));
            sources.push_str(&text);
        }
    }
    let page = fs::read_to_string(root().join("api/warnings.md")).unwrap();
    let listed: BTreeSet<&str> = page.lines().filter_map(|line| line.strip_prefix("| `")?.split('`').next()).collect();
    let missing: Vec<&String> = given.iter().filter(|code| !listed.contains(code.as_str())).collect();
    let unknown: Vec<&&str> = listed.iter().filter(|code| !sources.contains(&format!("\"{code}\""))).collect();
    assert!(missing.is_empty() && unknown.is_empty(), "not on the page: {missing:?}; not in the code: {unknown:?}");
}

#[test]
fn every_member_of_the_workspace_is_listed() {
    let manifest = fs::read_to_string(root().join("Cargo.toml")).unwrap();
    let members = manifest.split("members = [").nth(1).unwrap().split(']').next().unwrap();
    let members: BTreeSet<&str> = members.split('"').filter(|m| m.starts_with("src")).collect();
    let listed: BTreeSet<&str> = PACKAGES.iter().map(|p| p.folder).filter(|f| *f != "src").collect();
    assert_eq!(members, listed);
}

#[test]
fn planted_breaches_are_caught() {
    let package = |folder: &str| PACKAGES.iter().find(|p| p.folder == folder).unwrap();
    let count = |folder: &str, file: &str, text: &str| breaches(package(folder), Path::new(file), text).len();
    assert_eq!(count("src/planning", "plan/cut.rs", "use crate::simulate::Fields;"), 1);
    assert_eq!(count("src/planning", "plan/cut.rs", "use crate::{phantom, evaluate::{Mask, picture}};"), 1);
    assert_eq!(count("src/planning", "plan/cut.rs", "use crate::{\n    evaluate,\n    simulate::Fields,\n};"), 2);
    assert_eq!(count("src/planning", "plan/cut.rs", "let s = super::super::simulate::solve();"), 1);
    assert_eq!(count("src/planning", "plan/mod.rs", "use super::simulate;"), 1);
    assert_eq!(count("src/planning", "plan/cut.rs", "use super::simulate; // a file of the room\n"), 0);
    assert_eq!(count("src/planning", "simulate/run.rs", "use crate::{plan, evaluate};"), 0);
    assert_eq!(count("src/field", "build.rs", "let t = std::time::Instant::now();"), 2);
    assert_eq!(count("src/field", "build.rs", "use std::{fs, sync::Arc};"), 1);
    assert_eq!(count("src/service", "attic/mod.rs", ""), 1);
    assert_eq!(
        manifest_breaches(2, "[dependencies]\ntokio.workspace = true\nprosopon-planning.workspace = true\n").len(),
        2
    );
    assert_eq!(manifest_breaches(2, "[dependencies.tokio]\nversion = \"1\"\n").len(), 1);
    assert_eq!(manifest_breaches(2, "[dev-dependencies]\nt = { package = \"tokio\", version = \"1\" }\n").len(), 1);
    assert_eq!(manifest_breaches(2, "[dependencies]\nprosopon-geometry.workspace = true\n").len(), 0);
}
