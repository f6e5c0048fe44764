//! The JSON file of a scene.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::Deserialize;

use prosopon_field::{FieldSettings, MethodSettings, SignedField};
use prosopon_formats::import::{Limits, detect_surface, surface, volume_mesh};
use prosopon_geometry::VolumeMesh;
use prosopon_geometry::control::Control;
use prosopon_jobs::SolveModel;
use prosopon_planning::plan::{Path as SegmentPath, Plan};
use prosopon_planning::simulate::{READY_MESH_LOCKING, ReadyMesh, Scene};
use prosopon_service::http::dto::{RotationRequest, file_material, segment_motion};
use prosopon_service::http::{strict_json, strict_value};
use prosopon_session::{
    D1ReadingName, LockingName, MaterialDocument, PresetName, SkinElementName, UnstableMaterialName,
};
use prosopon_tissue::fem::SolveSettings;
use prosopon_tissue::fem::material::Materials;
use prosopon_tissue::mesh::{Attachment, Tissue};

/// Largest number of steps of a path.
const MAX_STEPS: usize = 10_000;

/// Why a scene cannot be solved.
#[derive(Debug, thiserror::Error)]
pub(super) enum SceneError {
    /// A file cannot be read.
    #[error("cannot read {}", path.display())]
    File { path: PathBuf, source: std::io::Error },
    /// The scene is not JSON or does not have the expected members.
    #[error("{}: {detail}", path.display())]
    Json { path: PathBuf, detail: String },
    /// A value is not allowed; `place` is its JSON pointer.
    #[error("scene {place}: {detail}")]
    Value { place: String, detail: String },
    /// The mesh or a bone is not usable.
    #[error("{}: {detail}", path.display())]
    Input { path: PathBuf, detail: String },
}

/// Materials: a preset by name, or a law for each tissue.
#[derive(Debug, Clone, Deserialize)]
#[serde(
    untagged,
    expecting = "expected the name of a preset (wang2009-stable, wang2009-tension, wang2009, nazari2010, chabanas2003) or an object of laws by tissue"
)]
enum MaterialsWord {
    Preset(PresetName),
    Laws(BTreeMap<String, serde_json::Value>),
}

/// Motion of a segment from rest: rotation about a pivot (default: the origin), then translation.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
struct MotionWord {
    #[serde(default)]
    translation_mm: [f64; 3],
    #[serde(default)]
    rotation: Option<RotationRequest>,
}

/// A scene as it is in the file.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SceneFile {
    mesh: PathBuf,
    #[serde(default)]
    model: Option<SolveModel>,
    #[serde(default)]
    skin_element: Option<SkinElementName>,
    #[serde(default)]
    locking: Option<LockingName>,
    #[serde(default)]
    materials: Option<MaterialsWord>,
    /// Meaning of D1 in the preset wang2009.
    #[serde(default)]
    d1_reading: Option<D1ReadingName>,
    #[serde(default)]
    segments: BTreeMap<String, MotionWord>,
    #[serde(default)]
    bones: BTreeMap<String, PathBuf>,
    #[serde(default)]
    steps: Option<usize>,
    /// Residual force over reaction force at which a step is in equilibrium.
    #[serde(default)]
    relative_residual: Option<f64>,
    /// Largest remaining penetration.
    #[serde(default)]
    penetration_tolerance_mm: Option<f64>,
    /// Treatment of a material that loses ellipticity.
    #[serde(default)]
    unstable_material: UnstableMaterialName,
    /// Factor on the default contact stiffness.
    #[serde(default)]
    contact_stiffness_factor: Option<f64>,
    /// Spacing of the bones' distance fields.
    #[serde(default)]
    field_spacing_mm: Option<f64>,
}

fn value(place: impl Into<String>, detail: impl Into<String>) -> SceneError {
    SceneError::Value { place: place.into(), detail: detail.into() }
}

fn input(path: &Path, error: &dyn std::error::Error) -> SceneError {
    SceneError::Input { path: path.to_owned(), detail: prosopon_session::chain(error) }
}

fn read(path: &Path) -> Result<Vec<u8>, SceneError> {
    std::fs::read(path).map_err(|source| SceneError::File { path: path.to_owned(), source })
}

