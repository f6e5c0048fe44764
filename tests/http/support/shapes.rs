//! Surfaces to upload.

use std::fmt::Write;

use prosopon_geometry::{Point, TriMesh};

/// A closed box around `centre`, half side `half`, in mm.
pub(crate) fn cube(centre: [f64; 3], half: f64) -> TriMesh {
    let corner = |v: u32| {
        let side = |bit: u32| if v >> bit & 1 == 1 { half } else { -half };
        Point::new(centre[0] + side(0), centre[1] + side(1), centre[2] + side(2))
    };
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let triangles = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    TriMesh::new((0..8).map(corner).collect(), triangles).unwrap()
}

/// Binary STL.
pub(crate) fn stl(mesh: &TriMesh) -> Vec<u8> {
    let mut bytes = vec![0; 80];
    bytes.extend_from_slice(&(mesh.triangles().len() as u32).to_le_bytes());
    for t in 0..mesh.triangles().len() {
        bytes.extend_from_slice(&[0; 12]);
        for corner in mesh.corners(t) {
            corner.iter().for_each(|c| bytes.extend_from_slice(&(*c as f32).to_le_bytes()));
        }
        bytes.extend_from_slice(&[0; 2]);
    }
    bytes
}

/// Text PLY; `first` replaces the first coordinate.
pub(crate) fn ply_with(mesh: &TriMesh, first: &str) -> Vec<u8> {
    let mut text = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
         element face {}\nproperty list uchar int vertex_indices\nend_header\n",
        mesh.positions().len(),
        mesh.triangles().len()
    );
    for (index, p) in mesh.positions().iter().enumerate() {
        let x = if index == 0 { first.to_owned() } else { p.x.to_string() };
        writeln!(text, "{x} {} {}", p.y, p.z).unwrap();
    }
    for [a, b, c] in mesh.triangles() {
        writeln!(text, "3 {a} {b} {c}").unwrap();
    }
    text.into_bytes()
}

pub(crate) fn skin() -> Vec<u8> {
    stl(&cube([0.0; 3], 100.0))
}

pub(crate) fn skull() -> Vec<u8> {
    stl(&cube([0.0; 3], 60.0))
}

/// A NIfTI-1 file of 4 × 4 × 4 voxels.
pub(crate) fn nifti() -> Vec<u8> {
    let mut bytes = vec![0u8; 352];
    let mut put = |at: usize, value: &[u8]| bytes[at..at + value.len()].copy_from_slice(value);
    put(0, &348i32.to_le_bytes());
    for (index, n) in [3i16, 4, 4, 4, 1, 1, 1, 1].into_iter().enumerate() {
        put(40 + 2 * index, &n.to_le_bytes());
    }
    put(70, &4i16.to_le_bytes());
    put(72, &16i16.to_le_bytes());
    for index in 0..8 {
        put(76 + 4 * index, &1f32.to_le_bytes());
    }
    put(108, &352f32.to_le_bytes());
    put(112, &1f32.to_le_bytes());
    // The unit of length: mm.
    put(123, &[2]);
    put(254, &1i16.to_le_bytes());
    for (row, at) in [280usize, 296, 312].into_iter().enumerate() {
        put(at + 4 * row, &1f32.to_le_bytes());
    }
    put(344, b"n+1\0");
    bytes.extend((0..64i16).flat_map(|v| (v * 12 - 300).to_le_bytes()));
    bytes
}

/// A closed body without symmetry, about 160 mm wide, with `n` rings; `grow` adds to the radius (mm) depending on the
/// direction.
pub(crate) fn lumpy(n: usize, grow: impl Fn([f64; 3]) -> f64) -> TriMesh {
    let m = 2 * n;
    let at = |polar: f64, around: f64| {
        let d = [polar.sin() * around.cos(), polar.sin() * around.sin(), polar.cos()];
        let lumps =
            12.0 * d[0] * d[1] + 9.0 * d[2] * d[2] * d[0] - 15.0 * d[1].powi(3) + 6.0 * (5.0 * d[0]).sin() * d[2];
        let r = 80.0 + lumps + grow(d);
        Point::new(r * d[0], r * d[1], r * d[2])
    };
    let angle = |i: usize, of: usize| std::f64::consts::PI * i as f64 / of as f64;
    let mut p = vec![at(0.0, 0.0)];
    p.extend((1..n).flat_map(|r| (0..m).map(move |i| (r, i))).map(|(r, i)| at(angle(r, n), angle(2 * i, m))));
    p.push(at(std::f64::consts::PI, 0.0));
    let last = p.len() as u32 - 1;
    let id = |r: usize, i: usize| (1 + (r - 1) * m + i % m) as u32;
    let mut t = Vec::new();
    for i in 0..m {
        t.push([0, id(1, i), id(1, i + 1)]);
        t.push([last, id(n - 1, i + 1), id(n - 1, i)]);
        for r in 1..n - 1 {
            t.push([id(r, i), id(r + 1, i), id(r + 1, i + 1)]);
            t.push([id(r, i), id(r + 1, i + 1), id(r, i + 1)]);
        }
    }
    TriMesh::new(p, t).unwrap()
}
