//! Position and axes of the voxel lattice.

use nalgebra::{Matrix3, Quaternion, UnitQuaternion};
use nifti::NiftiHeader;

use super::super::ImportError;
use super::super::error::malformed;
use super::super::lattice::{VoxelLattice, lengths};
use super::FORMAT;
use prosopon_geometry::{Point, Vector, Warning};

/// Largest difference between a step of the sform and `pixdim` that counts as rounding, mm.
///
/// ITK warns from the same difference on (`NiftiImageIO`). Single precision rounds a step of a CT by less than 1e-6 mm, and a
/// difference of 1e-3 mm makes a volume of 512 voxels half a millimetre longer.
const MAX_SCALE_DIFFERENCE_MM: f64 = 1e-3;
/// Largest distance of a corner between sform and qform that counts as equal, in voxels.
const MAX_APART_VOXELS: f64 = 0.5;
/// Code of an sform in coordinates of the scanner (`NIFTI_XFORM_SCANNER_ANAT`).
const SCANNER: i16 = 1;

/// The lattice in LPS mm, from the sform or the qform, else from the spacing alone.
///
/// Source: methods 3, 2 and 1 of the NIfTI-1 header `nifti1.h`. They give RAS, whose x and y are the negatives of LPS. Between
/// an sform and a qform that differ, and between the steps of an sform and `pixdim`, it chooses as ITK does.
pub(super) fn read(
    header: &NiftiHeader,
    dims: [usize; 3],
    warnings: &mut Vec<Warning>,
) -> Result<VoxelLattice, ImportError> {
    let mm = unit(header, warnings)?;
    let sform = (header.sform_code > 0).then(|| sform(header, mm));
    let qform = (header.qform_code > 0).then(|| qform(header, mm));
    let lattice = match (sform, qform) {
        (Some(sform), None) if !is_zero(&sform) => scaled(sform, header, mm, warnings),
        (Some(sform), Some(qform)) => either(header, dims, mm, (sform, qform), warnings)?,
        (None, Some(qform)) => qform?,
        (Some(_) | None, None) => without_orientation(header, mm, warnings),
    };
    // Adding zero turns -0 into 0.
    let lps = |v: Vector| Vector::new(-v.x, -v.y, v.z).add_scalar(0.0);
    Ok(VoxelLattice { origin: Point::from(lps(lattice.origin.coords)), axes: lattice.axes.map(lps) })
}

/// The lattice of a header that has both an sform and a qform.
fn either(
    header: &NiftiHeader,
    dims: [usize; 3],
    mm: f64,
    (sform, qform): (VoxelLattice, Result<VoxelLattice, ImportError>),
    warnings: &mut Vec<Warning>,
) -> Result<VoxelLattice, ImportError> {
    match (is_usable(&sform), qform) {
        (true, Err(_)) => {
            let found = "the quaternion or the spacing of the qform is not usable; the sform was used";
            warnings.push(Warning::info("one-form-not-usable", found));
            Ok(scaled(sform, header, mm, warnings))
        }
        (false, qform) => {
            let qform = qform?;
            warnings.push(if is_zero(&sform) {
                Warning::info("one-form-not-usable", "the sform is all zero; the qform was used")
            } else {
                let found = "the steps of the sform are not finite or all in one plane; the qform was used";
                Warning::check("one-form-not-usable", found).act("Check the position and orientation.")
            });
            Ok(qform)
        }
        (true, Ok(qform)) => {
            let sform = scaled(sform, header, mm, warnings);
            Ok(nearer_to_scanner(header.sform_code, dims, sform, qform, warnings))
        }
    }
}

/// The sform, unless the qform differs and only the qform is said to be in coordinates of the scanner.
///
/// ITK also takes the qform instead of a sheared sform of the scanner, because its images cannot be sheared; a volume here can.
#[expect(clippy::arithmetic_side_effects, reason = "floating point")]
fn nearer_to_scanner(
    sform_code: i16,
    dims: [usize; 3],
    sform: VoxelLattice,
    qform: VoxelLattice,
    warnings: &mut Vec<Warning>,
) -> VoxelLattice {
    let corners = sform.corners(dims).into_iter().zip(qform.corners(dims));
    let apart_mm = corners.map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
    let voxel = sform.axes.iter().map(|a| a.norm()).fold(f64::INFINITY, f64::min);
    if apart_mm <= MAX_APART_VOXELS * voxel {
        return sform;
    }
    let (used, chosen, why) = if sform_code == SCANNER {
        ("sform", sform, "its code is that of the scanner")
    } else {
        ("qform", qform, "the code of the sform is not that of the scanner")
    };
    let found = format!(
        "sform and qform differ by up to {apart_mm:.1} mm ({:.1} voxels) at the corners of the volume; the {used} was used, as \
         ITK does: {why}",
        apart_mm / voxel
    );
    warnings.push(Warning::check("sform-differs", found).act("Check the position and orientation."));
    chosen
}

