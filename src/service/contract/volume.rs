use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::warning::Findings;
use prosopon_formats::import::VolumeRead;
use prosopon_geometry::{Aabb, Point, Vector, Volume, Warning};
use prosopon_planning::surface::{Levels, levels_of};

/// Size, place and values of a CT as it was read.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct VolumeDocument {
    /// Number of voxels along each axis of the file.
    pub dims: [usize; 3],
    /// Distance between voxels along each axis, mm.
    pub spacing_mm: [f64; 3],
    /// Direction in which each axis runs, to the nearest of R, L, A, P, I and S: `LPS` runs left, back and up.
    pub axes: String,
    /// Largest angle between an axis and the direction that names it, degrees.
    pub oblique_deg: f64,
    /// Smallest coordinates of voxel centres, LPS mm.
    pub min_mm: [f64; 3],
    /// Largest coordinates of voxel centres, LPS mm.
    pub max_mm: [f64; 3],
    /// Smallest and largest value.
    pub values: [i16; 2],
    /// Values of air and soft tissue; absent where the volume does not show them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub levels: Option<LevelsDocument>,
}

/// Values of air and soft tissue in a CT, in its own units. In Hounsfield units they are -1000 and 40.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct LevelsDocument {
    /// Value of air.
    pub air: f64,
    /// Value of soft tissue.
    pub soft_tissue: f64,
    /// Whether the values are Hounsfield units.
    pub in_hu: bool,
}

impl From<&Volume> for VolumeDocument {
    fn from(volume: &Volume) -> Self {
        let last = |axis: usize| volume.axes[axis] * volume.dims[axis].saturating_sub(1) as f64;
        let corners: Vec<Point> = (0..8)
            .map(|c| (0..3).filter(|axis| c >> axis & 1 == 1).fold(volume.origin, |p, axis| p + last(axis)))
            .collect();
        let bounds = Aabb::of(&corners).unwrap_or(Aabb { min: volume.origin, max: volume.origin });
        let named = named(&volume.axes);
        let values = volume.hu.iter().fold([i16::MAX, i16::MIN], |[min, max], v| [min.min(*v), max.max(*v)]);
        let levels = |l: Levels| LevelsDocument { air: l.air, soft_tissue: l.soft_tissue, in_hu: l == Levels::HU };
        Self {
            dims: volume.dims,
            spacing_mm: volume.axes.map(|axis| axis.norm()),
            axes: named.iter().map(|(letter, _)| *letter).collect(),
            oblique_deg: named.iter().map(|(_, off)| off.to_degrees()).fold(0.0, f64::max),
            min_mm: bounds.min.coords.into(),
            max_mm: bounds.max.coords.into(),
            values,
            levels: levels_of(volume).ok().map(levels),
        }
    }
}

/// Letters of the directions to which the axes are nearest as a whole, each direction once, and the angles to them.
fn named(axes: &[Vector; 3]) -> [(char, f64); 3] {
    const ORDERS: [[usize; 3]; 6] = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];
    let along = |axis: usize, direction: usize| axes[axis][direction] / axes[axis].norm();
    let fit = |order: &[usize; 3]| -> f64 { (0..3).map(|axis| along(axis, order[axis]).abs()).sum() };
    let best = ORDERS.into_iter().reduce(|a, b| if fit(&b) > fit(&a) { b } else { a }).unwrap_or([0, 1, 2]);
    [0, 1, 2].map(|axis| {
        let direction = best[axis];
        let share = along(axis, direction);
        let letter = [['R', 'L'], ['A', 'P'], ['I', 'S']][direction][usize::from(share > 0.0)];
        (letter, share.abs().clamp(0.0, 1.0).acos())
    })
}

/// Description of a stored CT.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct CtDocument {
    /// SHA-256 of the upload.
    pub sha256: String,
    /// Bytes of the upload.
    pub bytes: u64,
    /// Format of the upload: `nifti`, `dicom`, `nrrd`, `metaimage`.
    #[serde(default = "nifti")]
    pub format: String,
    /// What was read; absent where an earlier version stored the CT.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub volume: Option<VolumeDocument>,
    /// Warnings and notes.
    #[serde(flatten)]
    pub findings: Findings,
}

