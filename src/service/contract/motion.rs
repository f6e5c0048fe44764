use nalgebra::{Quaternion, Translation3, UnitQuaternion};
use prosopon_geometry::{Motion, Point, Vector};

/// Motion from rest: a rotation about `pivot` (mm), then a translation (mm).
#[must_use]
pub fn motion_from(translation: Vector, rotation: UnitQuaternion<f64>, pivot: Point) -> Motion {
    let shift = translation + pivot.coords - rotation * pivot.coords;
    Motion::from_parts(Translation3::from(shift), rotation)
}

/// Translation (mm, of the point at the origin) and rotation (unit quaternion x, y, z, w).
#[must_use]
pub fn motion_parts(motion: &Motion) -> ([f64; 3], [f64; 4]) {
    let q = motion.rotation.quaternion();
    (motion.translation.vector.into(), [q.i, q.j, q.k, q.w])
}

/// The motion of a stored translation (mm) and quaternion (x, y, z, w).
pub(super) fn motion_of(translation_mm: [f64; 3], [x, y, z, w]: [f64; 4]) -> Motion {
    Motion::from_parts(
        Translation3::from(Vector::from(translation_mm)),
        UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z)),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_pivot_moves_by_the_translation_alone() {
        let pivot = Point::new(6.0, -60.0, 38.0);
        let rotation = UnitQuaternion::from_euler_angles(0.1, -0.2, 0.3);
        let motion = motion_from(Vector::new(0.0, -6.0, -1.5), rotation, pivot);
        assert!((motion * pivot - Point::new(6.0, -66.0, 36.5)).norm() < 1e-12);
        let (translation, quaternion) = motion_parts(&motion);
        assert!((motion_of(translation, quaternion).to_matrix() - motion.to_matrix()).norm() < 1e-14);
    }
}
