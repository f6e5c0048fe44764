//! Air inside the head: nasal cavity with the throat, and the mouth.

use super::arches::{LOWER_ARCH, UPPER_ARCH};
use super::dual::Real;
use super::shapes::{capsule, ellipsoid, intersection, rounded_box, union};

pub(super) fn air<T: Real>(p: [T; 3]) -> T {
    airway(p).min(mouth(p))
}

pub(super) fn airway<T: Real>(p: [T; 3]) -> T {
    union(nasal_cavity(p), throat(p), 5.0)
}

/// Airway from the vestibule of the nose to the choanae.
fn nasal_cavity<T: Real>(p: [T; 3]) -> T {
    let cavity = rounded_box(p, [0.0, -56.0, 42.0], [9.0, 28.0, 11.0], 6.0);
    let roof = rounded_box(p, [0.0, -58.0, 50.0], [4.5, 23.0, 12.0], 4.0);
    union(cavity, roof, 6.0)
}

fn throat<T: Real>(p: [T; 3]) -> T {
    let upper = capsule(p, [0.0, -36.0, 36.0], [0.0, -8.0, 31.0], 7.0, 7.0);
    let lower = capsule(p, [0.0, -8.0, 31.0], [0.0, -4.0, -24.0], 7.0, 7.0);
    union(upper, lower, 4.0)
}

/// Slit between the lips, gap between lips and teeth, and the space below the palate.
fn mouth<T: Real>(p: [T; 3]) -> T {
    let oral = ellipsoid(p, [0.0, -50.0, 8.0], [19.0, 22.0, 4.0]);
    let upper = slab(UPPER_ARCH.distance(p) - 5.7, 1.1, p[2] - 6.0, 6.0);
    let lower = slab(LOWER_ARCH.distance(p) - 5.6, 1.4, p[2] + 5.8, 6.2);
    let vestibule = intersection(union(upper, lower, 2.0), p[1] + 55.0, 1.5);
    let slit = slab(UPPER_ARCH.distance(p) - 7.3, 2.6, p[2] - 1.2, 1.0);
    let slit = intersection(intersection(slit, p[0].abs() - 15.0, 1.5), p[1] + 55.0, 1.5);
    union(vestibule, slit, 1.5).min(oral)
}

/// As [`air`], with closed lips: a thin vestibule in front of the teeth, and no air between the lips.
pub(super) fn air_with_closed_lips<T: Real>(p: [T; 3]) -> T {
    let oral = ellipsoid(p, [0.0, -50.0, 8.0], [19.0, 22.0, 4.0]);
    let upper = slab(UPPER_ARCH.distance(p) - 5.1, 0.8, p[2] - 6.0, 6.0);
    let lower = slab(LOWER_ARCH.distance(p) - 5.3, 1.0, p[2] + 5.8, 7.8);
    let vestibule = intersection(union(upper, lower, 2.0), p[1] + 55.0, 1.5);
    airway(p).min(vestibule.min(oral))
}

/// Infinite slab of points whose two coordinates are smaller than the half extents.
fn slab<T: Real>(u: T, half_u: f64, v: T, half_v: f64) -> T {
    intersection(u.abs() - half_u, v.abs() - half_v, 1.0)
}
