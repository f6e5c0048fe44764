//! The scene of `prosopon demo`: a Le Fort I osteotomy that moves the upper jaw 6 mm forward and 1.5 mm down.

use std::path::{Path, PathBuf};

use super::error::{BenchError, read};
use super::files::{read_landmarks, read_surface};
use prosopon_formats::import::{Limits, volume};
use prosopon_geometry::control::Control;
use prosopon_geometry::{Motion, Point, Vector};
use prosopon_planning::evaluate::face_regions;
use prosopon_planning::phantom;
use prosopon_planning::plan::{Landmarks, Path as SegmentPath, Plan, le_fort_1, propose};
use prosopon_planning::simulate::{
    Anatomy, CutBone, Fields, FieldsSettings, TissueModel, TissueSettings, build_fields, build_tissue, cut_bone,
};
use prosopon_planning::surface::{CtSettings, from_ct};
use prosopon_tissue::mesh::MeshSettings;

/// Translation of the upper jaw, LPS mm.
const MOVED_MM: [f64; 3] = [0.0, -6.0, -1.5];
/// Spacing at which the phantom's surfaces are sampled, mm.
const PHANTOM_SPACING_MM: f64 = 1.5;

/// The head that a study uses.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum HeadSource {
    /// The generated phantom, stretched along each axis.
    Phantom(Build),
    /// A folder with a CT (`*.nii.gz`), or with surfaces whose names begin with `skin` and `skull`.
    ///
    /// Most studies also need a file `landmarks.json` in it.
    Folder(PathBuf),
}

/// Proportions of the phantom.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Build {
    /// The phantom as it is generated.
    Usual,
    /// 12 % taller.
    Long,
    /// 10 % narrower and 5 % shorter from front to back.
    Narrow,
}

impl Build {
    const ALL: [(&'static str, Self); 3] =
        [("phantom", Self::Usual), ("phantom-long", Self::Long), ("phantom-narrow", Self::Narrow)];

    fn word(self) -> &'static str {
        Self::ALL.iter().find(|(_, build)| *build == self).map_or("", |(word, _)| word)
    }

    fn stretch(self) -> Vector {
        match self {
            Self::Usual => Vector::repeat(1.0),
            Self::Long => Vector::new(1.0, 1.0, 1.12),
            Self::Narrow => Vector::new(0.9, 0.95, 1.0),
        }
    }
}

impl std::str::FromStr for HeadSource {
    type Err = std::convert::Infallible;

    fn from_str(word: &str) -> Result<Self, Self::Err> {
        let build = Build::ALL.iter().find(|(name, _)| *name == word);
        Ok(build.map_or_else(|| Self::Folder(word.into()), |(_, build)| Self::Phantom(*build)))
    }
}

impl HeadSource {
    /// The word that was given on the command line.
    pub(super) fn word(&self) -> String {
        match self {
            Self::Phantom(build) => build.word().to_owned(),
            Self::Folder(folder) => folder.display().to_string(),
        }
    }

    /// Short name for charts and tables.
    pub(super) fn name(&self) -> String {
        match self {
            Self::Phantom(build) => build.word().to_owned(),
            Self::Folder(folder) => {
                folder.file_name().map_or_else(|| self.word(), |n| n.to_string_lossy().into_owned())
            }
        }
    }
}

/// Surfaces and landmarks of a head.
#[derive(Debug)]
pub(super) struct Head {
    pub(super) anatomy: Anatomy,
    /// Known landmarks; empty for a folder without `landmarks.json`.
    pub(super) landmarks: Landmarks,
}

/// Input of the solver.
#[derive(Debug)]
pub(super) struct Prepared {
    pub(super) tissue: TissueModel,
    pub(super) bone: CutBone,
    pub(super) plan: Plan,
}

impl Head {
    pub(super) fn load(source: &HeadSource) -> Result<Self, BenchError> {
        match source {
            HeadSource::Phantom(build) => Self::phantom(*build),
            HeadSource::Folder(folder) => Self::of_folder(folder),
        }
    }

    /// The head with its fields; landmarks that it lacks are proposed.
    pub(super) fn with_fields(source: &HeadSource) -> Result<(Self, Fields), BenchError> {
        let mut head = Self::load(source)?;
        propose(&head.anatomy.skin, &head.anatomy.skull).fill(&mut head.landmarks);
        let fields = build_fields(&head.anatomy, &FieldsSettings::default(), &Control::new())?;
        Ok((head, fields))
    }

