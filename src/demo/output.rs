use std::fs;
use std::path::{Path, PathBuf};

use super::DemoError;
use prosopon_formats::import;
use prosopon_geometry::{TriMesh, Vector};
use prosopon_planning::evaluate::{Layer, View, moved_along, render_panels};

/// Names of the results other than the steps.
const RESULTS: [&str; 7] = [
    "report.json",
    "profile.svg",
    "error.json",
    "error.png",
    "before_after.png",
    "before_after_front.png",
    "before_after_profile.png",
];

/// Writes a result, overwriting an existing file.
pub(super) fn write(folder: &Path, name: &str, bytes: &[u8]) -> Result<(), DemoError> {
    let path = folder.join(name);
    if let Some(parent) = path.parent() {
        fs::create_dir_all(parent).map_err(|e| DemoError::file(parent, e))?;
    }
    fs::write(&path, bytes).map_err(|e| DemoError::file(&path, e))
}

/// Removes the results of an earlier run, so that none is mistaken for a new one.
///
/// # Errors
/// [`DemoError::File`].
pub fn clear(folder: &Path) -> Result<(), DemoError> {
    let steps = fs::read_dir(folder.join("steps")).into_iter().flatten().flatten().map(|entry| entry.path());
    let is_ours = |path: &PathBuf| path.extension().is_some_and(|e| e == "glb" || e == "ply");
    for path in RESULTS.iter().map(|name| folder.join(name)).chain(steps.filter(is_ours)) {
        match fs::remove_file(&path) {
            Err(error) if error.kind() != std::io::ErrorKind::NotFound => return Err(DemoError::file(&path, error)),
            _ => {}
        }
    }
    Ok(())
}

/// Size of a picture with three panels and the colour bar, pixels.
const PICTURE_PX: [u32; 2] = [1640, 720];

/// Draws the skin before and after and its forward movement, in three-quarter, profile and front view.
pub(super) fn before_after(out: &Path, before_ply: &[u8], after_ply: &[u8]) -> Result<(), DemoError> {
    let before = surface("skin before", before_ply)?;
    let after = surface("skin after", after_ply)?;
    let moved = moved_along(&before, &after, &-Vector::y());
    for (name, direction) in [
        ("before_after.png", Vector::new(-0.7, 0.7, 0.0)),
        ("before_after_profile.png", Vector::new(-1.0, 0.0, 0.0)),
        ("before_after_front.png", Vector::new(0.0, 1.0, 0.0)),
    ] {
        let view = View { direction: direction.normalize(), up: Vector::z(), size_px: PICTURE_PX };
        let plain = |mesh| Layer { mesh, values: None };
        let panels = [
            ("before", plain(&before)),
            ("after", plain(&after)),
            ("moved forward", Layer { mesh: &after, values: Some(moved.coloured()) }),
        ];
        write(out, name, &render_panels(&panels, &view))?;
    }
    Ok(())
}

fn surface(what: &'static str, ply: &[u8]) -> Result<TriMesh, DemoError> {
    let read = import::surface(ply, import::SurfaceFormat::Ply, &import::Limits::default());
    read.map(|(mesh, _)| mesh).map_err(|_| DemoError::Answer { path: what.to_owned(), field: "surface" })
}
