//! The scene of `prosopon demo`: a Le Fort I osteotomy, the upper jaw 6 mm forward and 1.5 mm down.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::Deserialize;

use super::error::{BenchError, read};
use super::files::read_surface;
use prosopon_formats::import::{Limits, volume};
use prosopon_geometry::control::Control;
use prosopon_geometry::{Motion, Point, Vector};
use prosopon_planning::evaluate::face_regions;
use prosopon_planning::phantom;
use prosopon_planning::plan::{Path as SegmentPath, Plan, le_fort_1};
use prosopon_planning::simulate::{
    Anatomy, CutBone, FieldsSettings, TissueModel, TissueSettings, build_fields, build_tissue, cut_bone,
};
use prosopon_planning::surface::{CtSettings, from_ct};
use prosopon_tissue::mesh::MeshSettings;

/// Where the upper jaw goes, mm, LPS.
const MOVED_MM: [f64; 3] = [0.0, -6.0, -1.5];
/// Spacing at which the phantom's surfaces are sampled, mm.
const PHANTOM_SPACING_MM: f64 = 1.5;

/// The head that a study is made on.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum HeadSource {
    /// The generated one.
    Phantom,
    /// A folder with `landmarks.json` and a CT (`*.nii.gz`), or with surfaces whose names begin with `skin` and `skull`.
    Folder(PathBuf),
}

impl std::str::FromStr for HeadSource {
    type Err = std::convert::Infallible;

    fn from_str(word: &str) -> Result<Self, Self::Err> {
        Ok(if word == "phantom" { Self::Phantom } else { Self::Folder(word.into()) })
    }
}

impl HeadSource {
    /// As it was given.
    pub(super) fn word(&self) -> String {
        match self {
            Self::Phantom => "phantom".to_owned(),
            Self::Folder(folder) => folder.display().to_string(),
        }
    }

    /// For a chart.
    pub(super) fn name(&self) -> String {
        match self {
            Self::Phantom => "phantom".to_owned(),
            Self::Folder(folder) => {
                folder.file_name().map_or_else(|| self.word(), |n| n.to_string_lossy().into_owned())
            }
        }
    }
}

/// Surfaces of a head and where it is cut.
#[derive(Debug)]
pub(super) struct Head {
    pub(super) anatomy: Anatomy,
    le_fort_1_plane: (Point, Vector),
    midline_x_mm: f64,
    occlusal_plane_z_mm: f64,
}

/// What the solver is given.
#[derive(Debug)]
pub(super) struct Prepared {
    pub(super) tissue: TissueModel,
    pub(super) bone: CutBone,
    pub(super) plan: Plan,
}

#[derive(Deserialize)]
struct LandmarksFile {
    landmarks: BTreeMap<String, [f64; 3]>,
    midline_x_mm: f64,
    occlusal_plane_z_mm: f64,
    le_fort_1_plane: PlaneWord,
}

#[derive(Deserialize)]
struct PlaneWord {
    point: [f64; 3],
    normal: [f64; 3],
}

impl Head {
    pub(super) fn load(source: &HeadSource) -> Result<Self, BenchError> {
        match source {
            HeadSource::Phantom => Self::phantom(),
            HeadSource::Folder(folder) => Self::of_folder(folder),
        }
    }

    fn phantom() -> Result<Self, BenchError> {
        let head = phantom::head();
        let sampled = |solid| {
            phantom::surface_of(solid, &head.bounds(), PHANTOM_SPACING_MM)
                .ok_or_else(|| BenchError::Head { detail: "the phantom has no surface".to_owned() })
        };
        let (skin, skull) = (sampled(head.skin.as_ref())?, sampled(head.skull.as_ref())?);
        Ok(Self {
            anatomy: Anatomy { skin, skull, air: None, soft_tissue: None, landmarks: head.landmarks.points.clone() },
            le_fort_1_plane: head.landmarks.le_fort_1_plane,
            midline_x_mm: head.landmarks.midline_x_mm,
            occlusal_plane_z_mm: head.landmarks.occlusal_plane_z_mm,
        })
    }

