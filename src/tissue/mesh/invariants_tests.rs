//! Invariants of meshes of difficult domains.

use rayon::prelude::*;

use super::domain::{Domain, MeshSettings};
use super::test_cases::{Case, analytic, dirty, random};
use super::test_domain::within;
use super::test_invariants::{measure, no_node_hangs};
use super::tuning::{MAX_SKIN_DISTANCE_MM, MIN_WALL_PRISM_MM, WORST_JACOBIAN};
use super::{MeshReport, MixedMesh, build};
use prosopon_geometry::Point;
use prosopon_geometry::control::Control;

/// Smallest dihedral angle that pressing and splitting leave, degrees, and the largest.
const ANGLES_DEG: (f64, f64) = (8.0, 172.0);

fn built(case: &Case) -> (MixedMesh, MeshReport) {
    match build(&case.domain(), &case.settings, &Control::new()) {
        Ok(built) => built,
        Err(error) => panic!("{}: {error}", case.name),
    }
}

fn check(case: &Case) {
    let (mesh, report) = built(case);
    let name = &case.name;
    let found = measure(name, &mesh);
    assert_eq!((report.tetrahedra, report.prisms), (mesh.tetrahedra.len(), mesh.prisms.len()), "{name}");
    assert_eq!((report.nodes, report.inverted), (mesh.positions.len(), 0), "{name}");
    assert!(report.prisms > 50 && report.tetrahedra > 100, "{name}: {report:?}");
    assert_eq!(report.nonmanifold_edges, found.crowded_outer_edges, "{name}");
    assert!(found.smallest_volume > 0.0, "{name}: {found:?}");
    let near = |a: f64, b: f64, by: f64| (a - b).abs() <= by;
    assert!(near(report.min_dihedral_deg, found.dihedral_deg.0, 1e-6), "{name}: {found:?}");
    assert!(near(report.max_dihedral_deg, found.dihedral_deg.1, 1e-6), "{name}: {found:?}");
    assert!(found.dihedral_deg.0 > ANGLES_DEG.0 && found.dihedral_deg.1 < ANGLES_DEG.1, "{name}: {found:?}");
    assert!(near(report.min_scaled_jacobian, found.scaled_jacobian, 1e-9), "{name}: {found:?}");
    assert!(found.scaled_jacobian >= WORST_JACOBIAN, "{name}: {found:?}");
    assert!(near(report.muscle_share, found.muscle_volume / found.tetrahedra_volume, 1e-9), "{name}: {report:?}");
    assert!(found.crowded_share < 0.01, "{name}: {found:?}");
    assert!(found.overlaps as f64 <= case.overlapping * report.nodes as f64, "{name}: {found:?}");
    if case.overlapping == 0.0 {
        no_node_hangs(name, &mesh);
    }
    assert_eq!(found.components, case.components, "{name}");
    prisms_stand_on_the_skin(case, &mesh, &report);
    volume_is_that_of_the_domain(case, found.volume, &report);
}

/// Outer nodes lie on the skin, and inner ones below it by the thickness of the skin layer or, above bone and between
/// thin walls, down to the tissue that remains.
fn prisms_stand_on_the_skin(case: &Case, mesh: &MixedMesh, report: &MeshReport) {
    let (name, skin) = (&case.name, case.domain().skin);
    let at = |i: u32| mesh.positions[i as usize];
    let mut farthest = 0.0f64;
    let mut depths = (f64::INFINITY, f64::NEG_INFINITY);
    for &[a, b, c, d, e, f] in &mesh.prisms {
        let [a, b, c] = [a, b, c].map(at);
        for p in [a, b, c] {
            let off = skin.value(&p).abs();
            assert!(off <= 0.02, "{name}: an outer node at {p} is {off} mm off the skin");
            farthest = farthest.max(off);
        }
        farthest = farthest.max(skin.value(&Point::from((a.coords + b.coords + c.coords) / 3.0)).abs());
        for p in [d, e, f].map(at) {
            let depth = -skin.value(&p);
            depths = (depths.0.min(depth), depths.1.max(depth));
        }
    }
    let MeshSettings { skin_thickness_mm, edge_mm, .. } = case.settings;
    assert!(depths.0 > 0.5 * MIN_WALL_PRISM_MM, "{name}: {depths:?}");
    assert!(depths.1 < skin_thickness_mm + 0.51 * edge_mm, "{name}: {depths:?}");
    assert!(
        (farthest - report.max_skin_distance_mm).abs() < 1e-9 && farthest <= MAX_SKIN_DISTANCE_MM,
        "{name}: {farthest} {report:?}"
    );
}

/// Volume of the tissue by counting points, mm³.
fn counted(domain: &Domain<'_>, settings: &MeshSettings) -> f64 {
    const STEP: f64 = 0.5;
    let bounds = domain.region.bounds;
    let size = (bounds.max - bounds.min).map(|x| (x / STEP).round() as usize);
    let plane = |k: usize| {
        let mut count = 0usize;
        for j in 0..size.y {
            for i in 0..size.x {
                let p = bounds.min + STEP * nalgebra::Vector3::new(i as f64 + 0.5, j as f64 + 0.5, k as f64 + 0.5);
                count += usize::from(within(domain, settings, &p));
            }
        }
        count
    };
    (0..size.z).into_par_iter().map(plane).sum::<usize>() as f64 * STEP.powi(3)
}

fn volume_is_that_of_the_domain(case: &Case, volume: f64, report: &MeshReport) {
    let name = &case.name;
    assert!(report.volume_error.abs() <= case.volume_error, "{name}: {report:?}");
    // Pockets that were left out are not part of the reported error.
    if report.warnings.iter().any(|w| w.code == "mesh-pockets") {
        return;
    }
    let expected = case.volume_mm3.unwrap_or_else(|| counted(&case.domain(), &case.settings));
    let error = volume / expected - 1.0;
    assert!((error - report.volume_error).abs() < 0.01, "{name}: {error} {report:?}");
}

#[test]
fn meshes_of_difficult_domains_keep_all_invariants() {
    analytic().iter().for_each(check);
}

#[test]
fn meshes_of_random_heads_keep_all_invariants() {
    random(6).iter().for_each(check);
}

#[test]
fn meshes_over_dirty_bone_keep_all_invariants() {
    dirty().iter().for_each(check);
}

#[test]
fn one_thread_and_two_give_the_same_bits() {
    let case = &random(1)[0];
    let by = |n: usize| rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap().install(|| built(case));
    assert_eq!(by(1), by(2));
}
