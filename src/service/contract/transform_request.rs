use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::check::Check;
use super::transform_json::{JsonTransform, json_transform};
use prosopon_formats::import::{
    Affine, NotRigid, RIGID_WITHIN, RigidMotion, itk_affine, rigid_motion, rigid_of_matrix, transform,
};
use prosopon_geometry::{Motion, Warning};

/// Longest file, bytes. A rigid transform in HDF5 has 8 kB.
const MAX_BYTES: usize = 1 << 20;

/// Which way a transform file maps points.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum TransformDirection {
    /// From the planned position to rest, as ITK's resampling and the files of 3D Slicer and ANTs do: its inverse moves the bone.
    Itk,
    /// From rest to the planned position: it moves the bone as it is.
    Forward,
}

/// A file with a rigid transform, LPS mm.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct TransformFileRequest {
    /// Content of the file in base64, at most 1 MB.
    ///
    /// The service detects the format: ITK text (`.tfm`, `.txt`), ITK HDF5 (`.h5`), MATLAB 4 (`.mat`) as ITK and ANTs write it, JSON of
    /// ITK (`parameters`, `fixedParameters`, `transformType`) or JSON with a 4 × 4 `matrix`. Deformations, scales, shears and mirror
    /// images are refused.
    pub base64: String,
    /// Which way the file maps points.
    ///
    /// When absent: `itk` for transforms of ITK, which is also what 3D Slicer writes, and `forward` for a `matrix` in JSON.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub direction: Option<TransformDirection>,
}

/// A rigid transform as a file states it.
struct Stated {
    rigid: Result<RigidMotion, NotRigid>,
    format: &'static str,
    /// What its format means where the request says nothing.
    usual: TransformDirection,
}

impl TransformFileRequest {
    /// The motion from rest that the file means for `segment`; `None` after a fault.
    pub(super) fn motion(
        &self,
        check: &mut Check,
        notes: &mut Vec<Warning>,
        pointer: &str,
        segment: u32,
    ) -> Option<Motion> {
        let stated = match self.read() {
            Ok(stated) => stated,
            Err(detail) => {
                check.fault(format!("{pointer}/base64"), detail);
                return None;
            }
        };
        let motion = taken(check, notes, &format!("{pointer}/base64"), stated.rigid, segment, "transform")?;
        let direction = self.direction.unwrap_or(stated.usual);
        let how = if self.direction.is_some() { "as `direction` states" } else { "as was assumed without `direction`" };
        let format = stated.format;
        let (message, motion) = match direction {
            TransformDirection::Itk => (
                format!(
                    "segment {segment}: the transform ({format}) maps points from the planned position to rest, {how}; its \
                     inverse moves the bone"
                ),
                motion.inverse(),
            ),
            TransformDirection::Forward => (
                format!(
                    "segment {segment}: the transform ({format}) maps points from rest to the planned position, {how}; it moves \
                     the bone"
                ),
                motion,
            ),
        };
        notes.push(Warning::info("transform-file", message));
        Some(motion)
    }

    fn read(&self) -> Result<Stated, String> {
        if self.base64.len() / 4 * 3 > MAX_BYTES {
            return Err(format!(
                "holds more than {MAX_BYTES} bytes; a rigid transform is shorter: is it a deformation field?"
            ));
        }
        let text: Vec<u8> = self.base64.bytes().filter(|c| !c.is_ascii_whitespace()).collect();
        let bytes =
            STANDARD.decode(text).map_err(|_| "is not base64 (A to Z, a to z, 0 to 9, +, /, with = at the end)")?;
        if let Some(read) = json_transform(&bytes) {
            return match read? {
                JsonTransform::Matrix(rows) => Ok(Stated {
                    rigid: rigid_of_matrix(&rows),
                    format: "JSON matrix",
                    usual: TransformDirection::Forward,
                }),
                JsonTransform::Itk(transforms) => {
                    let affine =
                        itk_affine(&transforms).map_err(|detail| format!("is not a usable transform: {detail}"))?;
                    Ok(Self::of_itk(&affine, "ITK JSON"))
                }
            };
        }
        let (affine, format) = transform(&bytes).map_err(|error| format!("cannot be used: {error}"))?;
        Ok(Self::of_itk(&affine, format.name()))
    }

    fn of_itk(affine: &Affine, format: &'static str) -> Stated {
        Stated { rigid: rigid_motion(affine), format, usual: TransformDirection::Itk }
    }
}

/// The motion of a 4 × 4 matrix for `segment`; `None` after a fault.
pub(super) fn matrix_motion(
    check: &mut Check,
    notes: &mut Vec<Warning>,
    pointer: &str,
    rows: &[[f64; 4]; 4],
    segment: u32,
) -> Option<Motion> {
    taken(check, notes, pointer, rigid_of_matrix(rows), segment, "matrix")
}

