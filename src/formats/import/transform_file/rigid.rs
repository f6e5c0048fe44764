//! Which maps are motions of a rigid body.

use nalgebra::{Matrix3, Matrix4, Rotation3, Translation3, UnitQuaternion};
use prosopon_geometry::Motion;

use super::Affine;

/// Largest entry of `RᵀR - I` of a rotation matrix `R`.
///
/// Numbers with four decimals stay below 0.0003. A scale of 1.0005 just passes: 0.05 mm at 100 mm from the centre.
pub const RIGID_WITHIN: f64 = 1e-3;
/// Below this the matrix is a rotation with rounded numbers, and nobody needs to know.
const EXACT_WITHIN: f64 = 1e-5;
/// Largest magnitude of a coordinate, mm.
const REACH_MM: f64 = 10_000.0;

/// Why a map is no motion of a rigid body.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum NotRigid {
    /// A number is not finite, or a length is beyond 10 m.
    #[error("has a number that is not finite, or a translation of more than {REACH_MM} mm")]
    OutOfRange,
    /// The last row of a 4 × 4 matrix is not 0 0 0 1.
    #[error("has the last row {0} {1} {2} {3}, but it must be 0 0 0 1 (row by row, x to z in mm)")]
    LastRow(f64, f64, f64, f64),
    /// The translation stands in the last row.
    #[error("is written column by column: its last row holds the translation {0} {1} {2}; transpose it")]
    Transposed(f64, f64, f64),
    /// It turns left into right.
    #[error("is a mirror image (its determinant is {0:.4}); a bone can only be turned and shifted")]
    Mirror(f64),
    /// It scales evenly.
    #[error("scales by {0:.4}, allowed is 1 within 0.0005; a bone can only be turned and shifted")]
    Scale(f64),
    /// It stretches or shears.
    #[error(
        "stretches or shears by {0:.4} to {1:.4}, allowed is 1 within 0.0005; a bone can only be turned and shifted"
    )]
    Stretch(f64, f64),
}

/// A motion, and how far the map was from it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RigidMotion {
    /// The nearest motion.
    pub motion: Motion,
    /// Largest entry of `RᵀR - I`, where it is not only rounding.
    pub off_by: Option<f64>,
}

/// The motion nearest to `affine`.
///
/// # Errors
/// [`NotRigid`] where an entry of `RᵀR - I` exceeds [`RIGID_WITHIN`], or the map mirrors.
#[expect(clippy::arithmetic_side_effects, reason = "floating point")]
pub fn rigid_motion(affine: &Affine) -> Result<RigidMotion, NotRigid> {
    let Affine { matrix, offset_mm } = affine;
    if !matrix.iter().all(|c| c.abs() < REACH_MM) || !offset_mm.iter().all(|c| c.abs() <= REACH_MM) {
        return Err(NotRigid::OutOfRange);
    }
    let off_by = (matrix.transpose() * matrix - Matrix3::identity()).amax();
    let svd = matrix.try_svd(true, true, f64::EPSILON, 200).ok_or(NotRigid::OutOfRange)?;
    let (smallest, largest) = (svd.singular_values.min(), svd.singular_values.max());
    if off_by > RIGID_WITHIN && largest - smallest > RIGID_WITHIN {
        return Err(NotRigid::Stretch(smallest, largest));
    }
    if matrix.determinant() < 0.0 {
        return Err(NotRigid::Mirror(matrix.determinant()));
    }
    if off_by > RIGID_WITHIN {
        return Err(NotRigid::Scale(0.5 * (smallest + largest)));
    }
    let (Some(u), Some(v_t)) = (svd.u, svd.v_t) else { return Err(NotRigid::OutOfRange) };
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(u * v_t));
    let motion = Motion::from_parts(Translation3::from(*offset_mm), rotation);
    Ok(RigidMotion { motion, off_by: Some(off_by).filter(|off| *off > EXACT_WITHIN) })
}

