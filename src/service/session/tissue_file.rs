use prosopon_formats::export::vtu;
use prosopon_geometry::{Point, Vector};
use prosopon_planning::simulate::Outcome;
use prosopon_tissue::mesh::MixedMesh;

/// The mesh at rest with the outcome of a solve as a VTU file; `None` when the numbers of nodes differ.
///
/// Point arrays: `displacement_mm`, and `attachment` in the solve (-1 free, 0 skull, fixed or left out, k segment k, -2 sliding,
/// -3 - k gliding on segment k). Cell arrays: `tissue` (0 skin, 1 muscle, 2 fat, 3 mucosa, 4 cartilage) and `volume_ratio`.
pub(super) fn tissue_file(mesh: &MixedMesh, outcome: &Outcome) -> Option<Vec<u8>> {
    let (rest, nodes) = (&mesh.positions, &outcome.nodes);
    if [nodes.len(), outcome.attachment.len()] != [rest.len(); 2] {
        return None;
    }
    let displacement: Vec<f64> = nodes.iter().zip(rest).flat_map(|(x, r)| <[f64; 3]>::from(x - r)).collect();
    let attachment: Vec<f64> = outcome.attachment.iter().map(|a| a.number()).collect();
    let of_tetrahedra = mesh.tetrahedron_tissue.iter().copied();
    let of_prisms = (0..mesh.prisms.len()).map(|prism| mesh.tissue_of_prism(prism));
    let tissue: Vec<f64> = of_tetrahedra.chain(of_prisms).map(|t| f64::from(t as u8)).collect();
    let tetrahedra = mesh.tetrahedra.iter().map(|t| ratio(nodes, rest, &[*t]));
    let prisms = mesh.prisms.iter().map(|p| ratio(nodes, rest, &split(p)));
    let volume_ratio: Vec<f64> = tetrahedra.chain(prisms).collect();
    let points: [(&str, usize, &[f64]); 2] = [("displacement_mm", 3, &displacement), ("attachment", 1, &attachment)];
    let cells: [(&str, usize, &[f64]); 2] = [("tissue", 1, &tissue), ("volume_ratio", 1, &volume_ratio)];
    Some(vtu(rest, &mesh.tetrahedra, &mesh.prisms, &points, &cells))
}

/// Splits a prism into three tetrahedra of the same orientation, for its volume.
fn split(&[a, b, c, d, e, f]: &[u32; 6]) -> [[u32; 4]; 3] {
    [[a, b, c, f], [a, b, f, e], [a, e, f, d]]
}

/// Current volume of tetrahedra over their volume at rest.
fn ratio(now: &[Point], rest: &[Point], tetrahedra: &[[u32; 4]]) -> f64 {
    let volume = |x: &[Point]| -> f64 {
        let of = |t: &[u32; 4]| {
            let [a, b, c, d] = t.map(|node| x[node as usize]);
            let edges: [Vector; 3] = [b - a, c - a, d - a];
            edges[0].cross(&edges[1]).dot(&edges[2])
        };
        tetrahedra.iter().map(of).sum()
    };
    volume(now) / volume(rest)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stretched_prism_has_its_volume_ratio() {
        let rest: Vec<Point> = [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.], [0., 0., -1.], [1., 0., -1.], [0., 1., -1.]]
            .map(Point::from)
            .to_vec();
        let now: Vec<Point> = rest.iter().map(|p| Point::new(2.0 * p.x, p.y, 1.5 * p.z)).collect();
        let prism = [[0, 1, 2, 3, 4, 5]];
        assert!((ratio(&now, &rest, &split(&prism[0])) - 3.0).abs() < 1e-14);
        let parts = split(&prism[0]).map(|t| ratio(&now, &rest, &[t]));
        assert!(parts.iter().all(|r| (r - 3.0).abs() < 1e-14));
    }
}
