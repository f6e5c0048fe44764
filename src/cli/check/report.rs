use std::path::Path;

use serde::Serialize;
use sha2::{Digest, Sha256};

use prosopon_contract::{
    CtDocument, Fault, FaultKind, Findings, LandmarksDocument, OriginKind, SurfaceDocument, SurfaceOrigin,
    import_fault, landmarks_of_file,
};
use prosopon_formats::import::{
    Limits, VolumeSettings, detect_surface, detect_transform, detect_volume, is_legacy_vtk, rigid_motion, surface,
    transform, volume_mesh, volume_with,
};
use prosopon_geometry::{TriMesh, not_solid_reason, surface_report};
use prosopon_jobs::cut_off_stl;
use prosopon_planning::evaluate::{EvaluateError, GivenLandmarks, check_landmarks, check_skin_and_bone};
use prosopon_planning::simulate::ReadyMesh;
use prosopon_study::read_ct;

/// Report of one file.
#[derive(Debug, Serialize)]
pub(super) struct FileReport {
    /// The file as named on the command line.
    pub(super) file: String,
    #[serde(flatten)]
    pub(super) checked: Checked,
    /// The surface, to compare it with others.
    #[serde(skip)]
    mesh: Option<TriMesh>,
}

/// What a file holds.
#[derive(Debug, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub(super) enum Checked {
    /// As the answer of `PUT …/skin` describes it.
    Surface(SurfaceDocument),
    /// As the answer of `PUT …/ct` describes it.
    Ct(CtDocument),
    /// As the answer of `PUT …/landmarks` describes it.
    Landmarks(LandmarksDocument),
    /// A rigid transform for a segment of a plan.
    Transform {
        /// Format of the file.
        format: String,
        /// Rows of the 4 x 4 matrix as the file states it, LPS mm. In ITK's direction the bone moves by its inverse.
        matrix: [[f64; 4]; 4],
    },
    /// A mesh for `PUT …/tissue`.
    TissueMesh {
        /// Number of nodes.
        nodes: usize,
        /// Number of tetrahedra.
        tetrahedra: usize,
        /// Number of wedges.
        wedges: usize,
        /// Warnings and notes.
        #[serde(flatten)]
        findings: Findings,
    },
    /// The service would refuse it.
    Refused {
        /// Type of the problem.
        #[serde(rename = "type")]
        problem: String,
        /// What is wrong, where, and what to do.
        detail: String,
    },
}

impl FileReport {
    /// Reads a file, or a folder as a DICOM series.
    ///
    /// # Errors
    /// When the file itself cannot be read; a content that cannot be used is a report.
    pub(super) fn of(path: &Path, settings: &VolumeSettings) -> Result<Self, Box<dyn std::error::Error>> {
        let bytes = read_ct(path)?;
        let mut mesh = None;
        let checked = checked(&bytes, settings, &mut mesh).unwrap_or_else(|fault| Checked::Refused {
            problem: format!("/problems/{}", fault.kind.slug()),
            detail: fault.detail,
        });
        Ok(Self { file: path.display().to_string(), checked, mesh })
    }
}

/// Findings on up to two surfaces, of which the larger one is taken for the skin, and on the files of landmarks beside them: whether
/// one fits better in another frame or unit.
///
/// # Errors
/// When a surface cannot be measured.
pub(super) fn together(reports: &[FileReport]) -> Result<Findings, EvaluateError> {
    let mut surfaces: Vec<(&str, &TriMesh)> =
        reports.iter().filter_map(|report| Some((report.file.as_str(), report.mesh.as_ref()?))).collect();
    surfaces.sort_by(|(_, a), (_, b)| b.bounds().diagonal().total_cmp(&a.bounds().diagonal()));
    let (skin, bone, mut found) = match surfaces[..] {
        [(a, skin), (b, bone)] => {
            (Some(skin), Some(bone), check_skin_and_bone(skin, bone, [a, b])?.into_iter().collect())
        }
        // A single surface is compared with landmarks as skin: a skull would have them inside its own box too.
        [(_, skin)] => (Some(skin), None, Vec::new()),
        _ => (None, None, Vec::new()),
    };
    for report in reports {
        let Checked::Landmarks(landmarks) = &report.checked else { continue };
        let (points, midline_x_mm) = (landmarks.named_points(), landmarks.midline_x_mm);
        let given = GivenLandmarks { points: &points, unconfirmed: &landmarks.proposed, midline_x_mm };
        found.extend(check_landmarks(&given, skin, bone)?);
    }
    Ok(found.into_iter().collect())
}