impl SceneFile {
    /// Reads the JSON.
    pub(super) fn read(path: &Path) -> Result<Self, SceneError> {
        let bytes = read(path)?;
        strict_json(&bytes).map_err(|e| SceneError::Json { path: path.to_owned(), detail: e.to_string() })
    }

    /// All input files: the scene, the mesh and the bones.
    pub(super) fn files(&self, scene: &Path) -> Vec<PathBuf> {
        let folder = scene.parent().unwrap_or(Path::new(""));
        let named = std::iter::once(&self.mesh).chain(self.bones.values()).map(|name| folder.join(name));
        std::iter::once(scene.to_owned()).chain(named).collect()
    }

    /// Reads all named files and builds the scene; also returns the mesh as it is in its file, and warnings.
    pub(super) fn load(&self, scene: &Path) -> Result<(Scene, VolumeMesh, Vec<String>), SceneError> {
        let folder = scene.parent().unwrap_or(Path::new(""));
        let steps = self.steps.unwrap_or(1);
        if !(1..=MAX_STEPS).contains(&steps) {
            return Err(value("/steps", format!("is {steps}; allowed are 1 to {MAX_STEPS}")));
        }
        let mut settings = self.settings()?;
        let plan = self.plan()?;
        let path = folder.join(&self.mesh);
        let (file, mut warnings) = volume_mesh(&read(&path)?, &Limits::default()).map_err(|e| input(&path, &e))?;
        let ready = ReadyMesh::new(&file).map_err(|e| input(&path, &e))?;
        settings.materials = self.materials(&ready)?;
        let bones = self.bones(folder, &mut warnings)?;
        Self::check_segments(&plan, &ready, &bones)?;
        Ok((Scene { ready, bones, plan, settings, steps }, file, warnings))
    }

    fn settings(&self) -> Result<SolveSettings, SceneError> {
        let model = self.model.unwrap_or(SolveModel::Mixed);
        let mut settings = SolveSettings::new(model.into(), PresetName::default().materials(D1ReadingName::default()));
        settings.skin_element = self.skin_element.map_or(settings.skin_element, Into::into);
        settings.locking = self.locking.map_or(READY_MESH_LOCKING, Into::into);
        let positive = |name: &str, found: Option<f64>, default: f64, most: f64| match found {
            None => Ok(default),
            Some(x) if x > 0.0 && x <= most => Ok(x),
            Some(x) => Err(value(format!("/{name}"), format!("is {x}; must be above 0 and at most {most}"))),
        };
        settings.relative_residual =
            positive("relative_residual", self.relative_residual, settings.relative_residual, 0.1)?;
        let penetration = settings.penetration_tolerance_mm;
        settings.penetration_tolerance_mm =
            positive("penetration_tolerance_mm", self.penetration_tolerance_mm, penetration, 10.0)?;
        settings.unstable_material = self.unstable_material.into();
        settings.contact_stiffness_factor =
            positive("contact_stiffness_factor", self.contact_stiffness_factor, 1.0, 1e6)?;
        Ok(settings)
    }

    fn plan(&self) -> Result<Plan, SceneError> {
        let mut paths: Vec<SegmentPath> = Vec::new();
        for (key, word) in &self.segments {
            let place = format!("/segments/{key}");
            let segment = segment_number("segments", key)?;
            if paths.iter().any(|p| p.segment() == segment) {
                return Err(value(place, format!("segment {segment} is given twice")));
            }
            if segment == 0 {
                return Err(value(place, "segment 0 is the fixed skull and cannot move"));
            }
            let motion = segment_motion(&place, word.translation_mm, word.rotation.as_ref())
                .map_err(|faults| value("values", faults.to_string()))?;
            let path = SegmentPath::new(segment, vec![(1.0, motion)]).map_err(|e| value(place, e.to_string()))?;
            paths.push(path);
        }
        Ok(Plan { paths })
    }

