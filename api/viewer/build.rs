//! Builds the viewer with npm, as a copy in the build folder. Without npm, or where that fails, the program has no viewer, and
//! `/` says how to get it.

use std::io::{Error, Result};
use std::path::{Path, PathBuf};
use std::process::Command;

/// The viewer and the client that it is built from, below the repository.
const FOLDERS: [&str; 2] = ["api/viewer", "api/clients/typescript"];
/// What npm makes.
const MADE: [&str; 2] = ["node_modules", "dist"];

fn main() -> Result<()> {
    let variable = |name: &str| std::env::var_os(name).map(PathBuf::from).ok_or_else(|| Error::other(name));
    let (root, out) = (variable("CARGO_MANIFEST_DIR")?.join("../.."), variable("OUT_DIR")?);
    // The folder is embedded, so that it must exist.
    let embedded = out.join("viewer");
    empty(&embedded)?;
    for folder in FOLDERS {
        empty(&out.join(folder))?;
        copy(&root.join(folder), &out.join(folder))?;
    }
    println!("cargo::rerun-if-env-changed=PATH");
    let built = built(&out.join(FOLDERS[0]));
    match built.and_then(|folder| copy(&folder, &embedded)) {
        Ok(()) => {}
        Err(why) => println!("cargo::warning=the program is built without the viewer at `/`: {why}"),
    }
    Ok(())
}

/// The folder with the built viewer.
fn built(folder: &Path) -> Result<PathBuf> {
    npm(folder, &["ci", "--ignore-scripts", "--no-audit", "--no-fund"])?;
    npm(folder, &["run", "build"])?;
    Ok(folder.join("dist"))
}

fn npm(folder: &Path, arguments: &[&str]) -> Result<()> {
    let program = if cfg!(windows) { "npm.cmd" } else { "npm" };
    let done = Command::new(program).args(arguments).current_dir(folder).output();
    let done = done.map_err(|e| Error::other(format!("npm cannot be run ({e}); install Node.js 20.19 or later")))?;
    if done.status.success() {
        return Ok(());
    }
    let text = String::from_utf8_lossy(&[done.stdout, done.stderr].concat()).into_owned();
    let lines: Vec<&str> = text.lines().filter(|line| !line.trim().is_empty()).collect();
    let last = lines.get(lines.len().saturating_sub(3)..).unwrap_or_default().join("; ");
    Err(Error::other(format!("`npm {}` failed: {last}", arguments.join(" "))))
}

fn empty(folder: &Path) -> Result<()> {
    if folder.exists() {
        std::fs::remove_dir_all(folder)?;
    }
    std::fs::create_dir_all(folder)
}

/// Copies a folder, without what npm makes in the sources; a change of a file in it builds the viewer again.
fn copy(from: &Path, to: &Path) -> Result<()> {
    std::fs::create_dir_all(to)?;
    for entry in std::fs::read_dir(from)? {
        let entry = entry?;
        let (path, name) = (entry.path(), entry.file_name());
        if MADE.iter().any(|made| name == *made) {
            continue;
        }
        let target = to.join(&name);
        if entry.file_type()?.is_dir() {
            copy(&path, &target)?;
        } else {
            println!("cargo::rerun-if-changed={}", path.display());
            std::fs::copy(&path, &target)?;
        }
    }
    Ok(())
}
