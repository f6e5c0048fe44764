//! The JSON file of a scene.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::Deserialize;

use prosopon_contract::{
    Check, D1ReadingName, FileFaults, LockingName, MAX_STEPS, MaterialDocument, ModelName, PresetName, RotationRequest,
    SkinElementName, SolverOptions, TissueLawsDocument, UnstableMaterialName, chain, segment_motion,
};
use prosopon_field::{FieldSettings, MethodSettings, SignedField};
use prosopon_formats::import::{Limits, detect_surface, surface, volume_mesh};
use prosopon_geometry::control::Control;
use prosopon_geometry::{VolumeMesh, Warning};
use prosopon_planning::plan::{Path as SegmentPath, Plan};
use prosopon_planning::simulate::{READY_MESH_LOCKING, ReadyMesh, Scene};
use prosopon_service::http::{strict_json, strict_value};
use prosopon_tissue::fem::SolveSettings;
use prosopon_tissue::mesh::{Attachment, Tissue};

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
#[serde(untagged, expecting = "expected the name of a preset or an object of laws by tissue")]
enum MaterialsRequest {
    Preset(PresetName),
    Laws(BTreeMap<String, serde_json::Value>),
}

/// Motion of a segment from rest: rotation about a pivot (default: the origin), then translation.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
struct MotionRequest {
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
    model: ModelName,
    #[serde(default)]
    skin_element: Option<SkinElementName>,
    #[serde(default)]
    locking: Option<LockingName>,
    /// Materials; laws replace those of the preset.
    #[serde(default)]
    preset: Option<PresetName>,
    #[serde(default)]
    materials: Option<MaterialsRequest>,
    /// Meaning of D1 in the preset `wang_2009`.
    #[serde(default)]
    d1_reading: Option<D1ReadingName>,
    #[serde(default)]
    segments: BTreeMap<String, MotionRequest>,
    #[serde(default)]
    bones: BTreeMap<String, PathBuf>,
    #[serde(default)]
    steps: Option<u32>,
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
    SceneError::Input { path: path.to_owned(), detail: chain(error) }
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
    pub(super) fn load(&self, scene: &Path) -> Result<(Scene, VolumeMesh, Vec<Warning>), SceneError> {
        let folder = scene.parent().unwrap_or(Path::new(""));
        let plan = self.plan()?;
        let path = folder.join(&self.mesh);
        let (file, mut warnings) = volume_mesh(&read(&path)?, &Limits::default()).map_err(|e| input(&path, &e))?;
        let ready = ReadyMesh::new(&file).map_err(|e| input(&path, &e))?;
        let (steps, settings) = (self.steps.unwrap_or(1), self.settings(&ready)?);
        let bones = self.bones(folder, &mut warnings)?;
        Self::check_segments(&plan, &ready, &bones)?;
        Ok((Scene { ready, bones, plan, settings, steps: steps as usize }, file, warnings))
    }

    /// Settings of the solver, checked as those of a job over HTTP are.
    fn settings(&self, ready: &ReadyMesh) -> Result<SolveSettings, SceneError> {
        let (preset, materials) = self.materials(ready)?;
        let options = SolverOptions {
            model: self.model,
            skin_element: self.skin_element,
            locking: self.locking,
            preset,
            d1_reading: self.d1_reading,
            materials,
            relative_residual: self.relative_residual,
            penetration_tolerance_mm: self.penetration_tolerance_mm,
            unstable_material: self.unstable_material,
        };
        let mut check = Check::default();
        check.number("/steps", f64::from(self.steps.unwrap_or(1)), 1.0, f64::from(MAX_STEPS));
        options.check(&mut check);
        let stiffness = self.contact_stiffness_factor.unwrap_or(1.0);
        check.number("/contact_stiffness_factor", stiffness, 1e-6, 1e6);
        FileFaults::finish(check).map_err(|faults| value("values", faults.to_string()))?;
        Ok(SolveSettings { contact_stiffness_factor: stiffness, ..options.settings(READY_MESH_LOCKING) })
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

    /// The preset, and the laws that replace its materials.
    ///
    /// Laws without `preset` must cover every tissue of the mesh.
    fn materials(&self, ready: &ReadyMesh) -> Result<(PresetName, TissueLawsDocument), SceneError> {
        let laws = match (&self.materials, self.preset) {
            (Some(MaterialsRequest::Preset(_)), Some(_)) => {
                return Err(value("/materials", "names a preset beside `preset`: give one of them"));
            }
            (Some(MaterialsRequest::Preset(preset)), None) => return Ok((*preset, TissueLawsDocument::default())),
            (None, preset) => return Ok((preset.unwrap_or_default(), TissueLawsDocument::default())),
            (Some(MaterialsRequest::Laws(laws)), _) => laws,
        };
        let mut document = TissueLawsDocument::default();
        let members = [
            ("skin", &mut document.skin),
            ("muscle", &mut document.muscle),
            ("fat", &mut document.fat),
            ("mucosa", &mut document.mucosa),
            ("cartilage", &mut document.cartilage),
        ];
        if let Some(unknown) = laws.keys().find(|key| members.iter().all(|(name, _)| name != key)) {
            return Err(value(
                format!("/materials/{unknown}"),
                "is not a tissue: use skin, muscle, fat, mucosa or cartilage",
            ));
        }
        for (name, member) in members {
            if let Some(law) = laws.get(name) {
                let read = strict_value::<MaterialDocument>(law);
                *member = Some(read.map_err(|e| value(format!("/materials/{name}"), e.to_string()))?);
            }
        }
        if self.preset.is_none() {
            let mesh = &ready.mesh;
            let prisms = (0..mesh.prisms.len()).map(|p| mesh.tissue_of_prism(p));
            let present: BTreeSet<Tissue> = mesh.tetrahedron_tissue.iter().copied().chain(prisms).collect();
            for (name, tissue, law) in document.all() {
                if law.is_none() && present.contains(&tissue) {
                    return Err(value(format!("/materials/{name}"), "is missing: the mesh has cells of this tissue"));
                }
            }
        }
        Ok((self.preset.unwrap_or_default(), document))
    }

    fn bones(&self, folder: &Path, warnings: &mut Vec<Warning>) -> Result<Vec<(u32, Arc<SignedField>)>, SceneError> {
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
                detail: "unknown surface format: use STL, PLY, OBJ or VTP".to_owned(),
            })?;
            let (mesh, found) = surface(&bytes, format, &Limits::default()).map_err(|e| input(&path, &e))?;
            warnings.extend(found.into_iter().map(|w| w.about(format_args!("bone {segment}"))));
            let (field, _, found) =
                SignedField::build_only(&mesh, &settings, &Control::new()).map_err(|e| input(&path, &e))?;
            warnings.extend(found.into_iter().map(|w| w.about(format_args!("bone {segment}"))));
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
