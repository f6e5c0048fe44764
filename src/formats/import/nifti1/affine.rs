//! Position and axes of the voxel lattice.

use nalgebra::{Quaternion, UnitQuaternion};
use nifti::NiftiHeader;

use super::super::ImportError;
use super::super::error::malformed;
use super::super::lattice::VoxelLattice;
use super::FORMAT;
use prosopon_geometry::{Point, Vector, Warning};

/// The lattice in LPS mm, from the sform if there is one, else the qform, else the spacing alone.
///
/// Source: methods 3, 2 and 1 of the NIfTI-1 header `nifti1.h`. They give RAS, whose x and y are the negatives of LPS.
#[expect(clippy::arithmetic_side_effects, reason = "floating point")]
pub(super) fn read(
    header: &NiftiHeader,
    dims: [usize; 3],
    warnings: &mut Vec<Warning>,
) -> Result<VoxelLattice, ImportError> {
    let sform = (header.sform_code > 0).then(|| sform(header));
    let qform = (header.qform_code > 0).then(|| qform(header));
    let lattice = match (sform, qform) {
        (Some(sform), qform) => {
            if let Some(Ok(qform)) = qform {
                let far = dims.map(|d| d as f64);
                let apart =
                    (sform.position(far) - qform.position(far)).norm().max((sform.origin - qform.origin).norm());
                let voxel = sform.axes[0].norm();
                if apart > 0.5 * voxel {
                    let apart = apart / voxel;
                    let found = format!("sform and qform differ by {apart:.1} voxels; the sform was used");
                    warnings.push(Warning::check("sform-differs", found).act("Check the position and orientation."));
                }
            }
            sform
        }
        (None, Some(qform)) => qform?,
        (None, None) => {
            let found = "the header has no orientation: i was assumed to run to the patient's right, j to the front, k up; \
                 left and right may be swapped";
            warnings.push(Warning::check("no-orientation", found).act("Check left and right."));
            let [_, x, y, z, ..] = header.pixdim.map(f64::from);
            let axes = [Vector::new(x, 0.0, 0.0), Vector::new(0.0, y, 0.0), Vector::new(0.0, 0.0, z)];
            VoxelLattice { origin: Point::origin(), axes }
        }
    };

    let mm = unit(header, warnings)?;
    // Adding zero turns -0 into 0.
    let lps = |v: Vector| (Vector::new(-v.x, -v.y, v.z) * mm).add_scalar(0.0);
    Ok(VoxelLattice { origin: Point::from(lps(lattice.origin.coords)), axes: lattice.axes.map(lps) })
}

fn sform(header: &NiftiHeader) -> VoxelLattice {
    let rows = [header.srow_x, header.srow_y, header.srow_z].map(|row| row.map(f64::from));
    let [[ax, bx, cx, ox], [ay, by, cy, oy], [az, bz, cz, oz]] = rows;
    let axes = [Vector::new(ax, ay, az), Vector::new(bx, by, bz), Vector::new(cx, cy, cz)];
    VoxelLattice { origin: Point::new(ox, oy, oz), axes }
}

#[expect(clippy::arithmetic_side_effects, reason = "floating point")]
fn qform(header: &NiftiHeader) -> Result<VoxelLattice, ImportError> {
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
    let axes = [Vector::x() * x, Vector::y() * y, Vector::z() * z].map(|axis| rotation * axis);
    let [ox, oy, oz] = [header.quatern_x, header.quatern_y, header.quatern_z].map(f64::from);
    Ok(VoxelLattice { origin: Point::new(ox, oy, oz), axes })
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
