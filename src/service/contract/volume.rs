use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::warning::Findings;
use prosopon_geometry::{Aabb, Point, Vector, Volume};
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

/// Format of records without one: they were all NIfTI.
fn nifti() -> String {
    "nifti".to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

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
    fn records_without_a_format_were_nifti() {
        let old: CtDocument = serde_json::from_str(r#"{"sha256": "ab", "bytes": 7, "warnings": []}"#).unwrap();
        assert_eq!((old.format.as_str(), old.volume), ("nifti", None));
    }
}