/// The sform with steps of the lengths in `pixdim`, which ITK uses whatever the sform's columns are.
#[expect(clippy::arithmetic_side_effects, reason = "floating point")]
fn scaled(sform: VoxelLattice, header: &NiftiHeader, mm: f64, warnings: &mut Vec<Warning>) -> VoxelLattice {
    if !is_usable(&sform) {
        return sform;
    }
    let found = sform.axes.map(|axis| axis.norm());
    let [_, x, y, z, ..] = header.pixdim.map(|step| f64::from(step).abs() * mm);
    let stated = [x, y, z];
    let usable = stated.iter().all(|step| step.is_finite() && *step > 0.0);
    let differ = found.iter().zip(stated).any(|(a, b)| (a - b).abs() > MAX_SCALE_DIFFERENCE_MM);
    if !usable || !differ {
        return sform;
    }
    let found = format!(
        "the steps of the sform are {}, but `pixdim` states {}; the steps of `pixdim` were used in the directions of the sform, as \
         ITK does",
        lengths(found),
        lengths(stated)
    );
    warnings.push(Warning::check("sform-scale-differs", found).act("Check the size of the head."));
    let [a, b, c] = sform.axes.map(|axis| axis.normalize());
    VoxelLattice { origin: sform.origin, axes: [a * x, b * y, c * z] }
}

fn without_orientation(header: &NiftiHeader, mm: f64, warnings: &mut Vec<Warning>) -> VoxelLattice {
    let found = "the header has no orientation: i was assumed to run to the patient's right, j to the front, k up; \
         left and right may be swapped";
    warnings.push(Warning::check("no-orientation", found).act("Check left and right."));
    let [_, x, y, z, ..] = header.pixdim.map(|step| f64::from(step) * mm);
    let axes = [Vector::new(x, 0.0, 0.0), Vector::new(0.0, y, 0.0), Vector::new(0.0, 0.0, z)];
    VoxelLattice { origin: Point::origin(), axes }
}

/// Whether no field of the form was ever set.
fn is_zero(form: &VoxelLattice) -> bool {
    form.axes.iter().flatten().all(|c| *c == 0.0)
}

/// Whether the steps are finite and span the space.
fn is_usable(form: &VoxelLattice) -> bool {
    let finite = form.origin.iter().chain(form.axes.iter().flatten()).all(|c| c.is_finite());
    let volume = Matrix3::from_columns(&form.axes).determinant().abs();
    finite && volume > 1e-3 * form.axes.iter().map(|a| a.norm()).product::<f64>()
}

/// The sform, RAS mm.
fn sform(header: &NiftiHeader, mm: f64) -> VoxelLattice {
    let rows = [header.srow_x, header.srow_y, header.srow_z].map(|row| row.map(|value| f64::from(value) * mm));
    let [[ax, bx, cx, ox], [ay, by, cy, oy], [az, bz, cz, oz]] = rows;
    let axes = [Vector::new(ax, ay, az), Vector::new(bx, by, bz), Vector::new(cx, cy, cz)];
    VoxelLattice { origin: Point::new(ox, oy, oz), axes }
}

/// The qform, RAS mm.
#[expect(clippy::arithmetic_side_effects, reason = "floating point")]
fn qform(header: &NiftiHeader, mm: f64) -> Result<VoxelLattice, ImportError> {
    let [qfac, x, y, z, ..] = header.pixdim.map(f64::from);
    let [b, c, d] = [header.quatern_b, header.quatern_c, header.quatern_d].map(f64::from);
    let rest = 1.0 - (b * b + c * c + d * d);
    if !(x > 0.0 && y > 0.0 && z > 0.0) {
        return Err(malformed(FORMAT, format!("the spacing is {x:?} x {y:?} x {z:?}, expected positive")));
    }
    // At a half turn the rest is 0, and rounding in f32 may make it negative.
    if rest.is_nan() || rest < -1e-4 {
        return Err(malformed(FORMAT, "the quaternion of the qform has a norm above 1"));
    }
    let rotation = UnitQuaternion::from_quaternion(Quaternion::new(rest.max(0.0).sqrt(), b, c, d));
    let z = if qfac < 0.0 { -z } else { z };
    let axes = [Vector::x() * x, Vector::y() * y, Vector::z() * z].map(|axis| rotation * axis * mm);
    let origin = [header.quatern_x, header.quatern_y, header.quatern_z].map(|offset| f64::from(offset) * mm);
    if !origin.iter().all(|c| c.is_finite()) {
        return Err(malformed(FORMAT, "the offset of the qform is not finite"));
    }
    Ok(VoxelLattice { origin: Point::from(origin), axes })
}

/// Millimetres in the header's unit of length.
fn unit(header: &NiftiHeader, warnings: &mut Vec<Warning>) -> Result<f64, ImportError> {
    match header.xyzt_units & 7 {
        2 => Ok(1.0),
        0 => {
            let found = "the header has no unit of length; mm was assumed";
            warnings.push(Warning::check("no-unit", found).act("Check the size of the head."));
            Ok(1.0)
        }
        1 => {
            warnings.push(converted("metres"));
            Ok(1e3)
        }
        3 => {
            warnings.push(converted("micrometres"));
            Ok(1e-3)
        }
        code => Err(malformed(FORMAT, format!("the unit of length has the code {code}, expected 0 to 3"))),
    }
}

fn converted(unit: &str) -> Warning {
    Warning::check("converted-unit", format!("{unit} were converted to mm")).act("Check the size of the head.")
}
