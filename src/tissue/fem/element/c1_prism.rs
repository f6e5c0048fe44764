use super::block::{ElementBlock, ElementError, MeshCell};
use super::c1_surface::{C1Surface, Patch};
use super::linear::{self, BARYCENTRIC};
use super::quadrature::{THROUGH_THICKNESS, THROUGH_THICKNESS_WEIGHT, TrianglePoint};
use crate::mesh::MixedMesh;
use prosopon_geometry::Vector;

/// Prisms with a C1 outer surface (Wang 2009, eq. 0.17 and Appendix A; `src/paper.md`, 12 to 15).
///
/// Functions 0 to 8 belong to the outer triangle, 9 to 11 to the inner corners.
///
/// The element is isoparametric: the rest surface is interpolated by the same functions, so linear fields and rigid rotations are
/// exact at every point. Prisms listed in [`C1Surface::plain`] are left to [`plain_prisms`].
///
/// # Errors
/// [`ElementError::InvertedAtRest`].
pub fn c1_prisms(mesh: &MixedMesh, surface: &C1Surface) -> Result<ElementBlock, ElementError> {
    let points = surface.rule.points();
    let mut block = ElementBlock::empty("prism", 12, 2 * points.len(), mesh.prisms.len());
    for prism in (0..mesh.prisms.len()).filter(|&p| !surface.is_plain(p)) {
        let patch = surface.patch(mesh, prism);
        block.nodes.extend(surface.outer_nodes_of(mesh, prism));
        block.nodes.extend(&mesh.prisms[prism][3..]);
        block.tissue.push(mesh.tissue_of_prism(prism));
        block.cells.push(MeshCell::Prism(prism as u32));
        let rest = rest_of(mesh, prism, &patch, &surface.rest_tangents);
        for (derivatives, weight) in quadrature(&patch, &points) {
            block.push_point(prism, weight, &rest, &derivatives)?;
        }
    }
    Ok(block)
}

/// The prisms in [`C1Surface::plain`], which cannot be C1 prisms, as linear wedges.
///
/// # Errors
/// [`ElementError::InvertedAtRest`].
pub fn plain_prisms(mesh: &MixedMesh, surface: &C1Surface) -> Result<ElementBlock, ElementError> {
    linear::wedges_of(mesh, surface.plain.iter().map(|&p| p as usize))
}

/// Rest values of a prism's twelve generalised nodes; positions are relative to its first corner, so that large coordinates do
/// not cancel.
pub(super) fn rest_of(mesh: &MixedMesh, prism: usize, patch: &Patch, tangents: &[[Vector; 2]]) -> [Vector; 12] {
    let corners = mesh.prisms[prism].map(|n| mesh.positions[n as usize]);
    let mut rest = [Vector::zeros(); 12];
    for i in 0..3 {
        let [t1, t2] = tangents[patch.corners[i]];
        rest[3 * i] = corners[i] - corners[0];
        rest[3 * i + 1] = t1;
        rest[3 * i + 2] = t2;
        rest[9 + i] = corners[3 + i] - corners[0];
    }
    rest
}

/// Derivatives of the twelve functions N12 = [N9* (1 - q), L_i q] by (L2, L3, -q), and the weight, at every quadrature point.
pub(super) fn quadrature(patch: &Patch, points: &[TrianglePoint]) -> impl Iterator<Item = ([Vector; 12], f64)> {
    points.iter().flat_map(move |&(l, weight)| {
        let (values, slopes) = (patch.values(l), patch.derivatives(l));
        THROUGH_THICKNESS.map(|q| {
            let derivatives = std::array::from_fn(|a| {
                if a < 9 {
                    Vector::new(slopes[a][0] * (1.0 - q), slopes[a][1] * (1.0 - q), values[a])
                } else {
                    let [d2, d3] = BARYCENTRIC[a - 9];
                    Vector::new(d2 * q, d3 * q, -l[a - 9])
                }
            });
            (derivatives, weight * THROUGH_THICKNESS_WEIGHT)
        })
    })
}
