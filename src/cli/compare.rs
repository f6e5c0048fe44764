use std::io::Write;
use std::path::{Path, PathBuf};

use clap::Args;
use serde::Deserialize;

use super::{CommandResult, refuse_overwriting};
use prosopon_contract::{Check, FileFaults, RegionRequest, RegisterOn, chain};
use prosopon_formats::export::{SurfaceView, ply, vtp};
use prosopon_formats::import::{Limits, detect_surface, surface};
use prosopon_geometry::TriMesh;
use prosopon_geometry::control::Control;
use prosopon_jobs::{Compared, Comparison, FaceAnchors, Prediction};
use prosopon_planning::evaluate::Mask;
use prosopon_session::{Numerics, error_sheet};

/// Arguments of `prosopon compare`.
#[derive(Debug, Args)]
pub(super) struct CompareArguments {
    /// Predicted surface: STL, PLY, OBJ, VTP; mm.
    prediction: PathBuf,
    /// Reference surface in the same formats.
    reference: PathBuf,
    /// Skin at rest, with the vertices of the prediction: error.json then says what no prediction would score.
    #[arg(long)]
    rest: Option<PathBuf>,
    /// Align the prediction rigidly with the reference first, on all vertices (ignoring the worst pairs) or on --unaltered.
    #[arg(long)]
    register: bool,
    /// Prediction vertices that count: JSON list of parts ({min_mm, max_mm} or {centre_mm, radius_mm}), or of true/false per
    /// vertex.
    #[arg(long)]
    mask: Option<PathBuf>,
    /// Prediction vertices that registration uses, in the format of --mask.
    #[arg(long, requires = "register")]
    unaltered: Option<PathBuf>,
    /// Parts that are excluded from the comparison and from registration: JSON with a list of parts.
    #[arg(long)]
    exclude: Option<PathBuf>,
    /// Also exclude the eyes, for an upright adult face in LPS; their position is estimated from adult proportions.
    #[arg(long)]
    exclude_eyes: bool,
    /// Folder to write error.json, error.png, error.ply and error.vtp to.
    #[arg(long)]
    out: PathBuf,
}

/// Parts of space, or one entry per vertex.
#[derive(Debug, Deserialize)]
#[serde(untagged)]
enum MaskFile {
    Vertices(Vec<bool>),
    Parts(Vec<RegionRequest>),
}

pub(super) fn run(a: &CompareArguments) -> CommandResult {
    let mut stderr = std::io::stderr();
    let files = [Some(&a.prediction), Some(&a.reference), a.rest.as_ref()];
    let masks = [a.mask.as_ref(), a.unaltered.as_ref(), a.exclude.as_ref()];
    let read: Vec<PathBuf> = files.into_iter().chain(masks).flatten().cloned().collect();
    for name in ["error.json", "error.png", "error.ply", "error.vtp"] {
        refuse_overwriting(&a.out.join(name), &read)?;
    }
    let (prediction, reference) = (load(&a.prediction, &mut stderr)?, load(&a.reference, &mut stderr)?);
    let rest = a.rest.as_deref().map(|path| load(path, &mut stderr)).transpose()?;
    if rest.as_ref().is_some_and(|rest| rest.triangles() != prediction.triangles()) {
        return Err("--rest: the file has other triangles than the prediction".into());
    }
    let mask = a.mask.as_deref().map(mask_of).transpose()?.unwrap_or_default();
    let region = a.unaltered.as_deref().map(mask_of).transpose()?.unwrap_or_default();
    let exclude = a.exclude.as_deref().map(mask_of).transpose()?.unwrap_or_default();
    if exclude.vertices.is_some() {
        return Err("--exclude: the file lists vertices; give a list of parts".into());
    }
    let comparison = Comparison {
        prediction: Prediction {
            mesh: prediction,
            displacement_mm: None,
            rest,
            face: a.exclude_eyes.then(FaceAnchors::default),
            bone: Err("the bone is not known: the prediction is a file".to_owned()),
        },
        reference,
        predictions: None,
        reference_name: a.reference.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned()),
        mask,
        exclude: exclude.only,
        exclude_eyes: a.exclude_eyes,
        face_only: false,
        register: a.register.then(|| RegisterOn { region, ..RegisterOn::default() }),
    };
    let engine = Numerics::new(Limits::default());
    let done = comparison.run(&engine, &Control::new()).map_err(|halt| prosopon_contract::Fault::from(halt).detail)?;
    write(&a.out, &done)?;
    for (name, value) in done.document.lines() {
        writeln!(std::io::stdout(), "{name:26} {value}")?;
    }
    if let Some(no_prediction) = done.document.baselines.as_ref().and_then(|b| b.no_prediction.as_ref()) {
        writeln!(std::io::stdout(), "{:26} {:.2} mm", "no prediction, absolute", no_prediction.whole.mean_abs_mm)?;
    }
    for warning in &done.document.findings.warnings {
        writeln!(stderr, "warning: {warning}")?;
    }
    Ok(())
}