    fn of_folder(folder: &Path) -> Result<Self, BenchError> {
        let path = folder.join("landmarks.json");
        let file: LandmarksFile = serde_json::from_slice(&read(&path)?)
            .map_err(|e| BenchError::Landmarks { path: path.clone(), detail: e.to_string() })?;
        let landmarks = file.landmarks.into_iter().map(|(name, p)| (name, Point::from(p))).collect();
        let mut names: Vec<String> = std::fs::read_dir(folder)
            .map_err(|source| BenchError::File { what: "list", path: folder.to_owned(), source })?
            .filter_map(|entry| entry.ok()?.file_name().into_string().ok())
            .collect();
        names.sort_unstable();
        let find = |fits: &dyn Fn(&str) -> bool| names.iter().find(|n| fits(n)).map(|n| folder.join(n));
        let surface =
            |start: &str| find(&|n| n.starts_with(start) && [".stl", ".ply", ".obj"].iter().any(|e| n.ends_with(e)));
        let anatomy =
            match (find(&|n| n.ends_with(".nii.gz") || n.ends_with(".nii")), surface("skin"), surface("skull")) {
                (Some(ct), _, _) => of_ct(&ct, landmarks)?,
                (None, Some(skin), Some(skull)) => Anatomy {
                    skin: read_surface(&skin)?,
                    skull: read_surface(&skull)?,
                    air: None,
                    soft_tissue: None,
                    landmarks,
                },
                _ => {
                    let detail =
                        format!("{} has neither a CT (*.nii.gz) nor skin.* and skull.* surfaces", folder.display());
                    return Err(BenchError::Head { detail });
                }
            };
        Ok(Self {
            anatomy,
            le_fort_1_plane: (file.le_fort_1_plane.point.into(), file.le_fort_1_plane.normal.into()),
            midline_x_mm: file.midline_x_mm,
            occlusal_plane_z_mm: file.occlusal_plane_z_mm,
        })
    }

    /// Which vertices of the skin belong to the face.
    pub(super) fn face(&self) -> Vec<bool> {
        let (regions, _) = face_regions(&self.anatomy.skin, &self.anatomy.landmarks, Some(self.midline_x_mm));
        self.anatomy.skin.positions().iter().map(|p| regions.iter().any(|r| r.bounds.contains(p))).collect()
    }

    /// Fields, cut bone, mesh and path.
    pub(super) fn prepare(&self, edge_mm: f64) -> Result<Prepared, BenchError> {
        let (control, settings) = (Control::new(), FieldsSettings::default());
        let fields = build_fields(&self.anatomy, &settings, &control)?;
        let cuts =
            le_fort_1(self.le_fort_1_plane, self.midline_x_mm, self.occlusal_plane_z_mm, [None; 2], &fields.bone);
        let bone = cut_bone(&fields.bone, &cuts, &settings.field, &control)?;
        // The template's first cut is the Le Fort I plane.
        let jaw = bone.osteotomy.segments.iter().find(|s| s.id != 0 && s.bounded_by.contains(&0));
        let jaw = jaw.ok_or_else(|| BenchError::Head { detail: "no segment below the Le Fort I plane".to_owned() })?.id;
        let mesh = MeshSettings { edge_mm, ..MeshSettings::default() };
        let tissue_settings = TissueSettings { mesh, ..TissueSettings::default() };
        let tissue = build_tissue(&self.anatomy, &fields, Some(&bone), &tissue_settings, &control)?;
        let [x, y, z] = MOVED_MM;
        let path = SegmentPath::new(jaw, vec![(1.0, Motion::translation(x, y, z))])
            .map_err(|e| BenchError::Head { detail: e.to_string() })?;
        Ok(Prepared { tissue, bone, plan: Plan { paths: vec![path] } })
    }
}

fn of_ct(path: &Path, landmarks: Vec<(String, Point)>) -> Result<Anatomy, BenchError> {
    let unusable = |detail: String| BenchError::Head { detail: format!("{}: {detail}", path.display()) };
    let (ct, _) = volume(&read(path)?, &Limits::default()).map_err(|e| unusable(e.to_string()))?;
    let found = from_ct(&ct, &CtSettings::default(), &Control::new()).map_err(|e| unusable(e.to_string()))?;
    Ok(Anatomy {
        skin: found.skin,
        skull: found.skull,
        air: found.air,
        soft_tissue: Some(found.soft_tissue),
        landmarks,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_without_a_head_is_refused_with_what_it_lacks() {
        let folder = tempfile::tempdir().unwrap();
        let source: HeadSource = folder.path().to_str().unwrap().parse().unwrap();
        assert!(matches!(Head::load(&source), Err(BenchError::File { .. })));
        let landmarks = r#"{"landmarks": {"ans": [0, 0, 0]}, "midline_x_mm": 0, "occlusal_plane_z_mm": -20,
            "le_fort_1_plane": {"point": [0, 0, 0], "normal": [0, 0, 1]}}"#;
        std::fs::write(folder.path().join("landmarks.json"), landmarks).unwrap();
        match Head::load(&source) {
            Err(BenchError::Head { detail }) => assert!(detail.contains("neither a CT"), "{detail}"),
            other => panic!("{other:?}"),
        }
    }
}
