use super::block::{ElementBlock, ElementError, MeshCell};
use crate::mesh::{MixedMesh, Tissue};
use prosopon_geometry::Vector;

/// Linear tetrahedra with one quadrature point (Wang 2009, eq. 0.14).
///
/// # Errors
/// [`ElementError::InvertedAtRest`].
pub fn tetrahedra(mesh: &MixedMesh) -> Result<ElementBlock, ElementError> {
    let mut block = ElementBlock::empty("tetrahedron", 4, 1, mesh.tetrahedra.len());
    for (element, (corners, tissue)) in mesh.tetrahedra.iter().zip(&mesh.tetrahedron_tissue).enumerate() {
        push_tetrahedron(&mut block, mesh, element, corners, *tissue)?;
        block.cells.push(MeshCell::Tetrahedron(element as u32));
    }
    Ok(block)
}

/// Prisms as linear wedges with two quadrature points.
///
/// Functions: Wang 2009, eq. 0.15 with the third entry corrected. The points lie at the triangle's centroid, at the two Gauss
/// points through the thickness.
///
/// # Errors
/// [`ElementError::InvertedAtRest`].
pub fn wedges(mesh: &MixedMesh) -> Result<ElementBlock, ElementError> {
    wedges_of(mesh, 0..mesh.prisms.len())
}

/// The listed prisms as linear wedges.
pub(super) fn wedges_of(
    mesh: &MixedMesh,
    prisms: impl ExactSizeIterator<Item = usize>,
) -> Result<ElementBlock, ElementError> {
    let mut block = ElementBlock::empty("wedge", 6, 2, prisms.len());
    for element in prisms {
        let corners = &mesh.prisms[element];
        block.nodes.extend(corners);
        block.tissue.push(mesh.tissue_of_prism(element));
        block.cells.push(MeshCell::Prism(element as u32));
        let origin = mesh.positions[corners[0] as usize];
        let rest = corners.map(|n| mesh.positions[n as usize] - origin);
        for q in [0.5 - 0.5 / 3.0_f64.sqrt(), 0.5 + 0.5 / 3.0_f64.sqrt()] {
            block.push_point(element, 0.25, &rest, &wedge_derivatives([1.0 / 3.0; 3], q))?;
        }
    }
    Ok(block)
}

/// Derivatives by (L2, L3, -q) of the barycentric coordinates, at fixed L1 + L2 + L3 = 1. The sign of the depth `q` makes the
/// coordinates right-handed.
pub(super) const BARYCENTRIC: [[f64; 2]; 3] = [[-1.0, -1.0], [1.0, 0.0], [0.0, 1.0]];

/// Derivatives by (L2, L3, -q) of the six functions L_i (1 - q), L_i q.
fn wedge_derivatives(l: [f64; 3], q: f64) -> [Vector; 6] {
    std::array::from_fn(|a| {
        let [d2, d3] = BARYCENTRIC[a % 3];
        let (share, by_depth) = if a < 3 { (1.0 - q, l[a]) } else { (q, -l[a - 3]) };
        Vector::new(d2 * share, d3 * share, by_depth)
    })
}

pub(super) fn push_tetrahedron(
    block: &mut ElementBlock,
    mesh: &MixedMesh,
    element: usize,
    corners: &[u32; 4],
    tissue: Tissue,
) -> Result<(), ElementError> {
    const DERIVATIVES: [Vector; 4] = [
        Vector::new(-1.0, -1.0, -1.0),
        Vector::new(1.0, 0.0, 0.0),
        Vector::new(0.0, 1.0, 0.0),
        Vector::new(0.0, 0.0, 1.0),
    ];
    block.nodes.extend(corners);
    block.tissue.push(tissue);
    // Relative to a corner, so that large coordinates do not cancel.
    let origin = mesh.positions[corners[0] as usize];
    let rest = corners.map(|n| mesh.positions[n as usize] - origin);
    block.push_point(element, 1.0 / 6.0, &rest, &DERIVATIVES)
}

#[cfg(test)]
mod tests {
    use super::super::sample_meshes::prism;
    use super::*;

    #[test]
    fn weights_add_up_to_the_volume_and_gradients_reproduce_a_linear_field() {
        let mut mesh = prism(2.0, 3.0, 1.5, [0, 1, 2, 3, 4, 5]);
        mesh.tetrahedra = vec![[3, 4, 5, 1], [3, 5, 0, 1]];
        mesh.tetrahedron_tissue = vec![Tissue::Fat, Tissue::Muscle];
        // Far from the origin, as in patient coordinates.
        let a = nalgebra::Matrix3::new(1.2, 0.3, -0.1, 0.2, 0.9, 0.4, 0.0, -0.3, 1.1);
        for p in &mut mesh.positions {
            *p += Vector::new(120.0, -230.0, 700.0);
        }
        let tetrahedra = tetrahedra(&mesh).unwrap();
        assert_eq!(tetrahedra.tissue, [Tissue::Fat, Tissue::Muscle]);
        assert!((tetrahedra.weights[0] - 1.5).abs() < 1e-12 && (tetrahedra.weights[1] - 1.5).abs() < 1e-12);
        let wedges = wedges(&mesh).unwrap();
        assert!((wedges.weights.iter().sum::<f64>() - 4.5).abs() < 1e-12);
        for block in [tetrahedra, wedges] {
            let (n, q) = (block.n_functions, block.n_points);
            for e in 0..block.n_elements() {
                for point in 0..q {
                    let f: nalgebra::Matrix3<f64> = (0..n)
                        .map(|i| {
                            let x = mesh.positions[block.nodes[e * n + i] as usize].coords;
                            (a * x) * block.gradients[(e * q + point) * n + i].transpose()
                        })
                        .sum();
                    assert!((f - a).norm() < 1e-12, "{f}");
                }
            }
        }
    }

    #[test]
    fn elements_inside_out_are_refused_with_their_index() {
        let mut mesh = prism(2.0, 3.0, 1.5, [3, 4, 5, 0, 1, 2]);
        mesh.prisms.push([0, 1, 2, 3, 4, 5]);
        mesh.tetrahedra = vec![[0, 1, 2, 3], [0, 2, 1, 3]];
        mesh.tetrahedron_tissue = vec![Tissue::Fat; 2];
        assert!(matches!(wedges(&mesh), Err(ElementError::InvertedAtRest { kind: "wedge", element: 1, .. })));
        let error = tetrahedra(&mesh).unwrap_err();
        assert!(matches!(error, ElementError::InvertedAtRest { kind: "tetrahedron", element: 1, .. }), "{error}");
    }
}
