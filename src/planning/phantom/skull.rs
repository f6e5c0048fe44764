//! Bone and teeth: cranium with the upper jaw, and the separate mandible and hyoid.

use super::air::airway;
use super::arches::{LOWER_ARCH, UPPER_ARCH};
use super::dual::Real;
use super::shapes::{Arch, capsule, difference, ellipsoid, intersection, mirrored, rounded_box, union};

/// Distance of bone from the air of nose and throat, mm.
const MUCOSA_MM: f64 = 2.0;

/// Centre lines of the alveolar processes, behind the crowns.
const UPPER_ALVEOLAR: Arch = Arch { half_width: 26.0, depth: 48.0, back_y: -31.0 };
const LOWER_ALVEOLAR: Arch = Arch { half_width: 25.0, depth: 43.0, back_y: -31.0 };

/// Number of teeth over half an ellipse; the last ones lie where the arch becomes straight.
const TEETH: f64 = 7.0;

/// An ellipsoid on the left and its mirror image, mm.
pub(super) struct Ellipsoids {
    pub(super) center: [f64; 3],
    pub(super) radii: [f64; 3],
}

/// The orbits.
pub(super) const ORBIT: Ellipsoids = Ellipsoids { center: [30.0, -76.0, 69.0], radii: [17.5, 28.0, 16.0] };

pub(super) fn skull<T: Real>(p: [T; 3]) -> T {
    let s = mirrored(p);
    // Gaps separate the three, so the plain minimum is smooth near their surfaces.
    upper(p, s).min(mandible(p, s)).min(hyoid(s))
}

fn upper<T: Real>(p: [T; 3], s: [T; 3]) -> T {
    let mut bone = union(cranium(p), midface(p, s), 6.0);
    bone = union(bone, zygoma(s), 6.0);
    bone = difference(bone, ellipsoid(s, ORBIT.center, ORBIT.radii), 4.0);
    bone = union(bone, nasal_bones(s), 5.0);
    bone = difference(bone, airway(p) - MUCOSA_MM, 3.0);
    bone = union(bone, nasal_spine(p), 3.0);
    union(bone, upper_teeth(p), 1.5)
}

/// Thick shell, closed inside, with a flat base.
fn cranium<T: Real>(p: [T; 3]) -> T {
    let outer = ellipsoid(p, [0.0, 1.0, 92.0], [69.0, 89.0, 71.0]);
    let outer = intersection(outer, -p[2] + 42.0, 16.0);
    let inner = ellipsoid(p, [0.0, 2.0, 92.0], [61.0, 79.0, 63.0]);
    let inner = intersection(inner, -p[2] + 52.0, 16.0);
    // The floor rises towards the front, above the orbits.
    let inner = intersection(inner, (p[1] + 25.0) * -0.74 - (p[2] - 54.0) * 0.67, 12.0);
    difference(outer, inner, 2.0)
}

fn midface<T: Real>(p: [T; 3], s: [T; 3]) -> T {
    let brow = capsule(s, [0.0, -85.5, 88.0], [43.0, -68.0, 86.0], 6.0, 4.5);
    let core = rounded_box(p, [0.0, -48.0, 54.0], [20.0, 26.0, 24.0], 10.0);
    let maxilla = ellipsoid(p, [0.0, -54.0, 37.0], [35.0, 25.0, 20.0]);
    let frontal_process = capsule(s, [14.5, -74.0, 32.0], [6.5, -80.5, 78.0], 4.5, 3.5);
    let alveolar = UPPER_ALVEOLAR.wall(p, 4.8, [8.0, 29.0], -31.0, 4.0);
    let palate = intersection(UPPER_ARCH.distance(p), (p[2] - 21.0).abs() - 6.0, 6.0);
    let palate = intersection(palate, p[1] + 31.0, 4.0);
    let mut bone = union(core, maxilla, 8.0);
    bone = union(bone, frontal_process, 5.0);
    bone = union(bone, brow, 6.0);
    union(bone, union(alveolar, palate, 4.0), 6.0)
}

