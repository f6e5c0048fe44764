//! Choice of vertex frames and rest tangents, and their correction at sharp creases.

use super::c1_prism::{quadrature, rest_of};
use super::c1_surface::C1Surface;
use super::quadrature::TriangleRule;
use crate::fem::tuning::{LEAST_COSINE, LEAST_JACOBIAN, SHORTER_TANGENT, TANGENT_ROUNDS};
use crate::mesh::MixedMesh;
use nalgebra::Matrix3;
use prosopon_geometry::Vector;

impl C1Surface {
    /// Surface with frames from the angle-weighted normals of the outer triangles (Wang 2009, eq. 0.3).
    ///
    /// The rest tangents are the tangents of the frames, except at the nodes that [`C1Surface::warnings`] reports.
    #[must_use]
    pub fn new(mesh: &MixedMesh) -> Self {
        Self::with_rule(mesh, TriangleRule::DEFAULT)
    }

    /// As [`C1Surface::new`], with another quadrature rule.
    #[must_use]
    pub fn with_rule(mesh: &MixedMesh, rule: TriangleRule) -> Self {
        choose(mesh, rule)
    }
}

fn choose(mesh: &MixedMesh, rule: TriangleRule) -> C1Surface {
    let mut outer_nodes: Vec<u32> = mesh.prisms.iter().flat_map(|p| [p[0], p[1], p[2]]).collect();
    outer_nodes.sort_unstable();
    outer_nodes.dedup();
    let (normals, tilted) = normals(mesh, &outer_nodes);
    let frames: Vec<[Vector; 3]> = normals.into_iter().map(frame).collect();
    let mut surface = C1Surface {
        outer_nodes,
        frames,
        rest_tangents: Vec::new(),
        rule,
        tilted,
        flattened: Vec::new(),
        plain: Vec::new(),
    };
    // Prisms that stay inverted must not flatten the surface around them.
    loop {
        let lost = flatten(mesh, &mut surface);
        if lost.is_empty() {
            return surface;
        }
        surface.plain.extend(lost);
        surface.plain.sort_unstable();
    }
}

/// Angle-weighted normals of the outer triangles at the outer nodes, and the nodes with a tilted normal.
fn normals(mesh: &MixedMesh, outer_nodes: &[u32]) -> (Vec<Vector>, Vec<u32>) {
    let mut faces: Vec<Vec<Vector>> = vec![Vec::new(); outer_nodes.len()];
    let mut normals = vec![Vector::zeros(); outer_nodes.len()];
    for prism in &mesh.prisms {
        let x = [prism[0], prism[1], prism[2]].map(|n| mesh.positions[n as usize]);
        let Some(face) = (x[1] - x[0]).cross(&(x[2] - x[0])).try_normalize(0.0) else { continue };
        for i in 0..3 {
            let place = outer_nodes.partition_point(|&n| n < prism[i]);
            normals[place] += face * (x[(i + 1) % 3] - x[i]).angle(&(x[(i + 2) % 3] - x[i]));
            faces[place].push(face);
        }
    }
    let mut tilted = Vec::new();
    for ((normal, faces), node) in normals.iter_mut().zip(&faces).zip(outer_nodes) {
        let usual = normal.try_normalize(1e-12);
        let seen = |n: &Vector| faces.iter().map(|f| f.dot(n)).fold(f64::INFINITY, f64::min);
        *normal = usual.unwrap_or_else(Vector::z);
        if usual.is_none_or(|n| seen(&n) < LEAST_COSINE) {
            let better = most_normal(faces);
            if seen(&better) > seen(normal) {
                *normal = better;
                tilted.push(*node);
            }
        }
    }
    (normals, tilted)
}

