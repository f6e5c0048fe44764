//! Position and axes of the voxel lattice.

use nalgebra::{Matrix3, Quaternion, UnitQuaternion};
use nifti::NiftiHeader;

use super::super::ImportError;
use super::super::error::malformed;
use super::FORMAT;
use prosopon_geometry::{Point, Vector};

/// Origin and axes in LPS mm, from the sform if there is one, else the qform, else the spacing alone.
///
/// Source: methods 3, 2 and 1 of the NIfTI-1 header `nifti1.h`. They give RAS, whose x and y are the negatives of LPS.
#[expect(clippy::arithmetic_side_effects, reason = "floating point")]
pub(super) fn read(
    header: &NiftiHeader,
    dims: [usize; 3],
    warnings: &mut Vec<String>,
) -> Result<(Point, [Vector; 3]), ImportError> {
    let sform = (header.sform_code > 0).then(|| sform(header));
    let qform = (header.qform_code > 0).then(|| qform(header));
    let (origin, axes) = match (sform, qform) {
        (Some(sform), qform) => {
            if let Some(Ok(qform)) = qform {
                let far = dims.map(|d| d as f64);
                let apart = (position(&sform.0, &sform.1, far) - position(&qform.0, &qform.1, far))
                    .norm()
                    .max((sform.0 - qform.0).norm());
                let voxel = sform.1[0].norm();
                if apart > 0.5 * voxel {
                    let apart = apart / voxel;
                    warnings.push(format!("sform and qform differ by {apart:.1} voxels; the sform was used"));
                }
            }
            sform
        }
        (None, Some(qform)) => qform?,
        (None, None) => {
            warnings.push(
                "the header has no orientation: i was assumed to run to the patient's right, j to the front, k up; \
                 left and right may be swapped"
                    .to_owned(),
            );
            let [_, x, y, z, ..] = header.pixdim.map(f64::from);
            (Point::origin(), [Vector::new(x, 0.0, 0.0), Vector::new(0.0, y, 0.0), Vector::new(0.0, 0.0, z)])
        }
    };

    let mm = unit(header, warnings)?;
    // Adding zero turns -0 into 0.
    let lps = |v: Vector| (Vector::new(-v.x, -v.y, v.z) * mm).add_scalar(0.0);
    let (origin, axes) = (Point::from(lps(origin.coords)), axes.map(lps));
    let finite = origin.iter().chain(axes.iter().flatten()).all(|c| c.is_finite());
    // Sheared axes (gantry tilt) are allowed, axes in one plane are not.
    let volume = Matrix3::from_columns(&axes).determinant().abs();
    let in_space = volume > 1e-3 * axes[0].norm() * axes[1].norm() * axes[2].norm();
    if !finite || !in_space {
        return Err(malformed(FORMAT, "the steps between voxels are zero, not finite, or all in one plane"));
    }
    Ok((origin, axes))
}

/// Centre of the voxel `index`.
#[expect(clippy::arithmetic_side_effects, reason = "floating point")]
pub(super) fn position(origin: &Point, axes: &[Vector; 3], index: [f64; 3]) -> Point {
    origin + axes[0] * index[0] + axes[1] * index[1] + axes[2] * index[2]
}

fn sform(header: &NiftiHeader) -> (Point, [Vector; 3]) {
    let rows = [header.srow_x, header.srow_y, header.srow_z].map(|row| row.map(f64::from));
    let [[ax, bx, cx, ox], [ay, by, cy, oy], [az, bz, cz, oz]] = rows;
    (Point::new(ox, oy, oz), [Vector::new(ax, ay, az), Vector::new(bx, by, bz), Vector::new(cx, cy, cz)])
}

#[expect(clippy::arithmetic_side_effects, reason = "floating point")]
fn qform(header: &NiftiHeader) -> Result<(Point, [Vector; 3]), ImportError> {
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
    Ok((Point::new(ox, oy, oz), axes))
}

/// Millimetres in the header's unit of length.
fn unit(header: &NiftiHeader, warnings: &mut Vec<String>) -> Result<f64, ImportError> {
    match header.xyzt_units & 7 {
        2 => Ok(1.0),
        0 => {
            warnings.push("the header has no unit of length; mm was assumed".to_owned());
            Ok(1.0)
        }
        1 => {
            warnings.push("metres were converted to mm".to_owned());
            Ok(1e3)
        }
        3 => {
            warnings.push("micrometres were converted to mm".to_owned());
            Ok(1e-3)
        }
        code => Err(malformed(FORMAT, format!("the unit of length has the code {code}, expected 0 to 3"))),
    }
}
