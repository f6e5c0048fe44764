use std::fs;
use std::path::{Path, PathBuf};

use serde_json::{Map, Value, json};

use super::{DemoArgs, DemoError};
use prosopon_formats::export;
use prosopon_planning::phantom;

/// Files and landmarks to upload.
#[derive(Debug)]
pub(super) struct Patient {
    pub(super) ct: Option<PathBuf>,
    pub(super) surfaces: Option<(PathBuf, PathBuf)>,
    /// Body of `PUT /v1/sessions/{s}/landmarks`; `None` without a landmarks file.
    pub(super) landmarks: Option<Value>,
}

/// Spacing at which the phantom's surfaces are sampled, mm.
const PHANTOM_SPACING_MM: f64 = 1.5;

impl Patient {
    pub(super) fn of(args: &DemoArgs) -> Result<Self, DemoError> {
        let input = args.ct.as_ref().or(args.skin.as_ref());
        let Some(input) = input else { return Self::phantom(args) };
        let beside = input.with_file_name("landmarks.json");
        let file = args.landmarks.clone().or_else(|| beside.is_file().then_some(beside));
        let landmarks = file.map(|f| read_landmarks(&f)).transpose()?;
        let surfaces = args.skin.clone().zip(args.skull.clone());
        Ok(Self { ct: args.ct.clone(), surfaces, landmarks })
    }

    fn phantom(args: &DemoArgs) -> Result<Self, DemoError> {
        let head = phantom::head();
        let folder = args.out.join("phantom");
        fs::create_dir_all(&folder).map_err(|e| DemoError::file(&folder, e))?;
        let write = |name: &str, solid: &dyn prosopon_geometry::Implicit| {
            let path = folder.join(name);
            let surface = phantom::surface_of(solid, &head.bounds(), PHANTOM_SPACING_MM);
            let bytes = surface.map(|s| export::stl(&s)).unwrap_or_default();
            fs::write(&path, bytes).map_err(|e| DemoError::file(&path, e))?;
            Ok::<_, DemoError>(path)
        };
        let surfaces = (write("skin.stl", head.skin.as_ref())?, write("skull.stl", head.skull.as_ref())?);
        let landmarks = match &args.landmarks {
            Some(file) => read_landmarks(file)?,
            None => phantom_landmarks(&head.landmarks),
        };
        let path = folder.join("landmarks.json");
        let text = format!("{landmarks:#}\n");
        fs::write(&path, text).map_err(|e| DemoError::file(&path, e))?;
        Ok(Self { ct: None, surfaces: Some(surfaces), landmarks: Some(landmarks) })
    }
}

fn phantom_landmarks(known: &phantom::Landmarks) -> Value {
    let points: Map<String, Value> =
        known.points.iter().map(|(name, p)| (name.clone(), json!([p.x, p.y, p.z]))).collect();
    let (point, normal) = known.le_fort_1_plane;
    json!({
        "points": points,
        "midline_x_mm": known.midline_x_mm,
        "occlusal_plane_z_mm": known.occlusal_plane_z_mm,
        "le_fort_1_plane": { "point_mm": [point.x, point.y, point.z], "normal": [normal.x, normal.y, normal.z] },
    })
}

/// Reads a landmarks file, which is a body of the service's request.
fn read_landmarks(path: &Path) -> Result<Value, DemoError> {
    let text = fs::read_to_string(path).map_err(|e| DemoError::file(path, e))?;
    serde_json::from_str(&text)
        .map_err(|e| DemoError::Landmarks { path: path.display().to_string(), detail: e.to_string() })
}
