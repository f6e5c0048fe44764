//! Two blocks whose skins face each other: lips.

use crate::slab::Slab;
use prosopon_geometry::Point;
use prosopon_tissue::mesh::{Attachment, Facing, MixedMesh};

/// Edge length of the upper block's cells relative to the lower block's: the meshes are unlike.
const NARROWER: f64 = 0.7;
/// Depth by which the skins curve away from each other at the rim of the upper block, as a share of the height.
const ROUNDED: f64 = 0.1;

/// The block `lower`, fixed at its bottom, and a narrower mirror image on it whose far face is tied to segment 1. They touch in the
/// middle and curve away from each other.
pub(super) fn lips(lower: &Slab) -> MixedMesh {
    let mut mesh = lower.mesh();
    let top = lower.size_mm[2] + lower.skin_mm;
    let rim_sq = (0.5 * NARROWER * lower.size_mm[0]).powi(2);
    let below = mesh.positions.clone();
    let away = |x: f64, y: f64, z: f64| ROUNDED * z * ((x * x + y * y) / rim_sq).min(2.0);
    let lowered = |p: &Point| Point::new(p.x, p.y, p.z - away(p.x, p.y, p.z));
    let mirrored = |p: &Point| {
        let (x, y) = (NARROWER * p.x, NARROWER * p.y);
        Point::new(x, y, 2.0 * top - p.z + away(x, y, p.z))
    };
    mesh.positions = below.iter().map(lowered).chain(below.iter().map(mirrored)).collect();
    let n = below.len() as u32;
    let (tetrahedra, prisms) = (mesh.tetrahedra.clone(), mesh.prisms.clone());
    mesh.tetrahedra.extend(tetrahedra.iter().map(|[a, b, c, d]| [*a, *c, *b, *d].map(|node| node + n)));
    mesh.tetrahedron_tissue.extend(mesh.tetrahedron_tissue.clone());
    mesh.prisms.extend(prisms.iter().map(|[a, b, c, d, e, f]| [*a, *c, *b, *d, *f, *e].map(|node| node + n)));
    let skin = |prisms: &[[u32; 6]]| prisms.iter().map(|[a, b, c, ..]| [*a, *b, *c]).collect();
    let (lower_skin, upper_skin) = mesh.prisms.split_at(prisms.len());
    mesh.facing = vec![Facing { sides: [skin(lower_skin), skin(upper_skin)] }];
    mesh.bone_faces.clear();
    let attachment = |(i, p): (usize, &Point)| match p.z {
        0.0 if i < below.len() => Attachment::Fixed,
        z if z >= 2.0 * top - 1e-9 => Attachment::Tied(1),
        _ => Attachment::Free,
    };
    mesh.attachment = mesh.positions.iter().enumerate().map(attachment).collect();
    mesh
}