    /// A material for every tissue of the mesh; tissues that the mesh does not have get a default material.
    fn materials(&self, ready: &ReadyMesh) -> Result<Materials, SceneError> {
        let reading = self.d1_reading.unwrap_or_default();
        let preset = match &self.materials {
            Some(MaterialsWord::Preset(preset)) => Some(*preset),
            None => Some(PresetName::default()),
            Some(MaterialsWord::Laws(_)) => None,
        };
        if self.d1_reading.is_some() && preset != Some(PresetName::Wang2009) {
            return Err(value("/d1_reading", "applies only to the preset wang2009: remove it or use that preset"));
        }
        let laws = match &self.materials {
            Some(MaterialsWord::Laws(laws)) => laws,
            Some(MaterialsWord::Preset(_)) | None => return Ok(preset.unwrap_or_default().materials(reading)),
        };
        const NAMES: [(&str, Tissue); 4] =
            [("skin", Tissue::Skin), ("muscle", Tissue::Muscle), ("fat", Tissue::Fat), ("mucosa", Tissue::Mucosa)];
        if let Some(unknown) = laws.keys().find(|key| NAMES.iter().all(|(name, _)| name != key)) {
            return Err(value(format!("/materials/{unknown}"), "is not a tissue: use skin, muscle, fat or mucosa"));
        }
        let mesh = &ready.mesh;
        let prisms = (0..mesh.prisms.len()).map(|p| mesh.tissue_of_prism(p));
        let mut present: Vec<Tissue> = mesh.tetrahedron_tissue.iter().copied().chain(prisms).collect();
        present.sort_unstable();
        present.dedup();
        let mut materials = PresetName::default().materials(reading);
        for (name, tissue) in NAMES {
            let place = format!("/materials/{name}");
            let Some(law) = laws.get(name) else {
                if present.contains(&tissue) {
                    return Err(value(place, "is missing: the mesh has cells of this tissue"));
                }
                continue;
            };
            let document: MaterialDocument = strict_value(law).map_err(|e| value(place.clone(), e.to_string()))?;
            let material = file_material(&place, &document).map_err(|faults| value("values", faults.to_string()))?;
            materials.set(tissue, material);
        }
        Ok(materials)
    }

    fn bones(&self, folder: &Path, warnings: &mut Vec<String>) -> Result<Vec<(u32, Arc<SignedField>)>, SceneError> {
        let defaults = MethodSettings::default();
        let spacing_mm = match self.field_spacing_mm {
            None => defaults.field.spacing_mm,
            Some(x) if (0.05..=10.0).contains(&x) => x,
            Some(x) => return Err(value("/field_spacing_mm", format!("is {x} mm; allowed are 0.05 to 10 mm"))),
        };
        let settings = MethodSettings { field: FieldSettings { spacing_mm, ..defaults.field }, ..defaults };
        let mut bones = Vec::new();
        for (key, name) in &self.bones {
            let segment = segment_number("bones", key)?;
            let path = folder.join(name);
            let bytes = read(&path)?;
            let format = detect_surface(&bytes).ok_or_else(|| SceneError::Input {
                path: path.clone(),
                detail: "unknown surface format: use STL, PLY or OBJ".to_owned(),
            })?;
            let (mesh, found) = surface(&bytes, format, &Limits::default()).map_err(|e| input(&path, &e))?;
            warnings.extend(found.into_iter().map(|w| format!("bone {segment}: {w}")));
            let (field, _, found) =
                SignedField::build_only(&mesh, &settings, &Control::new()).map_err(|e| input(&path, &e))?;
            warnings.extend(found.into_iter().map(|w| format!("bone {segment}: {w}")));
            bones.push((segment, Arc::new(field)));
        }
        Ok(bones)
    }

    /// Refuses a motion of a segment that is neither attached to the mesh nor a bone.
    fn check_segments(plan: &Plan, ready: &ReadyMesh, bones: &[(u32, Arc<SignedField>)]) -> Result<(), SceneError> {
        for path in &plan.paths {
            let segment = path.segment();
            let tied = ready.mesh.attachment.contains(&Attachment::Tied(segment));
            if !tied && bones.iter().all(|(s, _)| *s != segment) {
                let detail = "no point of the mesh is attached to this segment, and it has no surface in /bones";
                return Err(value(format!("/segments/{segment}"), detail));
            }
        }
        Ok(())
    }
}

fn segment_number(list: &str, key: &str) -> Result<u32, SceneError> {
    key.parse().map_err(|_| value(format!("/{list}/{key}"), "is not a segment number"))
}