/// Approximate direction with the least largest angle to the given unit vectors: the centre of their smallest enclosing ball by
/// the iteration of Bădoiu and Clarkson ("most normal normal", Aubry and Löhner, Int J Numer Methods Eng 2008).
fn most_normal(faces: &[Vector]) -> Vector {
    let Some(first) = faces.first() else { return Vector::z() };
    let mut centre = *first;
    for step in 1..200 {
        let farthest =
            faces.iter().fold(*first, |worst, f| if f.dot(&centre) < worst.dot(&centre) { *f } else { worst });
        centre += (farthest - centre) / f64::from(step + 1);
    }
    centre.try_normalize(1e-12).unwrap_or(*first)
}

/// A right-handed frame (normal, tangent, tangent) from a unit normal; the first tangent is the projection of the coordinate axis
/// farthest from it.
fn frame(normal: Vector) -> [Vector; 3] {
    let axis = normal.iamin();
    let mut tangent = -normal * normal[axis];
    tangent[axis] += 1.0;
    let tangent = tangent.normalize();
    [normal, tangent, normal.cross(&tangent)]
}

/// Shortens the rest tangents at the corners of prisms that are inverted or nearly so. With shorter tangents the surface
/// approaches the flat triangles, and it stays continuous because the tangents are shared. Returns the prisms that remain
/// inverted.
fn flatten(mesh: &MixedMesh, surface: &mut C1Surface) -> Vec<u32> {
    let points = surface.rule.points();
    surface.rest_tangents = surface.frames.iter().map(|&[_, t1, t2]| [t1, t2]).collect();
    let mut share = vec![1.0; surface.outer_nodes.len()];
    let curved: Vec<usize> = (0..mesh.prisms.len()).filter(|&p| !surface.is_plain(p)).collect();
    let mut suspects = curved.clone();
    for round in 0..=TANGENT_ROUNDS {
        let mut shorten = vec![false; share.len()];
        suspects.retain(|&prism| {
            let patch = surface.patch(mesh, prism);
            let rest = rest_of(mesh, prism, &patch, &surface.rest_tangents);
            let least = quadrature(&patch, &points)
                .map(|(derivatives, _)| {
                    rest.iter().zip(&derivatives).map(|(x, d)| x * d.transpose()).sum::<Matrix3<f64>>().determinant()
                })
                .fold(f64::INFINITY, f64::min);
            let corners = mesh.prisms[prism].map(|n| mesh.positions[n as usize]);
            let flat = (corners[1] - corners[0])
                .cross(&(corners[2] - corners[0]))
                .dot(&(0..3).map(|i| corners[i] - corners[3 + i]).sum::<Vector>())
                / 3.0;
            // A NaN determinant is bad too.
            let bad = least.is_nan() || flat.is_nan() || least <= LEAST_JACOBIAN * flat;
            if bad {
                patch.corners.iter().for_each(|&c| shorten[c] = true);
            }
            bad
        });
        if suspects.is_empty() || round == TANGENT_ROUNDS {
            break;
        }
        for place in (0..share.len()).filter(|&p| shorten[p]) {
            share[place] *= SHORTER_TANGENT;
            let [_, t1, t2] = surface.frames[place];
            surface.rest_tangents[place] = [t1 * share[place], t2 * share[place]];
        }
        // Prisms that share a changed corner must be checked again.
        suspects = curved.iter().copied().filter(|&p| has_changed_corner(mesh, surface, p, &shorten)).collect();
    }
    surface.flattened = surface.outer_nodes.iter().copied().zip(share).filter(|&(_, s)| s < 1.0).collect();
    suspects.into_iter().map(|p| p as u32).collect()
}

fn has_changed_corner(mesh: &MixedMesh, surface: &C1Surface, prism: usize, changed: &[bool]) -> bool {
    mesh.prisms[prism][..3].iter().any(|&n| changed[surface.outer_nodes.partition_point(|&o| o < n)])
}

#[cfg(test)]
mod tests {
    use super::super::sample_meshes::height_field;
    use super::super::{c1_prisms, plain_prisms};
    use super::*;

