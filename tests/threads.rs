//! Results are bit-identical with any number of threads.

use prosopon_field::{DistanceField, EnvelopeSettings, FieldSettings, envelope};
use prosopon_geometry::control::Control;
use prosopon_geometry::{Implicit, Motion, Point, TriMesh, Vector};
use prosopon_planning::evaluate::{error_map, register};
use prosopon_planning::plan::{BoundedPlane, Cut, Path, Plan, cut, follow};

/// Result of `work` with 1, 2 and 3 threads.
fn on_threads<T: Send>(work: impl Fn() -> T + Sync) -> [T; 3] {
    [1, 2, 3].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        pool.install(&work)
    })
}

/// A torus with holes: major radius 8 mm, minor radius 3 mm.
fn dirty_torus() -> TriMesh {
    let (n, m) = (60u32, 24u32);
    let points = (0..n * m)
        .map(|v| {
            let (u, w) = (f64::from(v / m) / f64::from(n), f64::from(v % m) / f64::from(m));
            let (u, w) = (u * std::f64::consts::TAU, w * std::f64::consts::TAU);
            let ring = 8.0 + 3.0 * w.cos();
            Point::new(ring * u.cos(), ring * u.sin(), 3.0 * w.sin())
        })
        .collect();
    let at = |i: u32, j: u32| (i % n) * m + j % m;
    let triangles = (0..n * m)
        .map(|v| (v / m, v % m))
        .flat_map(|(i, j)| [[at(i, j), at(i + 1, j), at(i + 1, j + 1)], [at(i, j), at(i + 1, j + 1), at(i, j + 1)]])
        .enumerate()
        .filter(|(t, _)| t % 97 != 0)
        .map(|(_, t)| t)
        .collect();
    TriMesh::new(points, triangles).expect("a mesh")
}

#[test]
fn a_distance_field() {
    let mesh = dirty_torus();
    let settings = FieldSettings { spacing_mm: 0.6, band_mm: 2.0, margin_mm: 5.0 };
    let built = on_threads(|| {
        let (field, report) = DistanceField::build(&mesh, &settings, &Control::new()).unwrap();
        let mut bits = Vec::new();
        for n in 0..20_000u32 {
            let step = Vector::new(f64::from(n % 31), f64::from(n / 31 % 29), f64::from(n / 899)) * 0.93;
            let (value, gradient) = field.value_gradient(&(Point::new(-15.0, -14.0, -10.0) + step));
            bits.extend([value, gradient.x, gradient.y, gradient.z].map(f64::to_bits));
        }
        (report, bits)
    });
    assert!(built[0].0.warnings.iter().any(|w| w.message.contains("open")));
    assert!(built[1] == built[0] && built[2] == built[0]);
}

#[test]
fn an_envelope() {
    let mesh = dirty_torus();
    let settings = EnvelopeSettings { spacing_mm: 0.5, closing_mm: 1.0, min_visibility: 0.06 };
    let built = on_threads(|| {
        let found = envelope(&mesh, &settings, &Control::new()).unwrap();
        (found.grid.values.iter().map(|v| v.to_bits()).collect::<Vec<_>>(), found.surface, found.warnings)
    });
    assert!(built[1] == built[0] && built[2] == built[0]);
}

#[test]
fn a_cut_and_a_path() {
    let settings = EnvelopeSettings { spacing_mm: 0.5, closing_mm: 1.0, min_visibility: 0.06 };
    let bone = envelope(&dirty_torus(), &settings, &Control::new()).unwrap();
    let plane = BoundedPlane { point: Point::new(0.1, 0.2, 0.1), normal: Vector::new(0.2, 0.1, 1.0), bounds: None };
    let done = on_threads(|| {
        let osteotomy = cut(&bone, &[Cut::from(plane)], &Control::new()).unwrap();
        let plan = Plan { paths: vec![Path::new(1, vec![(1.0, Motion::translation(0.5, 0.0, 1.0))]).unwrap()] };
        let reports = follow(&osteotomy, &plan, &Control::new()).unwrap();
        (osteotomy, reports)
    });
    assert!(done[1] == done[0] && done[2] == done[0]);
}

#[test]
fn an_error_map_and_a_registration() {
    let mesh = dirty_torus();
    // A plain torus could turn about its axis; a dent determines the rotation.
    let dent =
        |p: &Point| p + Vector::new(0.0, 0.0, 2.5 * (-(p - Point::new(8.0, 0.0, 3.0)).norm_squared() / 9.0).exp());
    let target = mesh.with_positions(mesh.positions().iter().map(dent).collect()).unwrap();
    let source = target.moved(&Motion::new(Vector::new(0.2, -0.1, 0.3), Vector::new(0.02, 0.01, -0.03)));
    let done = on_threads(|| {
        let found = register(&source, &target, None, &Control::new()).unwrap();
        let map = error_map(&source.moved(&found.motion), &mesh, None, &[], &Control::new()).unwrap();
        let bits: Vec<u32> = map.signed_mm.iter().map(|v| v.to_bits()).collect();
        (found, bits, map.whole, map.backward, map.smoothed)
    });
    assert!(done[1] == done[0] && done[2] == done[0]);
}