fn checked(bytes: &[u8], settings: &VolumeSettings, mesh: &mut Option<TriMesh>) -> Result<Checked, Fault> {
    if bytes.is_empty() {
        return Err(Fault::new(FaultKind::UnsupportedFormat, "the file is empty"));
    }
    let begin = bytes.trim_ascii_start();
    if let Some(found) = landmarks_of_file(bytes) {
        return Ok(Checked::Landmarks(found?));
    }
    if begin.starts_with(b"{") {
        return own_landmarks(begin).map(Checked::Landmarks);
    }
    if detect_transform(bytes).is_some() {
        return checked_transform(bytes);
    }
    if is_legacy_vtk(bytes) || contains(begin, b"UnstructuredGrid") {
        return checked_mesh(bytes);
    }
    if detect_volume(bytes).is_some() {
        return checked_volume(bytes, settings);
    }
    checked_surface(bytes, mesh)
}

/// Whether the beginning of a file contains a word.
fn contains(begin: &[u8], word: &[u8]) -> bool {
    let head = begin.get(..4096).unwrap_or(begin);
    head.windows(word.len()).any(|window| window == word)
}

fn own_landmarks(bytes: &[u8]) -> Result<LandmarksDocument, Fault> {
    let refused = |error: serde_json::Error| {
        let detail = format!("the JSON is neither landmarks nor a markups file of 3D Slicer: {error}");
        Fault::new(FaultKind::InvalidRequest, detail)
    };
    serde_json::from_slice::<LandmarksDocument>(bytes).map_err(refused)?.checked()
}

fn checked_surface(bytes: &[u8], kept: &mut Option<TriMesh>) -> Result<Checked, Fault> {
    let refused = |error| import_fault(&error, FaultKind::SurfaceNotUsable);
    let limits = Limits::default();
    let Some(format) = detect_surface(bytes).or_else(|| cut_off_stl(bytes, limits.max_triangles)) else {
        let detail = "the format is not recognised; allowed are STL, PLY, OBJ, VTP, VTU, DICOM, NIfTI, NRRD, MetaImage, landmarks and \
                      transforms";
        return Err(Fault::new(FaultKind::UnsupportedFormat, detail));
    };
    let (mesh, warnings) = surface(bytes, format, &limits).map_err(refused)?;
    let report = surface_report(&mesh);
    if let Some(detail) = not_solid_reason(&mesh, &report) {
        return Err(Fault::new(FaultKind::SurfaceNotUsable, detail));
    }
    *kept = Some(mesh);
    let origin = SurfaceOrigin {
        kind: OriginKind::Upload,
        format: format.name().to_owned(),
        bytes: bytes.len() as u64,
        sha256: hash(bytes),
    };
    Ok(Checked::Surface(SurfaceDocument::new(origin, &report, warnings)))
}

fn checked_volume(bytes: &[u8], settings: &VolumeSettings) -> Result<Checked, Fault> {
    let read = volume_with(bytes, &Limits::default(), settings)
        .map_err(|error| import_fault(&error, FaultKind::VolumeNotUsable))?;
    Ok(Checked::Ct(CtDocument::of(&read, hash(bytes), bytes.len() as u64)))
}

fn checked_transform(bytes: &[u8]) -> Result<Checked, Fault> {
    let (affine, format) = transform(bytes).map_err(|error| import_fault(&error, FaultKind::InvalidRequest))?;
    let refused = |error: prosopon_formats::import::NotRigid| Fault::new(FaultKind::InvalidRequest, error.to_string());
    let matrix = rigid_motion(&affine).map_err(refused)?.motion.to_homogeneous();
    let rows = [0, 1, 2, 3].map(|row| [0, 1, 2, 3].map(|column| matrix[(row, column)]));
    Ok(Checked::Transform { format: format.name().to_owned(), matrix: rows })
}

fn checked_mesh(bytes: &[u8]) -> Result<Checked, Fault> {
    let (volume, warnings) =
        volume_mesh(bytes, &Limits::default()).map_err(|error| import_fault(&error, FaultKind::MeshNotUsable))?;
    let ready = ReadyMesh::new(&volume).map_err(|error| Fault::new(FaultKind::MeshNotUsable, error.to_string()))?;
    Ok(Checked::TissueMesh {
        nodes: ready.mesh.positions.len(),
        tetrahedra: ready.mesh.tetrahedra.len(),
        wedges: ready.mesh.prisms.len(),
        findings: warnings.into_iter().chain(ready.warnings).collect(),
    })
}

fn hash(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}