fn write(folder: &Path, done: &Compared) -> CommandResult {
    std::fs::create_dir_all(folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    let mut scalars = vec![("error_mm", done.error_mm.as_slice())];
    scalars.extend(done.correspondence_mm.as_deref().map(|c| ("correspondence_mm", c)));
    let view = SurfaceView { mesh: &done.mesh, scalars: &scalars, colours: None };
    for (name, bytes) in [
        ("error.json", serde_json::to_vec_pretty(&done.document)?),
        ("error.png", error_sheet(&done.mesh, &done.error_mm, &done.document)),
        ("error.ply", ply(&view)),
        ("error.vtp", vtp(&view)),
    ] {
        let path = folder.join(name);
        std::fs::write(&path, bytes).map_err(|e| format!("{}: {e}", path.display()))?;
    }
    Ok(())
}

fn load(path: &Path, stderr: &mut dyn Write) -> Result<TriMesh, Box<dyn std::error::Error>> {
    let bytes = std::fs::read(path).map_err(|e| format!("{}: {e}", path.display()))?;
    let format = detect_surface(&bytes).ok_or_else(|| format!("{}: unknown surface format", path.display()))?;
    let read = surface(&bytes, format, &Limits::default());
    let (mesh, warnings) = read.map_err(|e| format!("{}: {}", path.display(), chain(&e)))?;
    for warning in warnings {
        writeln!(stderr, "{}: {warning}", path.display())?;
    }
    Ok(mesh)
}

fn mask_of(path: &Path) -> Result<Mask, Box<dyn std::error::Error>> {
    let text = std::fs::read(path).map_err(|e| format!("{}: {e}", path.display()))?;
    let unusable = |detail: String| format!("{}: {detail}", path.display());
    let file: MaskFile = serde_json::from_slice(&text)
        .map_err(|_| unusable("the file is neither a list of parts nor a list of true and false".to_owned()))?;
    Ok(match file {
        // An empty list selects all vertices, as over HTTP.
        MaskFile::Vertices(vertices) if vertices.is_empty() => Mask::default(),
        MaskFile::Vertices(vertices) => Mask { vertices: Some(vertices), ..Mask::default() },
        MaskFile::Parts(parts) => {
            let mut check = Check::default();
            let only = parts.iter().enumerate().filter_map(|(i, p)| p.part(&format!("/{i}"), &mut check)).collect();
            FileFaults::finish(check).map_err(|faults| unusable(faults.to_string()))?;
            Mask { only, ..Mask::default() }
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn masks_are_parts_or_vertices_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("mask.json");
        let read = |text: &str| {
            std::fs::write(&path, text).unwrap();
            mask_of(&path)
        };
        assert_eq!(read("[true, false]").unwrap().vertices, Some(vec![true, false]));
        let parts =
            read(r#"[{"min_mm": [0, 0, 0], "max_mm": [1, 1, 1]}, {"centre_mm": [0, 0, 0], "radius_mm": 9}]"#).unwrap();
        assert_eq!(parts.only.len(), 2);
        for wrong in [
            "{}",
            "[NaN]",
            "[null]",
            "[1, 0]",
            r#"[{"radius_mm": 3}]"#,
            r#"[{"centre_mm": [0, 0, 0], "radius_mm": -3}]"#,
            r#"[{"min_mm": [0, 0, 0], "max_mm": [1, 1, 0]}]"#,
        ] {
            assert!(read(wrong).unwrap_err().to_string().contains("mask.json"), "{wrong}");
        }
    }
}