/// Zygoma with the lateral and lower rim of the orbit and the zygomatic arch to the ear.
fn zygoma<T: Real>(s: [T; 3]) -> T {
    let body = ellipsoid(s, [44.0, -52.0, 45.0], [15.0, 15.0, 10.0]);
    let lower_rim = capsule(s, [46.0, -58.0, 51.0], [14.0, -73.0, 51.0], 5.0, 4.5);
    let lateral_rim = capsule(s, [48.0, -57.0, 50.0], [47.0, -61.0, 86.0], 5.0, 5.0);
    let arch = capsule(s, [52.0, -44.0, 46.0], [59.0, 4.0, 51.0], 4.0, 3.5);
    let lateral_wall = capsule(s, [45.0, -46.0, 56.0], [48.0, -44.0, 82.0], 6.0, 7.0);
    let mut bone = union(body, lower_rim, 6.0);
    bone = union(bone, union(lateral_rim, lateral_wall, 6.0), 6.0);
    union(bone, arch, 6.0)
}

fn nasal_bones<T: Real>(s: [T; 3]) -> T {
    capsule(s, [1.6, -84.4, 82.0], [2.2, -93.9, 62.0], 4.5, 2.8)
}

fn nasal_spine<T: Real>(p: [T; 3]) -> T {
    capsule(p, [0.0, -74.0, 24.5], [0.0, -82.8, 28.0], 4.0, 1.8)
}

fn upper_teeth<T: Real>(p: [T; 3]) -> T {
    let crowns = UPPER_ARCH.wall(p, 3.5, [1.1, 14.0], -33.0, 1.8);
    crowns + UPPER_ARCH.teeth_wave(p, TEETH) * 0.6
}

fn mandible<T: Real>(p: [T; 3], s: [T; 3]) -> T {
    let body = capsule(s, [46.0, -6.0, -16.0], [22.0, -62.0, -27.0], 8.0, 8.5);
    let front = capsule(s, [22.0, -62.0, -27.0], [6.0, -71.5, -29.0], 8.5, 8.5);
    let chin = ellipsoid(p, [0.0, -74.3, -34.0], [15.0, 8.5, 8.0]);
    let alveolar = LOWER_ALVEOLAR.wall(p, 4.8, [-28.0, -8.0], -28.0, 4.0);
    let crowns = LOWER_ARCH.wall(p, 3.3, [-14.0, -1.1], -33.0, 1.8) + LOWER_ARCH.teeth_wave(p, TEETH) * 0.6;
    let ramus = ramus(s);
    let mut bone = union(body, front, 6.0);
    bone = union(bone, chin, 6.0);
    bone = union(bone, alveolar, 6.0);
    bone = union(bone, ramus, 6.0);
    union(bone, crowns, 1.5)
}

fn ramus<T: Real>(s: [T; 3]) -> T {
    let neck = capsule(s, [45.5, -1.0, -14.0], [47.0, 8.0, 30.0], 6.5, 4.5);
    let front = capsule(s, [45.0, -22.0, -12.0], [46.0, -16.0, 30.0], 5.0, 3.0);
    let plate = rounded_box(s, [46.0, -8.0, 4.0], [3.5, 12.0, 20.0], 3.4);
    let condyle = ellipsoid(s, [47.5, 8.0, 33.0], [9.0, 5.0, 5.0]);
    let mut bone = union(neck, front, 4.0);
    bone = union(bone, plate, 4.0);
    union(bone, condyle, 3.0)
}

/// Body and greater horns, open to the back, as high as the mandible's lower border.
fn hyoid<T: Real>(s: [T; 3]) -> T {
    let body = capsule(s, [0.0, -11.0, -49.0], [10.0, -8.0, -49.0], 4.0, 3.2);
    let horn = capsule(s, [10.0, -8.0, -49.0], [20.0, 19.0, -45.0], 2.8, 2.2);
    union(body, horn, 2.0)
}
