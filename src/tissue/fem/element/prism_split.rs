use std::cmp::Ordering;

use super::block::{ElementBlock, ElementError, MeshCell};
use super::linear::{push_tetrahedron, wedges_of};
use crate::mesh::MixedMesh;

/// Number of passes that change the order of the nodes to reduce inverted tetrahedra.
const PASSES: usize = 4;

/// Prisms split into three linear tetrahedra each, consistently across prisms; and as wedges those that are too twisted for it.
///
/// Every side face is cut from its corner that comes first in an order of all nodes, which is always possible (Dompierre et al.,
/// 8th International Meshing Roundtable 1999). The order is that of the rest positions by x, then y, then z, so it does not
/// depend on the numbering. Nodes of twisted prisms are moved to the front of the order where that leaves fewer inverted
/// tetrahedra. A prism with an inverted tetrahedron in every order becomes a wedge, which shares its nodes with the tetrahedra
/// around it and differs from them within its side faces only.
///
/// # Errors
/// [`ElementError::InvertedAtRest`] for a prism whose wedge is inverted too.
pub fn prisms_as_tetrahedra(mesh: &MixedMesh) -> Result<[ElementBlock; 2], ElementError> {
    let rank = order(mesh);
    let twisted: Vec<usize> = (0..mesh.prisms.len()).filter(|&p| inverted(mesh, p, &rank) > 0).collect();
    let mut block = ElementBlock::empty("tetrahedron", 4, 1, 3 * mesh.prisms.len());
    for (prism, corners) in mesh.prisms.iter().enumerate() {
        if twisted.binary_search(&prism).is_ok() {
            continue;
        }
        for corners in split(corners, &rank) {
            block.cells.push(MeshCell::Prism(prism as u32));
            push_tetrahedron(&mut block, mesh, prism, &corners, mesh.tissue_of_prism(prism)).map_err(
                |ElementError::InvertedAtRest { element, det, .. }| ElementError::InvertedAtRest {
                    kind: "tetrahedron of prism",
                    element,
                    det,
                },
            )?;
        }
    }
    Ok([block, wedges_of(mesh, twisted.into_iter())?])
}

/// Rank of each node; the smallest is first in the order.
fn order(mesh: &MixedMesh) -> Vec<i64> {
    let x = &mesh.positions;
    let mut sorted: Vec<usize> = (0..x.len()).collect();
    let by_axis = |a: usize, b: usize, axis: usize| x[a][axis].total_cmp(&x[b][axis]);
    sorted.sort_by(|&a, &b| (0..3).map(|axis| by_axis(a, b, axis)).fold(Ordering::Equal, Ordering::then));
    let mut rank = vec![0i64; x.len()];
    for (place, node) in (0..).zip(sorted) {
        rank[node] = place;
    }
    let mut first = 0;
    for _ in 0..PASSES {
        let twisted: Vec<usize> = (0..mesh.prisms.len()).filter(|&p| inverted(mesh, p, &rank) > 0).collect();
        if twisted.is_empty() {
            break;
        }
        for prism in twisted {
            for node in mesh.prisms[prism] {
                if inverted(mesh, prism, &rank) == 0 {
                    break;
                }
                let around: Vec<usize> = (0..mesh.prisms.len()).filter(|&p| mesh.prisms[p].contains(&node)).collect();
                let count = |rank: &[i64]| -> usize { around.iter().map(|&p| inverted(mesh, p, rank)).sum() };
                let (before, old) = (count(&rank), rank[node as usize]);
                rank[node as usize] = first - 1;
                if count(&rank) < before {
                    first -= 1;
                } else {
                    rank[node as usize] = old;
                }
            }
        }
    }
    rank
}

/// Number of inverted tetrahedra of a prism split in this order.
fn inverted(mesh: &MixedMesh, prism: usize, rank: &[i64]) -> usize {
    let volume = |t: &[u32; 4]| {
        let x = t.map(|n| mesh.positions[n as usize]);
        (x[1] - x[0]).cross(&(x[2] - x[0])).dot(&(x[3] - x[0]))
    };
    split(&mesh.prisms[prism], rank).iter().filter(|t| volume(t) <= 0.0).count()
}

/// The three tetrahedra of a prism.
fn split(corners: &[u32; 6], rank: &[i64]) -> [[u32; 4]; 3] {
    // Rotations of the prism that bring each corner to the front and keep its handedness.
    const TURNS: [[usize; 6]; 6] = [
        [0, 1, 2, 3, 4, 5],
        [1, 2, 0, 4, 5, 3],
        [2, 0, 1, 5, 3, 4],
        [3, 5, 4, 0, 2, 1],
        [4, 3, 5, 1, 0, 2],
        [5, 4, 3, 2, 1, 0],
    ];
    let place = |n: u32| rank[n as usize];
    let first = (0..6).min_by_key(|&i| place(corners[i])).unwrap_or(0);
    let v = TURNS[first].map(|i| corners[i]);
    // The two faces at the first corner are cut from it; the third has two possibilities.
    if place(v[1]).min(place(v[5])) < place(v[2]).min(place(v[4])) {
        [[v[0], v[2], v[1], v[5]], [v[0], v[1], v[4], v[5]], [v[0], v[4], v[3], v[5]]]
    } else {
        [[v[0], v[2], v[1], v[4]], [v[0], v[2], v[4], v[5]], [v[0], v[4], v[3], v[5]]]
    }
}