/// The motion, with a note where it was adjusted, or a fault that says why it is none.
fn taken(
    check: &mut Check,
    notes: &mut Vec<Warning>,
    pointer: &str,
    rigid: Result<RigidMotion, NotRigid>,
    segment: u32,
    what: &str,
) -> Option<Motion> {
    match rigid {
        Ok(RigidMotion { motion, off_by }) => {
            if let Some(off) = off_by {
                let message = format!(
                    "segment {segment}: the {what} is off a rotation by {off:.5} (allowed is {RIGID_WITHIN}); the nearest rotation \
                     is used"
                );
                notes.push(Warning::info("rotation-adjusted", message));
            }
            Some(motion)
        }
        Err(reason) => {
            check.fault(pointer, reason.to_string());
            None
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use prosopon_geometry::Point;
    use serde_json::json;

    /// Moves 1.5, -6, -1.25 mm after a quarter turn about z.
    const FORWARD: [[f64; 4]; 4] =
        [[0.0, -1.0, 0.0, 1.5], [1.0, 0.0, 0.0, -6.0], [0.0, 0.0, 1.0, -1.25], [0.0, 0.0, 0.0, 1.0]];

    fn read(bytes: &[u8], direction: Option<TransformDirection>) -> (Option<Motion>, Check, Vec<Warning>) {
        let (mut check, mut notes) = (Check::default(), Vec::new());
        let request = TransformFileRequest { base64: STANDARD.encode(bytes), direction };
        let motion = request.motion(&mut check, &mut notes, "/file", 2);
        (motion, check, notes)
    }

    /// 3D Slicer shows a matrix that moves the bone and writes its inverse.
    #[test]
    fn a_file_of_slicer_moves_the_bone_as_slicer_shows_it() {
        let expected = rigid_of_matrix(&FORWARD).unwrap().motion;
        let p = Point::new(6.0, -60.0, 38.0);
        let slicer = "#Insight Transform File V1.0\n#Transform 0\nTransform: AffineTransform_double_3_3\n\
            Parameters: 0 1 0 -1 0 0 0 0 1 6 1.5 1.25\nFixedParameters: 0 0 0\n";
        let wasm = json!([{
            "transformType": {"transformParameterization": "Affine", "parametersValueType": "float64", "inputDimension": 3, "outputDimension": 3},
            "numberOfParameters": 12, "numberOfFixedParameters": 3,
            "parameters": [0, 1, 0, -1, 0, 0, 0, 0, 1, 6, 1.5, 1.25], "fixedParameters": [0, 0, 0]
        }]);
        let plain = json!({"Transform": "AffineTransform_double_3_3", "Parameters": [0, 1, 0, -1, 0, 0, 0, 0, 1, 6, 1.5, 1.25]});
        let own = json!({ "matrix": FORWARD });
        let flat: Vec<f64> = FORWARD.iter().flatten().copied().collect();
        for (bytes, part) in [
            (slicer.to_owned(), "ITK text) maps points from the planned position to rest, as was assumed"),
            (wasm.to_string(), "ITK JSON) maps points from the planned position to rest"),
            (plain.to_string(), "ITK JSON"),
            (own.to_string(), "JSON matrix) maps points from rest to the planned position"),
            (json!(FORWARD).to_string(), "JSON matrix"),
            (json!({ "matrix": flat }).to_string(), "JSON matrix"),
        ] {
            let (motion, check, notes) = read(bytes.as_bytes(), None);
            check.finish().unwrap();
            assert!((motion.unwrap() * p - expected * p).norm() < 1e-12, "{bytes}");
            assert_eq!((notes.len(), notes[0].code), (1, "transform-file"));
            assert!(notes[0].message.contains(part) && notes[0].message.starts_with("segment 2"), "{notes:?}");
        }
        let (motion, _, notes) = read(slicer.as_bytes(), Some(TransformDirection::Forward));
        assert!((motion.unwrap() * p - expected.inverse() * p).norm() < 1e-12);
        assert!(notes[0].message.contains("as `direction` states"), "{notes:?}");
        let (motion, _, _) = read(own.to_string().as_bytes(), Some(TransformDirection::Itk));
        assert!((motion.unwrap() * p - expected.inverse() * p).norm() < 1e-12);
    }

    #[test]
    fn what_is_no_motion_is_refused_at_its_place() {
        let scaled = FORWARD.map(|row| [row[0] * 1.02, row[1] * 1.02, row[2] * 1.02, row[3]]);
        let mut mirrored = FORWARD;
        mirrored[2][2] = -1.0;
        for (bytes, part) in [
            (json!({ "matrix": scaled }).to_string(), "scales by"),
            (json!({ "matrix": mirrored }).to_string(), "mirror image"),
            (json!({"matrix": [1, 2]}).to_string(), "4 lists of 4 numbers"),
            (json!({"a": 1}).to_string(), "no `matrix` and no `parameters`"),
            (json!({"transformType": "BSplineTransform", "parameters": []}).to_string(), "deformation"),
            ("{\"matrix\": ".to_owned(), "not JSON"),
            ("solid a".to_owned(), "format is not recognised"),
        ] {
            let (motion, check, notes) = read(bytes.as_bytes(), None);
            let fault = check.finish().unwrap_err();
            assert!(motion.is_none() && notes.is_empty());
            assert_eq!(fault.errors[0].pointer, "/file/base64");
            assert!(fault.detail.contains(part), "{part}: {fault:?}");
        }
        let mut check = Check::default();
        let broken = TransformFileRequest { base64: "%".to_owned(), direction: None };
        assert!(broken.motion(&mut check, &mut Vec::new(), "/file", 1).is_none());
        assert!(check.finish().unwrap_err().detail.contains("not base64"));
    }

    #[test]
    fn a_rounded_matrix_is_taken_with_a_note() {
        let (mut check, mut notes) = (Check::default(), Vec::new());
        let rounded =
            [[0.9801, -0.1987, 0.0, 1.0], [0.1987, 0.9801, 0.0, 2.0], [0.0, 0.0, 1.0, 3.0], [0.0, 0.0, 0.0, 1.0]];
        assert!(matrix_motion(&mut check, &mut notes, "/matrix", &rounded, 1).is_some());
        assert_eq!(notes[0].code, "rotation-adjusted");
        check.finish().unwrap();
    }
}
