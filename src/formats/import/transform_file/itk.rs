//! What the parameters of ITK's transforms mean.

use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};
use prosopon_geometry::Vector;

use super::Affine;

/// Most transforms of a composite.
const MAX_TRANSFORMS: usize = 64;

/// A transform as ITK stores it.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ItkTransform {
    /// Name of the class, with or without `_double_3_3`.
    pub kind: String,
    /// What an optimiser of ITK may change.
    pub parameters: Vec<f64>,
    /// Mostly the centre of rotation, mm.
    pub fixed: Vec<f64>,
}

/// The map of a transform, or of a composite transform and its parts in ITK's order: the last part is applied first.
///
/// # Errors
/// A text that says what is missing or cannot be used.
#[expect(clippy::arithmetic_side_effects, reason = "floating point")]
pub fn itk_affine(transforms: &[ItkTransform]) -> Result<Affine, String> {
    let parts = match transforms {
        [] => return Err("it has no transform".to_owned()),
        [one] => std::slice::from_ref(one),
        [first, parts @ ..] if class_of(first)? == "CompositeTransform" => parts,
        many => {
            return Err(format!(
                "it has {} transforms and no order for them; save one transform, or a composite one",
                many.len()
            ));
        }
    };
    if parts.len() > MAX_TRANSFORMS {
        return Err(format!("it has {} transforms, at most {MAX_TRANSFORMS} are allowed", parts.len()));
    }
    let mut whole = Affine { matrix: Matrix3::identity(), offset_mm: Vector::zeros() };
    for part in parts {
        let part = one(part)?;
        whole =
            Affine { offset_mm: whole.matrix * part.offset_mm + whole.offset_mm, matrix: whole.matrix * part.matrix };
    }
    let is_finite = whole.matrix.iter().chain(&whole.offset_mm).all(|n| n.is_finite());
    if is_finite { Ok(whole) } else { Err("its numbers are too large".to_owned()) }
}

/// The class without number type and dimensions, which must be three.
fn class_of(transform: &ItkTransform) -> Result<&str, String> {
    let name = transform.kind.trim();
    let (class, rest) = name.split_once('_').unwrap_or((name, ""));
    if !["", "double_3_3", "float_3_3"].contains(&rest) {
        return Err("its transform is not one of three dimensions".to_owned());
    }
    Ok(class)
}

#[expect(clippy::arithmetic_side_effects, reason = "floating point")]
fn one(transform: &ItkTransform) -> Result<Affine, String> {
    let class = class_of(transform)?;
    let p = Numbers::of(&transform.parameters)?;
    let fixed = Numbers::of(&transform.fixed)?;
    let centre = if transform.fixed.is_empty() { Some(Vector::zeros()) } else { fixed.vector(0) };
    let centre = centre.ok_or("its fixed parameters are no point")?;
    let count = |allowed: usize, found: Option<Affine>| {
        let detail = || format!("its {} parameters are not the {allowed} of its kind", transform.parameters.len());
        found.filter(|_| transform.parameters.len() == allowed).ok_or_else(detail)
    };
    match class {
        "IdentityTransform" => count(0, Some(about(Matrix3::identity(), Vector::zeros(), centre))),
        "TranslationTransform" => count(3, p.vector(0).map(|t| about(Matrix3::identity(), t, centre))),
        "AffineTransform"
        | "MatrixOffsetTransformBase"
        | "Rigid3DTransform"
        | "FixedCenterOfRotationAffineTransform" => {
            count(12, p.matrix().zip(p.vector(9)).map(|(m, t)| about(m, t, centre)))
        }
        "CenteredAffineTransform" => {
            count(15, p.matrix().zip(p.vector(9)).zip(p.vector(12)).map(|((m, c), t)| about(m, t, c)))
        }
        "Euler3DTransform" => {
            let is_zyx = transform.fixed.get(3).is_some_and(|flag| *flag != 0.0);
            count(6, p.vector(0).zip(p.vector(3)).map(|(angles, t)| about(euler(angles, is_zyx), t, centre)))
        }
        "CenteredEuler3DTransform" => {
            let parts = p.vector(0).zip(p.vector(3)).zip(p.vector(6));
            count(9, parts.map(|((angles, c), t)| about(euler(angles, false), t, c)))
        }
        "VersorTransform" => count(3, p.versor().map(|m| about(m, Vector::zeros(), centre))),
        "VersorRigid3DTransform" => count(6, p.versor().zip(p.vector(3)).map(|(m, t)| about(m, t, centre))),
        "Similarity3DTransform" => {
            let parts = p.versor().zip(p.vector(3)).zip(p.get(6));
            count(7, parts.map(|((m, t), scale)| about(m * scale, t, centre)))
        }
        "QuaternionRigidTransform" => count(7, p.quaternion().zip(p.vector(4)).map(|(m, t)| about(m, t, centre))),
        "CompositeTransform" => Err("its composite transform has no parts, or has composite ones".to_owned()),
        other
            if ["BSpline", "DisplacementField", "ThinPlate", "Velocity", "Kernel"]
                .iter()
                .any(|w| other.contains(w)) =>
        {
            Err("its transform is a deformation; a bone can only be turned and shifted".to_owned())
        }
        _ => Err("its kind of transform is not supported; save it as an affine transform".to_owned()),
    }
}