impl CtDocument {
    /// The description of an upload of `bytes` bytes.
    pub fn of(read: &VolumeRead, sha256: String, bytes: u64) -> Self {
        let mut warnings = read.warnings.clone();
        if !warnings.iter().any(|w| w.code == TILTED) {
            warnings.extend(sheared(&read.volume.axes));
        }
        Self {
            sha256,
            bytes,
            format: read.format.name().to_owned(),
            volume: Some(VolumeDocument::from(&read.volume)),
            findings: warnings.into_iter().collect(),
        }
    }
}

/// Code of the warning about slices that do not lie straight above each other, also of the reader of DICOM.
const TILTED: &str = "tilted-slices";
/// A smaller deviation from right angles comes from rounding, degrees.
const SHEARED_DEG: f64 = 0.5;

/// A warning where the axes of a volume do not stand at right angles, which a scanner makes by a tilted gantry only.
fn sheared(axes: &[Vector; 3]) -> Option<Warning> {
    let off = |a: &Vector, b: &Vector| (90.0 - a.angle(b).to_degrees()).abs();
    let [i, j, k] = axes;
    let deg = off(i, j).max(off(i, k)).max(off(j, k));
    let found = format!(
        "the axes of the volume are {deg:.1}° off right angles: the volume is sheared, and is read as its header states it"
    );
    let action = "Check that the head is not sheared: convert a scan with a tilted gantry from its DICOM images.";
    (deg > SHEARED_DEG).then(|| Warning::check(TILTED, found).act(action))
}

/// Format of records without one: they were all NIfTI.
fn nifti() -> String {
    "nifti".to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use prosopon_formats::import::VolumeFormat;

    #[test]
    fn a_tilted_volume_is_described_in_letters_and_millimetres() {
        let turn = nalgebra::Rotation3::from_axis_angle(&Vector::x_axis(), 10f64.to_radians());
        let axes = [-Vector::x() * 0.5, turn * Vector::z() * 2.0, turn * Vector::y()];
        let volume = Volume { dims: [3, 2, 2], origin: Point::new(1.0, 0.0, 0.0), axes, hu: vec![-1000; 12] };
        let found = VolumeDocument::from(&volume);
        assert_eq!((found.axes.as_str(), found.spacing_mm.map(|s| (s * 1e9).round() / 1e9)), ("RSP", [0.5, 2.0, 1.0]));
        assert!((found.oblique_deg - 10.0).abs() < 1e-9);
        assert_eq!((found.min_mm[0], found.max_mm[0], found.values), (0.0, 1.0, [-1000, -1000]));
    }

    #[test]
    fn axes_off_right_angles_give_one_warning() {
        let skew = Vector::new(0.0, 5f64.to_radians().tan(), 1.0) * 2.0;
        assert!(sheared(&[Vector::x(), Vector::y(), skew]).unwrap().message.contains("5.0° off"));
        assert_eq!(sheared(&[Vector::x(), Vector::y(), Vector::new(0.0, 0.005, 1.0)]), None);
        let volume =
            Volume { dims: [2; 3], origin: Point::origin(), axes: [Vector::x(), Vector::y(), skew], hu: vec![0; 8] };
        let mut read = VolumeRead { volume, format: VolumeFormat::Nrrd, series: None, warnings: Vec::new() };
        let codes = |read: &VolumeRead| -> Vec<String> {
            CtDocument::of(read, String::new(), 8).findings.warnings.iter().map(|w| w.code.clone()).collect()
        };
        assert_eq!(codes(&read), [TILTED]);
        read.warnings.push(Warning::check(TILTED, "by the reader of DICOM"));
        assert_eq!(codes(&read), [TILTED]);
    }

    #[test]
    fn records_without_a_format_were_nifti() {
        let old: CtDocument = serde_json::from_str(r#"{"sha256": "ab", "bytes": 7, "warnings": []}"#).unwrap();
        assert_eq!((old.format.as_str(), old.volume), ("nifti", None));
    }
}