/// The motion of a 4 × 4 matrix, `rows[row][column]`, mm.
///
/// # Errors
/// As [`rigid_motion`], and where the last row is not 0 0 0 1.
pub fn rigid_of_matrix(rows: &[[f64; 4]; 4]) -> Result<RigidMotion, NotRigid> {
    let [[_, _, _, x], [_, _, _, y], [_, _, _, z], last] = *rows;
    let [a, b, c, d] = last;
    if !rows.iter().flatten().all(|n| n.is_finite()) {
        return Err(NotRigid::OutOfRange);
    }
    if [a, b, c, d - 1.0].iter().any(|n| n.abs() > 1e-9) {
        let holds_translation = [x, y, z].iter().all(|n| n.abs() < 1e-9) && (d - 1.0).abs() < 1e-9;
        return Err(if holds_translation { NotRigid::Transposed(a, b, c) } else { NotRigid::LastRow(a, b, c, d) });
    }
    let matrix = Matrix4::from_fn(|row, column| rows.get(row).and_then(|r| r.get(column)).copied().unwrap_or_default());
    let matrix = matrix.fixed_view::<3, 3>(0, 0).into_owned();
    rigid_motion(&Affine { matrix, offset_mm: nalgebra::Vector3::new(x, y, z) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use prosopon_geometry::{Point, Vector};

    fn rows(scale: f64, axes: [f64; 3], t: [f64; 3]) -> [[f64; 4]; 4] {
        let turn = UnitQuaternion::from_euler_angles(axes[0], axes[1], axes[2]).to_rotation_matrix();
        let m = turn.matrix() * scale;
        [0, 1, 2, 3].map(|r| if r < 3 { [m[(r, 0)], m[(r, 1)], m[(r, 2)], t[r]] } else { [0.0, 0.0, 0.0, 1.0] })
    }

    #[test]
    fn a_matrix_moves_points_as_its_product_does() {
        let m = rows(1.0, [0.1, -0.2, 0.3], [1.5, -6.0, -1.25]);
        let read = rigid_of_matrix(&m).unwrap();
        let p = Point::new(6.0, -60.0, 38.0);
        let expected = [0, 1, 2].map(|r| m[r][0] * p.x + m[r][1] * p.y + m[r][2] * p.z + m[r][3]);
        assert!((read.motion * p - Point::from(expected)).norm() < 1e-12);
        assert_eq!(read.off_by, None);
        // Four decimals are taken with a note or without one, not refused.
        let rounded = m.map(|row| row.map(|n| (n * 1e4).round() / 1e4));
        let read = rigid_of_matrix(&rounded).unwrap();
        assert!(read.off_by.is_some_and(|off| off < 3e-4));
        assert!((read.motion * p - Point::from(expected)).norm() < 0.01);
        assert!((rigid_of_matrix(&rows(1.0, [0.0; 3], [0.0; 3])).unwrap().motion * p - p).norm() < 1e-15);
        assert_eq!(rigid_of_matrix(&rows(1.0004, [0.5, 0.0, 0.0], [0.0; 3])).map(|r| r.off_by.is_some()), Ok(true));
    }

    #[test]
    fn what_is_not_rigid_is_refused_with_how_far_it_is_off() {
        let sound = rows(1.0, [0.1, -0.2, 0.3], [1.5, -6.0, -1.25]);
        let with = |change: &dyn Fn(&mut [[f64; 4]; 4])| {
            let mut m = sound;
            change(&mut m);
            rigid_of_matrix(&m).unwrap_err().to_string()
        };
        let transposed = [0, 1, 2, 3].map(|r| [0, 1, 2, 3].map(|c| sound[c][r]));
        for (text, part) in [
            (rigid_of_matrix(&rows(1.02, [0.1, 0.0, 0.0], [0.0; 3])).unwrap_err().to_string(), "scales by 1.0200"),
            (rigid_of_matrix(&rows(0.1, [0.1, 0.0, 0.0], [0.0; 3])).unwrap_err().to_string(), "scales by 0.1000"),
            (rigid_of_matrix(&rows(0.0, [0.1, 0.0, 0.0], [0.0; 3])).unwrap_err().to_string(), "scales by 0.0000"),
            (
                with(&|m| m.iter_mut().take(3).for_each(|row| row[0] = -row[0])),
                "mirror image (its determinant is -1.0000)",
            ),
            (with(&|m| m.iter_mut().take(3).for_each(|row| row[0] *= 1.1)), "stretches or shears by 1.0000 to 1.1000"),
            (with(&|m| m[0][1] += 0.1), "stretches or shears"),
            (with(&|m| m[3] = [0.0, 0.0, 0.0, 2.0]), "last row 0 0 0 2"),
            (with(&|m| m[1][3] = 1e9), "more than 10000 mm"),
            (with(&|m| m[1][2] = f64::NAN), "not finite"),
            (
                rigid_of_matrix(&transposed).unwrap_err().to_string(),
                "column by column: its last row holds the translation 1.5 -6 -1.25",
            ),
        ] {
            assert!(text.contains(part), "{part}: {text}");
        }
    }

    #[test]
    fn the_inverse_takes_points_back() {
        let motion = rigid_of_matrix(&rows(1.0, [0.1, -0.2, 0.3], [1.5, -6.0, -1.25])).unwrap().motion;
        let p = Point::from(Vector::new(6.0, -60.0, 38.0));
        assert!((motion.inverse() * (motion * p) - p).norm() < 1e-12);
    }
}