/// `y = m (x - centre) + centre + t`.
#[expect(clippy::arithmetic_side_effects, reason = "floating point")]
fn about(m: Matrix3<f64>, t: Vector, centre: Vector) -> Affine {
    Affine { matrix: m, offset_mm: t + centre - m * centre }
}

/// Rotations about fixed axes, radian: y first, then x, then z; or x first, then y, then z.
#[expect(clippy::arithmetic_side_effects, reason = "floating point")]
fn euler(angles: Vector, is_zyx: bool) -> Matrix3<f64> {
    let about = |axis, angle| UnitQuaternion::from_axis_angle(&axis, angle);
    let x = about(Vector3::x_axis(), angles.x);
    let y = about(Vector3::y_axis(), angles.y);
    let z = about(Vector3::z_axis(), angles.z);
    let turn = if is_zyx { z * y * x } else { z * x * y };
    *turn.to_rotation_matrix().matrix()
}

/// Finite numbers.
#[derive(Debug, Clone, Copy)]
struct Numbers<'a>(&'a [f64]);

impl<'a> Numbers<'a> {
    fn of(numbers: &'a [f64]) -> Result<Self, String> {
        let finite = numbers.iter().all(|n| n.is_finite());
        if finite { Ok(Self(numbers)) } else { Err("a parameter is not finite".to_owned()) }
    }

    fn get(self, at: usize) -> Option<f64> {
        self.0.get(at).copied()
    }

    fn vector(self, at: usize) -> Option<Vector> {
        let [x, y, z] = *self.0.get(at..)?.first_chunk::<3>()?;
        Some(Vector::new(x, y, z))
    }

    /// The first nine numbers, row by row.
    fn matrix(self) -> Option<Matrix3<f64>> {
        Some(Matrix3::from_row_slice(self.0.first_chunk::<9>()?))
    }

    /// The vector part of a unit quaternion whose scalar part is not negative.
    fn versor(self) -> Option<Matrix3<f64>> {
        let v = self.vector(0).filter(|v| v.norm_squared() <= 1.0 + 1e-6)?;
        turn(Quaternion::new((1.0 - v.norm_squared()).max(0.0).sqrt(), v.x, v.y, v.z))
    }

    /// Quaternion x, y, z, w.
    fn quaternion(self) -> Option<Matrix3<f64>> {
        let [x, y, z, w] = *self.0.first_chunk::<4>()?;
        turn(Quaternion::new(w, x, y, z))
    }
}

fn turn(q: Quaternion<f64>) -> Option<Matrix3<f64>> {
    UnitQuaternion::try_new(q, 1e-9).map(|q| *q.to_rotation_matrix().matrix())
}