    fn phantom(build: Build) -> Result<Self, BenchError> {
        let head = phantom::head();
        let stretched = |p: &Point| Point::from(p.coords.component_mul(&build.stretch()));
        let sampled = |solid| {
            let surface = phantom::surface_of(solid, &head.bounds(), PHANTOM_SPACING_MM)?;
            surface.with_positions(surface.positions().iter().map(stretched).collect()).ok()
        };
        let sampled =
            |solid| sampled(solid).ok_or_else(|| BenchError::Head { detail: "the phantom has no surface".to_owned() });
        let (skin, skull) = (sampled(head.skin.as_ref())?, sampled(head.skull.as_ref())?);
        let mut marks = head.landmarks.clone();
        marks.points.iter_mut().for_each(|(_, p)| *p = stretched(p));
        let landmarks = Landmarks {
            points: marks.points.iter().cloned().collect(),
            midline_x_mm: Some(marks.midline_x_mm * build.stretch().x),
            occlusal_z_mm: Some(marks.occlusal_plane_z_mm * build.stretch().z),
            le_fort_1_plane: Some((stretched(&marks.le_fort_1_plane.0), marks.le_fort_1_plane.1)),
        };
        let midline_x_mm = landmarks.midline_x_mm;
        let anatomy = Anatomy { skin, skull, air: None, soft_tissue: None, landmarks: marks.points, midline_x_mm };
        Ok(Self { anatomy, landmarks })
    }

    fn of_folder(folder: &Path) -> Result<Self, BenchError> {
        let path = folder.join("landmarks.json");
        let landmarks = if path.exists() { read_landmarks(&path)? } else { Landmarks::default() };
        let points: Vec<(String, Point)> = landmarks.points.iter().map(|(name, p)| (name.clone(), *p)).collect();
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
                (Some(ct), _, _) => of_ct(&ct, points, landmarks.midline_x_mm)?,
                (None, Some(skin), Some(skull)) => Anatomy {
                    skin: read_surface(&skin)?,
                    skull: read_surface(&skull)?,
                    air: None,
                    soft_tissue: None,
                    landmarks: points,
                    midline_x_mm: landmarks.midline_x_mm,
                },
                _ => {
                    let detail =
                        format!("{} has neither a CT (*.nii.gz) nor skin.* and skull.* surfaces", folder.display());
                    return Err(BenchError::Head { detail });
                }
            };
        Ok(Self { anatomy, landmarks })
    }

    /// For each vertex of the skin, whether it belongs to the face.
    pub(super) fn face(&self) -> Vec<bool> {
        let regions = face_regions(&self.anatomy.skin, &self.anatomy.landmarks, self.landmarks.midline_x_mm).regions;
        self.anatomy.skin.positions().iter().map(|p| regions.iter().any(|r| r.contains(p))).collect()
    }

    /// Builds fields, cuts the bone and builds the tissue mesh and the path.
    pub(super) fn prepare(&self, edge_mm: f64) -> Result<Prepared, BenchError> {
        let (control, settings) = (Control::new(), FieldsSettings::default());
        let fields = build_fields(&self.anatomy, &settings, &control)?;
        let marks = &self.landmarks;
        let known = marks.le_fort_1_plane.zip(marks.midline_x_mm).zip(marks.occlusal_z_mm);
        let ((plane, midline), occlusal) = known.ok_or_else(|| BenchError::Head {
            detail: "add le_fort_1_plane, midline_x_mm and occlusal_plane_z_mm to landmarks.json".to_owned(),
        })?;
        let cuts = le_fort_1(plane, midline, occlusal, [None; 2], &fields.bone);
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

fn of_ct(path: &Path, landmarks: Vec<(String, Point)>, midline_x_mm: Option<f64>) -> Result<Anatomy, BenchError> {
    let unusable = |detail: String| BenchError::Head { detail: format!("{}: {detail}", path.display()) };
    let (ct, _) = volume(&read(path)?, &Limits::default()).map_err(|e| unusable(e.to_string()))?;
    let found = from_ct(&ct, &CtSettings::default(), &Control::new()).map_err(|e| unusable(e.to_string()))?;
    Ok(Anatomy {
        skin: found.skin,
        skull: found.skull,
        air: found.air,
        soft_tissue: Some(found.soft_tissue.into()),
        landmarks,
        midline_x_mm,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_without_a_head_is_refused_with_what_it_lacks() {
        let folder = tempfile::tempdir().unwrap();
        let source: HeadSource = folder.path().to_str().unwrap().parse().unwrap();
        let landmarks = r#"{"landmarks": {"ans": [0, 0, 0]}, "midline_x_mm": 0, "occlusal_plane_z_mm": -20,
            "le_fort_1_plane": {"point": [0, 0, 0], "normal": [0, 0, 1]}}"#;
        std::fs::write(folder.path().join("landmarks.json"), landmarks).unwrap();
        match Head::load(&source) {
            Err(BenchError::Head { detail }) => assert!(detail.contains("neither a CT"), "{detail}"),
            other => panic!("{other:?}"),
        }
    }
}
