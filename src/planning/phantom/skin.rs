//! Everything inside the skin.

use super::dual::Real;
use super::mouth::{MOUTH_BEND_PER_MM, MOUTH_HALF_WIDTH_MM, MOUTH_Z_MM};
use super::shapes::{capsule, difference, ellipsoid, intersection, mirrored, union};

/// Height at which the neck is cut, mm.
const NECK_Z: f64 = -62.0;

pub(super) fn skin<T: Real>(p: [T; 3]) -> T {
    let s = mirrored(p);
    let mut head = union(cranium(p), face(p, s), 22.0);
    head = eyes(head, s);
    head = union(head, nose(p, s), 6.0);
    head = mouth(head, p);
    let neck = capsule(p, [0.0, 30.0, -120.0], [0.0, 24.0, 30.0], 53.0, 50.0);
    head = union(head, neck, 28.0);
    let ear = ellipsoid(s, [68.5, 12.0, 60.0], [6.0, 13.0, 27.0]);
    head = union(head, ear, 4.0);
    intersection(head, -p[2] + NECK_Z, 6.0)
}

/// Half width of the groove between the lips, before its edges are rounded, mm.
const GROOVE_HALF_MM: f64 = 0.5;
/// Depth of the groove, mm.
const GROOVE_DEPTH_MM: f64 = 2.0;

/// The skin with a groove along the line where closed lips meet.
pub(super) fn skin_with_mouth<T: Real>(p: [T; 3]) -> T {
    let head = skin(p);
    let line = (p[2] - mouth_z(p[0])).abs() - GROOVE_HALF_MM;
    let mut groove = intersection(line, -head - GROOVE_DEPTH_MM, 0.5);
    groove = intersection(groove, p[0].abs() - MOUTH_HALF_WIDTH_MM, 1.0);
    groove = intersection(groove, p[1] + 60.0, 1.0);
    difference(head, groove, 0.8)
}

/// Height of the line between closed lips, mm.
fn mouth_z<T: Real>(x: T) -> T {
    -(x.squared() * MOUTH_BEND_PER_MM) + MOUTH_Z_MM
}

fn cranium<T: Real>(p: [T; 3]) -> T {
    ellipsoid(p, [0.0, 2.0, 92.0], [74.5, 93.0, 76.0])
}

fn face<T: Real>(p: [T; 3], s: [T; 3]) -> T {
    let core = ellipsoid(p, [0.0, -24.0, 28.0], [65.0, 62.0, 78.0]);
    let jaw = capsule(s, [44.0, -6.0, -13.0], [14.0, -68.0, -30.0], 17.0, 14.0);
    let ramus = capsule(s, [44.0, -6.0, -13.0], [52.0, 2.0, 44.0], 17.0, 15.0);
    let chin = ellipsoid(p, [0.0, -76.5, -33.0], [18.0, 16.0, 14.5]);
    let cheek_bone = ellipsoid(s, [40.0, -57.0, 40.0], [23.0, 22.0, 20.0]);
    let cheek = ellipsoid(s, [35.0, -52.0, 6.0], [20.0, 24.0, 30.0]);
    let muzzle = ellipsoid(p, [0.0, -69.0, 10.0], [35.0, 27.0, 35.0]);
    let brow = capsule(s, [0.0, -84.0, 89.0], [42.0, -72.0, 87.0], 6.5, 7.0);
    let mut face = union(core, union(jaw, ramus, 8.0), 20.0);
    face = union(face, cheek_bone, 18.0);
    face = union(face, cheek, 18.0);
    face = union(face, brow, 12.0);
    face = union(face, muzzle, 12.0);
    union(face, chin, 18.0)
}

/// Orbits, and eyeballs behind closed lids.
fn eyes<T: Real>(head: T, s: [T; 3]) -> T {
    let socket = ellipsoid(s, [31.5, -97.0, 71.0], [17.5, 17.0, 11.0]);
    let ball = ellipsoid(s, [31.0, -71.0, 71.0], [14.0, 12.5, 12.0]);
    union(difference(head, socket, 12.0), ball, 7.0)
}

fn nose<T: Real>(p: [T; 3], s: [T; 3]) -> T {
    let bridge = capsule(s, [1.8, -83.9, 82.0], [1.5, -98.7, 44.0], 6.2, 8.8);
    let root = capsule(p, [0.0, -78.0, 80.0], [0.0, -88.0, 42.0], 7.5, 10.5);
    let tip = ellipsoid(p, [0.0, -102.0, 40.0], [10.0, 10.0, 9.0]);
    let wing = ellipsoid(s, [10.5, -94.0, 35.0], [7.0, 9.5, 7.5]);
    union(union(union(bridge, root, 4.0), tip, 8.0), wing, 7.0)
}

fn mouth<T: Real>(head: T, p: [T; 3]) -> T {
    let upper = ellipsoid(p, [0.0, -85.5, 8.0], [26.0, 13.0, 7.0]);
    let lower = ellipsoid(p, [0.0, -84.0, -5.0], [23.0, 13.0, 7.5]);
    let lips = union(upper, lower, 1.5);
    union(head, lips, 8.0)
}