    #[test]
    fn gentle_skin_is_left_alone_and_sharp_creases_are_mended() {
        // Thickness is measured along z: a slope of 4 makes it a quarter of that.
        for (thickness, slope, tilted, flattened) in
            [(1.5, 2.0, false, false), (1.5, -4.0, true, false), (1.5, 4.0, true, true), (0.3, 1.0, false, true)]
        {
            let mesh = height_field(6, thickness, |x, _| slope * (x - 12.0).abs());
            let surface = C1Surface::new(&mesh);
            assert_eq!(surface.tilted.is_empty(), !tilted, "{slope}");
            assert_eq!(surface.flattened.is_empty(), !flattened, "{slope}");
            assert_eq!(surface.warnings().len(), usize::from(tilted) + usize::from(flattened));
            let block = c1_prisms(&mesh, &surface).unwrap();
            assert!(block.weights.iter().all(|w| *w > 0.0));
        }
    }

    #[test]
    fn a_pit_deeper_than_the_skin_is_thick_is_mended_or_its_prisms_stay_plain() {
        let pit = |slope: f64, thickness| {
            height_field(6, thickness, move |x, y| slope * ((x - 12.0).abs() + (y - 12.0).abs()).max(3.0))
        };
        let mesh = pit(4.0, 1.5);
        let surface = C1Surface::new(&mesh);
        assert!(c1_prisms(&mesh, &surface).is_ok() && !surface.warnings().is_empty());
        let mesh = pit(4.0, 0.1);
        let surface = C1Surface::new(&mesh);
        assert!(!surface.plain.is_empty() && surface.plain.len() < mesh.prisms.len());
        let (curved, plain) = (c1_prisms(&mesh, &surface).unwrap(), plain_prisms(&mesh, &surface).unwrap());
        assert_eq!(curved.n_elements() + plain.n_elements(), mesh.prisms.len());
        // Both kinds reproduce a linear field of the generalised nodes exactly.
        let m = Matrix3::new(1.2, 0.3, -0.1, 0.2, 0.9, 0.4, 0.0, -0.3, 1.1);
        let values: Vec<Vector> = surface.rest_values(&mesh).iter().map(|v| m * v).collect();
        for block in [curved, plain] {
            for (e, nodes) in block.nodes.chunks_exact(block.n_functions).enumerate() {
                let gradients = block.gradients.chunks_exact(block.n_functions).skip(e * block.n_points);
                for g in gradients.take(block.n_points) {
                    let f: Matrix3<f64> = nodes.iter().zip(g).map(|(n, g)| values[*n as usize] * g.transpose()).sum();
                    assert!((f - m).norm() < 1e-9, "{} {e}", block.kind);
                }
            }
        }
    }

    /// A node whose angle-weighted normal sees a triangle from behind gets a normal that sees all of them.
    #[test]
    fn the_most_normal_normal_sees_all_triangles_alike() {
        let faces = [Vector::new(1.0, 0.0, 0.2), Vector::new(-1.0, 0.0, 0.2), Vector::new(1.0, 0.1, 0.2)]
            .map(|f| f.normalize());
        let normal = most_normal(&faces);
        // The pair with the largest angle decides: the normal is halfway between.
        let farther = if faces[0].dot(&faces[1]) < faces[2].dot(&faces[1]) { faces[0] } else { faces[2] };
        assert!(normal.angle(&(faces[1] + farther)) < 0.03, "{normal}");
        assert_eq!(most_normal(&[]), Vector::z());
    }

    #[test]
    fn frames_are_right_handed_and_the_same_for_the_same_normal() {
        for normal in [Vector::x(), -Vector::z(), Vector::new(0.3, -0.5, 0.8).normalize()] {
            let [n, t1, t2] = frame(normal);
            assert_eq!(n, normal);
            let m = Matrix3::from_columns(&[t1, t2, n]);
            assert!((m.tr_mul(&m) - Matrix3::identity()).norm() < 1e-14 && m.determinant() > 0.0);
        }
    }
}
