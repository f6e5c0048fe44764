//! Removes pockets of tissue behind and between bone.
//! A narrow neck connects a pocket to the rest. Pockets do not affect the skin but add unknowns and reduce stability.

use rayon::prelude::*;

use super::adjacency::{Rows, groups, shared_faces};
use super::domain::InnerTissue;
use super::quality::tetrahedron_volume;
use super::stuffing::TetMesh;
use super::tuning::NECK_EDGES;

/// Pockets that were left out.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Pockets {
    pub(super) pockets: usize,
    pub(super) tetrahedra: usize,
    pub(super) volume_mm3: f64,
}

/// Removes the tetrahedra of all pockets.
///
/// Inner nodes (farther than [`NECK_EDGES`] edges from every boundary) that are joined by edges form groups. A group is a pocket
/// when none of its tetrahedra reaches a node of `under_skin`. Tetrahedra without inner nodes join the group that is nearer
/// through faces.
pub(super) fn leave_out_pockets(tissue: &InnerTissue<'_>, mesh: &mut TetMesh, under_skin: &[bool]) -> Pockets {
    let n = mesh.positions.len();
    let inner: Vec<bool> =
        mesh.positions.par_iter().map(|p| tissue.value_side(p).0 < -NECK_EDGES * tissue.edge).collect();
    let is = |flags: &[bool], i: u32| flags[i as usize];
    let pairs = mesh.tetrahedra.iter().flat_map(|t| {
        let first = t.iter().copied().find(|&i| is(&inner, i));
        let inner = &inner;
        t.iter().copied().filter(move |&i| is(inner, i)).filter_map(move |i| first.map(|f| [f, i]))
    });
    let group = groups(n, pairs);
    let mut reaches_skin = vec![false; n];
    for t in mesh.tetrahedra.iter().filter(|t| t.iter().any(|&i| is(under_skin, i))) {
        t.iter().filter(|&&i| is(&inner, i)).for_each(|&i| reaches_skin[group[i as usize] as usize] = true);
    }
    // Some(true) is kept, Some(false) is removed, None is not yet decided.
    let mut stays: Vec<Option<bool>> = mesh
        .tetrahedra
        .iter()
        .map(|t| {
            if t.iter().any(|&i| is(under_skin, i)) {
                return Some(true);
            }
            t.iter().find(|&&i| is(&inner, i)).map(|&i| reaches_skin[group[i as usize] as usize])
        })
        .collect();
    let (shared, _) = shared_faces(&mesh.tetrahedra);
    let both = shared.iter().flat_map(|&[a, b]| [(a, b), (b, a)]);
    let neighbours = Rows::of(mesh.tetrahedra.len(), both);
    // Kept tetrahedra spread first, so a tetrahedron equally near to both is kept.
    let mut front: Vec<u32> = (0..stays.len() as u32).filter(|&t| stays[t as usize] == Some(true)).collect();
    front.extend((0..stays.len() as u32).filter(|&t| stays[t as usize] == Some(false)));
    while !front.is_empty() {
        let mut next = Vec::new();
        for t in front {
            for &other in neighbours.row(t as usize) {
                if stays[other as usize].is_none() {
                    stays[other as usize] = stays[t as usize];
                    next.push(other);
                }
            }
        }
        front = next;
    }
    let mut out = Pockets::default();
    let mut pocket_groups = Vec::new();
    let mut index = 0;
    let positions = &mesh.positions;
    mesh.tetrahedra.retain(|t| {
        let goes = stays[index] == Some(false);
        index += 1;
        if goes {
            out.tetrahedra += 1;
            out.volume_mm3 += tetrahedron_volume(&t.map(|i| positions[i as usize]));
            pocket_groups.extend(t.iter().filter(|&&i| inner[i as usize]).map(|&i| group[i as usize]));
        }
        !goes
    });
    pocket_groups.sort_unstable();
    pocket_groups.dedup();
    out.pockets = pocket_groups.len();
    out
}

#[cfg(test)]
mod tests {
    use super::super::adjacency::boundary;
    use super::super::domain::{Domain, MeshSettings, Region, Side};
    use super::super::stuffing::{lattice_over, refine, stuff};
    use super::super::test_domain::Shape;
    use super::*;
    use prosopon_geometry::control::Control;
    use prosopon_geometry::{Aabb, Point};

    /// Tissue around and inside a hollow bone of 14 to 20 mm radius with a hole of the given radius.
    fn left_out(hole: f64) -> (Pockets, TetMesh) {
        let skin = Shape::ball(Point::origin(), 34.0);
        let bone = Shape(Box::new(move |p| {
            let shell = (p.coords.norm() - 17.0).abs() - 3.0;
            let hole = if p.z > 0.0 { p.x.hypot(p.y) - hole } else { p.coords.norm() - hole };
            shell.max(-hole)
        }));
        let bounds = Aabb { min: Point::new(-40.0, -40.0, -40.0), max: Point::new(40.0, 40.0, 40.0) };
        let region = Region { bounds, half_spaces: vec![] };
        let domain = Domain { skin: &skin, bone: &bone, air: None, soft_tissue: None, region: &region };
        let inner = InnerTissue::new(&domain, &MeshSettings { depth_mm: 100.0, ..MeshSettings::default() });
        let mut mesh =
            stuff(&inner, &refine(lattice_over(&inner, 4.0).unwrap(), vec![], 4.0).unwrap(), &Control::new()).unwrap();
        let faces = boundary(&mesh.tetrahedra);
        let mut under_skin = vec![false; mesh.positions.len()];
        for &n in faces.iter().flat_map(|f| &f.nodes) {
            under_skin[n as usize] = inner.value_side(&mesh.positions[n as usize]).1 == Side::Skin;
        }
        let out = leave_out_pockets(&inner, &mut mesh, &under_skin);
        (out, mesh)
    }

    #[test]
    fn a_pocket_behind_a_narrow_neck_goes_and_one_with_a_wide_mouth_stays() {
        let (narrow, mesh) = left_out(2.0);
        assert_eq!(narrow.pockets, 1);
        // The mesh is inscribed in the ball of 14 mm; part of the neck may be removed too.
        let ball = 4.0 / 3.0 * std::f64::consts::PI * 14f64.powi(3);
        assert!((narrow.volume_mm3 / ball - 1.0).abs() < 0.06, "{} {ball}", narrow.volume_mm3);
        let centre = |t: &[u32; 4]| {
            t.iter().map(|&i| mesh.positions[i as usize].coords).sum::<prosopon_geometry::Vector>() / 4.0
        };
        assert!(mesh.tetrahedra.iter().all(|t| centre(t).norm() > 13.0));
        let (wide, _) = left_out(9.0);
        assert_eq!(wide, Pockets::default());
    }
}