#[cfg(test)]
mod tests {
    use super::super::sample_meshes::prism;
    use super::*;

    fn permutations() -> Vec<[u32; 6]> {
        let mut all = vec![];
        for code in 0..720_usize {
            let (mut rest, mut code) = (vec![0_u32, 1, 2, 3, 4, 5], code);
            let mut order = [0; 6];
            for (place, slot) in order.iter_mut().enumerate() {
                *slot = rest.remove(code % (6 - place));
                code /= 6 - place;
            }
            all.push(order);
        }
        all
    }

    #[test]
    fn every_order_of_a_prism_splits_it_into_three_positive_tetrahedra_cut_from_the_smallest_corners() {
        for order in permutations() {
            let mesh = prism(2.0, 3.0, 1.5, order);
            let by_number: Vec<i64> = (0..6).collect();
            let tetrahedra = split(&mesh.prisms[0], &by_number);
            for t in &tetrahedra {
                let x = t.map(|n| mesh.positions[n as usize]);
                let volume = (x[1] - x[0]).cross(&(x[2] - x[0])).dot(&(x[3] - x[0])) / 6.0;
                assert!((volume - 1.5).abs() < 1e-14);
            }
            for face in [[0, 1, 4, 3], [1, 2, 5, 4], [2, 0, 3, 5]] {
                let face = face.map(|i| order[i]);
                let least = (0..4).min_by_key(|&i| face[i]).unwrap();
                let (from, to) = (face[least], face[(least + 2) % 4]);
                assert!(tetrahedra.iter().any(|t| t.contains(&from) && t.contains(&to)), "{order:?}");
            }
        }
    }

    #[test]
    fn the_split_does_not_depend_on_the_numbering() {
        let mut splits: Vec<Vec<[usize; 4]>> = Vec::new();
        for order in permutations() {
            let [block, wedges] = prisms_as_tetrahedra(&prism(2.0, 3.0, 1.5, order)).unwrap();
            assert_eq!(wedges.n_elements(), 0);
            assert!(block.weights.iter().all(|w| (w - 1.5).abs() < 1e-14));
            let corner = |node: &u32| order.iter().position(|n| n == node).unwrap();
            let (tetrahedra, _) = block.nodes.as_chunks::<4>();
            let mut split: Vec<[usize; 4]> = tetrahedra.iter().map(|t| t.each_ref().map(corner)).collect();
            split.iter_mut().for_each(|t| t.sort_unstable());
            split.sort_unstable();
            splits.push(split);
        }
        splits.dedup();
        assert_eq!((splits.len(), splits[0].len()), (1, 3));
    }

    /// The outer triangle is rotated by 45° against the inner one. With the numbers ascending in the wrong direction, the split
    /// by number has an inverted tetrahedron; another order has none.
    #[test]
    fn a_twisted_prism_is_split_the_other_way_round() {
        let mut mended = 0;
        for order in permutations() {
            let mut mesh = prism(2.0, 2.0, 1.0, order);
            for corner in 0..3 {
                let p = &mut mesh.positions[order[corner] as usize];
                let (sin, cos) = 0.9_f64.sin_cos();
                let (x, y) = (p.x - 0.67, p.y - 0.67);
                (p.x, p.y) = (0.67 + cos * x - sin * y, 0.67 + sin * x + cos * y);
            }
            let by_number: Vec<i64> = (0..6).collect();
            mended += usize::from(inverted(&mesh, 0, &by_number) > 0);
            let [block, wedges] = prisms_as_tetrahedra(&mesh).unwrap();
            assert_eq!(wedges.n_elements(), 0);
            assert!(block.weights.iter().all(|w| *w > 0.0));
        }
        assert!(mended > 0);
    }

    /// With its outer triangle turned by 143°, a prism has an inverted tetrahedron in every order but a sound wedge.
    #[test]
    fn a_prism_too_twisted_for_tetrahedra_becomes_a_wedge() {
        let mut mesh = prism(2.0, 2.0, 1.0, [0, 1, 2, 3, 4, 5]);
        for corner in 0..3 {
            let p = &mut mesh.positions[corner];
            let (sin, cos) = 2.5_f64.sin_cos();
            let (x, y) = (p.x - 0.67, p.y - 0.67);
            (p.x, p.y) = (0.67 + cos * x - sin * y, 0.67 + sin * x + cos * y);
        }
        let [tetrahedra, wedges] = prisms_as_tetrahedra(&mesh).unwrap();
        assert_eq!((tetrahedra.n_elements(), wedges.n_elements()), (0, 1));
        assert_eq!(wedges.cells, [MeshCell::Prism(0)]);
        assert!(wedges.weights.iter().all(|w| *w > 0.0));
    }

    #[test]
    fn a_prism_inside_out_is_refused_with_its_index() {
        let mut mesh = prism(2.0, 3.0, 1.5, [3, 4, 5, 0, 1, 2]);
        mesh.prisms.push([0, 1, 2, 3, 4, 5]);
        let error = prisms_as_tetrahedra(&mesh).unwrap_err();
        assert!(matches!(error, ElementError::InvertedAtRest { element: 1, .. }), "{error}");
    }
}
