//! A ready tissue mesh, its bones, and jobs on it with the real numerics.

use axum::body::Body;
use axum::http::{Method, StatusCode};
use prosopon_formats::export::{stl, vtu};
use prosopon_formats::import::{Limits, volume_mesh};
use prosopon_geometry::{Cell, Point, TriMesh, VolumeMesh};
use serde_json::{Value, json};

use crate::support::app::TestApp;
use crate::support::tissue_mesh::{Block, slab};

fn bone() -> Vec<u8> {
    // Away from the faces at the fixed sides.
    let (min, max) = ([5.0, 5.0, -20.0], [25.0, 25.0, 0.0]);
    let corner = |i: usize| Point::from([0, 1, 2].map(|a| if i >> a & 1 == 1 { max[a] } else { min[a] }));
    let quads = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let triangles = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    stl(&TriMesh::new((0..8).map(corner).collect(), triangles).unwrap())
}

fn laws() -> Value {
    let law = |mu: f64| json!({"law": "neo_hookean", "shear_modulus_mpa": mu, "poisson": 0.4});
    json!({"skin": law(0.07), "fat": law(0.012)})
}

fn read(bytes: &[u8]) -> VolumeMesh {
    volume_mesh(bytes, &Limits::default()).unwrap().0
}

/// Runs a plan on the session's tissue; returns the finished job and its solved mesh.
async fn solve(app: &TestApp, session: &str, paths: Value, more: Value) -> (Value, VolumeMesh) {
    let plan = app.post(&format!("{session}/plans"), json!({"paths": paths})).await.ok();
    assert!(plan["osteotomy"].is_null() && plan["reports"] == json!([]), "{plan}");
    let mut body = json!({"plan": plan["id"], "outputs": ["skin", "tissue"], "steps": 2, "relative_residual": 1e-8});
    more.as_object().unwrap().iter().for_each(|(k, v)| body[k] = v.clone());
    let job = app.finish(app.post(&format!("{session}/jobs"), body).await).await;
    assert_eq!(job["status"], "succeeded", "{job}");
    let file = app.get(job["links"]["tissue"].as_str().unwrap()).await;
    (job, read(&file.body))
}

fn up(mm: f64) -> Value {
    json!([{"segment": 1, "waypoints": [{"t": 1, "translation_mm": [0.5, 0, mm]}]}])
}

#[tokio::test]
async fn a_tied_mesh_is_solved_by_every_model() {
    let app = TestApp::new().await;
    let session = app.session().await;
    let file = slab(1.0);
    let report = app.upload(&format!("{session}/tissue"), file.clone()).await.ok();
    assert_eq!((&report["nodes"], &report["tetrahedra"], &report["wedges"]), (&json!(196), &json!(432), &json!(72)));
    assert_eq!(report["tissues"], json!({"fat": 432, "skin": 72}));
    assert_eq!((&report["tied_nodes"], &report["sliding_nodes"]), (&json!({"0": 96, "1": 25}), &json!(0)));
    assert_eq!((&report["min_mm"], &report["max_mm"]), (&json!([0.0, 0.0, 0.0]), &json!([30.0, 30.0, 11.5])));
    assert_eq!(report["notes"][0]["code"], "tetrahedra-turned", "{report}");
    let stored = app.get(&format!("{session}/tissue")).await;
    assert_eq!((stored.body.as_ref(), stored.header("content-type")), (file.as_slice(), "application/vnd.vtk.vtu"));
    assert_eq!(app.get(&format!("{session}/tissue?format=json")).await.ok(), report);
    assert_eq!(app.get(&session).await.ok()["parts"]["tissue"]["state"], "ready");

    let mut tops = Vec::new();
    for (model, skin_element) in [
        ("linear", "wedge"),
        ("mass_tensor", "wedge"),
        ("nonlinear", "wedge"),
        ("nonlinear", "tet"),
        ("mixed", "c1_prism"),
    ] {
        let more = json!({"model": model, "skin_element": skin_element, "materials": laws()});
        let (job, solved) = solve(&app, &session, up(2.0), more).await;
        let moved = &solved.point_array("displacement_mm").unwrap().values;
        let attachment = &solved.point_array("attachment").unwrap().values;
        for (u, a) in moved.chunks(3).zip(attachment) {
            let expected = if *a == 1.0 { [0.5, 0.0, 2.0] } else { [0.0; 3] };
            assert!(*a < 0.0 || u.iter().zip(expected).all(|(u, e)| (u - e).abs() < 1e-12), "{model} {u:?}");
        }
        assert!(solved.cell_array("volume_ratio").unwrap().values.iter().all(|j| (0.2..3.0).contains(j)));
        let top = solved.points.iter().position(|p| *p == Point::new(15.0, 15.0, 11.5)).unwrap();
        tops.push(moved[3 * top + 2]);
        // The streamed skin is the outer surface of the mesh.
        let own = job["links"]["self"].as_str().unwrap();
        let topology = app.get(&format!("{own}/topology")).await.body;
        assert_eq!(topology.len(), 72 * 12);
        let ply = app.get(&format!("{own}/steps/2/skin?format=ply")).await;
        assert_eq!(ply.status, StatusCode::OK);
        let report = app.get(job["links"]["report"].as_str().unwrap()).await.ok();
        assert_eq!((&report["model"], &report["tissue"]["nodes"]), (&json!(model), &json!(196)));
        assert_eq!(report["parameters"]["materials"]["fat"]["law"], "neo_hookean");
        assert!(report["mesh"].is_null() && report["field"].is_null());
        let page = app.get(&format!("{own}/report?format=html")).await;
        assert!(String::from_utf8_lossy(&page.body).contains("Uploaded mesh of 196 nodes"));
    }
    assert!(tops.iter().all(|z| (1.5..2.3).contains(z)), "{tops:?}");
    assert!((tops[0] - tops[1]).abs() < 1e-6, "{tops:?}");
}

/// Three planes of symmetry and a dead load: the stretch equals the closed form of uniaxial tension.
#[tokio::test]
async fn loads_and_planes_of_symmetry_give_the_closed_form() {
    let app = TestApp::new().await;
    let session = app.session().await;
    let (mu, nu, l) = (0.02, 0.3, 1.3);
    let bulk = 2.0 * mu * (1.0 + nu) / (3.0 * (1.0 - 2.0 * nu));
    let nominal = |s: [f64; 3], axis: usize| {
        let (i1, j) = (s.iter().map(|s| s * s).sum::<f64>(), s.iter().product::<f64>());
        mu * j.powf(-2.0 / 3.0) * (s[axis] - i1 / (3.0 * s[axis])) + 0.5 * bulk * (j * j - 1.0) / s[axis]
    };
    let (mut low, mut high) = (0.5, 1.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        *(if nominal([l, middle, middle], 1) > 0.0 { &mut high } else { &mut low }) = middle;
    }
    let stretch = [l, low, low];
    // One cube of 4 mm: its face x = 4 has two triangles, so its corners share the area in the ratio 2 to 1.
    let block = Block { cells: [1, 1, 1], edge: 4.0, skin: false };
    let mask = |p: &Point| (0..3).filter(|a| p[*a] == 0.0).map(|a| f64::from(1 << a)).sum();
    let total = 16.0 * nominal(stretch, 0);
    let force = |p: &Point| {
        let share = if p.x < 4.0 {
            0.0
        } else if (p.y > 0.0) == (p.z > 0.0) {
            1.0 / 3.0
        } else {
            1.0 / 6.0
        };
        [share * total, 0.0, 0.0]
    };
    let report = app.upload(&format!("{session}/tissue"), block.vtu(|_| -1.0, mask, force)).await.ok();
    assert_eq!(
        (&report["held_nodes"], &report["loaded_nodes"], &report["tied_nodes"]),
        (&json!(7), &json!(4), &json!({}))
    );
    let fat = json!({"fat": {"law": "neo_hookean", "shear_modulus_mpa": mu, "poisson": nu}});
    let more = json!({"model": "nonlinear", "materials": fat, "relative_residual": 1e-10});
    let (_, solved) = solve(&app, &session, json!([]), more).await;
    let moved = &solved.point_array("displacement_mm").unwrap().values;
    for (p, u) in solved.points.iter().zip(moved.chunks(3)) {
        for a in 0..3 {
            assert!((u[a] - (stretch[a] - 1.0) * p[a]).abs() < 1e-7, "{p} {u:?}");
        }
    }
    let cauchy = nominal(stretch, 0) / (low * low);
    assert!(solved.cell_array("stress_mpa").unwrap().values.chunks(6).all(|s| (s[0] - cauchy).abs() < 1e-7 * cauchy));
}

#[tokio::test]
async fn a_rigid_bone_pushes_sliding_nodes() {
    let app = TestApp::new().await;
    let session = app.session().await;
    app.upload(&format!("{session}/tissue"), slab(-2.0)).await.ok();
    let report = app.upload(&format!("{session}/bones/1"), bone()).await.ok();
    assert_eq!(report["triangles"], 12);
    assert_eq!(app.get(&session).await.ok()["parts"]["bone_1"]["state"], "ready");
    let more = json!({"model": "nonlinear", "skin_element": "wedge", "materials": laws()});
    let (job, solved) = solve(&app, &session, up(1.5), more.clone()).await;
    let moved = &solved.point_array("displacement_mm").unwrap().values;
    let at = |x: f64| 3 * solved.points.iter().position(|p| *p == Point::new(x, 15.0, 0.0)).unwrap() + 2;
    for x in [10.0, 15.0, 20.0] {
        // No force pulls the bottom onto the bone: it lifts off over the rim but penetrates nowhere.
        assert!((1.45..1.9).contains(&moved[at(x)]), "{x}: {}", moved[at(x)]);
    }
    let report = app.get(job["links"]["report"].as_str().unwrap()).await.ok();
    assert!(report["steps"][1]["max_penetration_mm"].as_f64().unwrap() <= 0.05);
    assert!(report["steps"][1]["active_contacts"].as_u64().unwrap() > 0);
    assert_eq!(report["inputs"]["bone_1"]["sha256"].as_str().unwrap().len(), 64);

    app.call(Method::DELETE, &format!("{session}/bones/1"), &[], Body::empty()).await;
    app.get(&format!("{session}/bones/1")).await.problem(404, "not-found");
    app.upload(&format!("{session}/bones/10"), bone()).await.problem(404, "not-found");
    // Without its bone, segment 1 has no effect on the mesh.
    let problem =
        app.post(&format!("{session}/plans"), json!({"paths": up(1.0)})).await.problem(422, "invalid-request");
    assert_eq!(problem["errors"][0]["pointer"], "/paths/0/segment");
}

/// A mesh and a free copy of it, 100 mm apart.
fn beside(file: &[u8]) -> Vec<u8> {
    let mesh = read(file);
    let n = mesh.points.len() as u32;
    let copies = mesh.points.iter().map(|p| Point::new(p.x + 100.0, p.y, p.z));
    let points: Vec<Point> = mesh.points.iter().copied().chain(copies).collect();
    let tetrahedra: Vec<[u32; 4]> = mesh
        .cells
        .iter()
        .map(|cell| match cell {
            Cell::Tetrahedron(corners) => *corners,
            Cell::Wedge(_) => panic!("none"),
        })
        .collect();
    let all: Vec<[u32; 4]> = tetrahedra.iter().copied().chain(tetrahedra.iter().map(|t| t.map(|c| c + n))).collect();
    let attachment: Vec<f64> = (0..2 * n).map(|node| if node < n { 0.0 } else { -1.0 }).collect();
    vtu(&points, &all, &[], &[("attachment", 1, &attachment)], &[("tissue", 1, &vec![2.0; all.len()])])
}

#[tokio::test]
async fn unusable_tissue_meshes_and_jobs_are_refused() {
    let app = TestApp::new().await;
    let session = app.session().await;
    let tissue = format!("{session}/tissue");
    app.get(&tissue).await.problem(404, "not-found");
    let problem = app.post(&format!("{session}/plans"), json!({"paths": up(1.0)})).await.problem(409, "missing-input");
    assert_eq!(problem["missing"], json!(["tissue"]));
    app.upload(&tissue, b"not a mesh".to_vec()).await.problem(422, "mesh-not-usable");
    let problem = app.upload(&tissue, slab(-2.5)).await.problem(422, "mesh-not-usable");
    assert_eq!(problem["errors"][0]["pointer"], "/tissue");
    assert!(problem["detail"].as_str().unwrap().contains("attachment"), "{problem}");
    app.get(&tissue).await.problem(404, "not-found");

    // A mesh that only slides, or is held along two axes or at one point, can still move; so can a second block beside
    // a tied one.
    let block = |cells| Block { cells, edge: 3.0, skin: false };
    let loose: [Vec<u8>; 4] = [
        block([1, 1, 1]).vtu(|_| -2.0, |_| 0.0, |_| [0.0; 3]),
        block([1, 1, 1]).vtu(|_| -1.0, |_| 5.0, |_| [0.0; 3]),
        block([1, 1, 1]).vtu(|p| if p.coords.norm() == 0.0 { 0.0 } else { -1.0 }, |_| 0.0, |_| [0.0; 3]),
        beside(&block([1, 1, 1]).vtu(|_| 0.0, |_| 0.0, |_| [0.0; 3])),
    ];
    for file in loose {
        let problem = app.upload(&tissue, file).await.problem(422, "mesh-not-usable");
        assert!(problem["detail"].as_str().unwrap().contains("the part of 8 nodes"), "{problem}");
        assert_eq!(problem["errors"][0]["pointer"], "/tissue");
    }
    app.get(&tissue).await.problem(404, "not-found");

    app.upload(
        &tissue,
        Block { cells: [2, 2, 2], edge: 3.0, skin: false }.vtu(
            |p| if p.z == 0.0 { 1.0 } else { -1.0 },
            |_| 0.0,
            |_| [0.0; 3],
        ),
    )
    .await
    .ok();
    let plan = app.post(&format!("{session}/plans"), json!({"paths": up(1.0)})).await.ok();
    let jobs = format!("{session}/jobs");
    for (more, pointer) in [
        (json!({"attachment": {"tie_gap_mm": 1}}), "/attachment"),
        (json!({"reference_job": plan["id"]}), "/reference_job"),
        (json!({"plan": "00000000-0000-0000-0000-000000000000"}), "/plan"),
    ] {
        let mut body = json!({"plan": plan["id"]});
        more.as_object().unwrap().iter().for_each(|(k, v)| body[k] = v.clone());
        let problem = app.post(&jobs, body).await.problem(422, "invalid-request");
        assert_eq!(problem["errors"][0]["pointer"], pointer, "{problem}");
    }
    // The mesh is replaced before the job starts.
    app.stand_in.hold_after(0);
    let (other, other_plan) = app.session_with_plan().await;
    let first = app.solve(&other, &other_plan, json!({})).await;
    let waiting = app.post(&jobs, json!({"plan": plan["id"]})).await;
    let job = waiting.header("location").to_owned();
    app.upload(&tissue, slab(1.0)).await.ok();
    app.stand_in.release();
    app.ended(&first).await.ok();
    let ended = app.ended(&job).await.ok();
    assert_eq!((&ended["status"], &ended["problem"]["type"]), (&json!("failed"), &json!("/problems/stale")));

    let gone = app.call(Method::DELETE, &tissue, &[], Body::empty()).await;
    assert_eq!(gone.status, StatusCode::NO_CONTENT);
    app.post(&jobs, json!({"plan": plan["id"]})).await.problem(409, "missing-input");
}

/// The published constants lose ellipticity: the job reports tissue, position and stretch, and its answer warned of it.
#[tokio::test]
async fn an_unstable_material_is_reported_with_tissue_and_stretch() {
    let app = TestApp::new().await;
    let session = app.session().await;
    app.upload(&format!("{session}/tissue"), slab(1.0)).await.ok();
    let plan = app.post(&format!("{session}/plans"), json!({"paths": up(6.0)})).await.ok();
    let body =
        json!({"plan": plan["id"], "model": "nonlinear", "skin_element": "wedge", "preset": "wang_2009", "steps": 6});
    let job = app.finish(app.post(&format!("{session}/jobs"), body).await).await;
    assert_eq!(
        (&job["status"], &job["problem"]["type"]),
        (&json!("failed"), &json!("/problems/solver-unstable")),
        "{job}"
    );
    let problem = &job["problem"];
    assert!(["skin", "fat"].contains(&problem["tissue"].as_str().unwrap()), "{problem}");
    assert!(problem["stretch"].as_f64().unwrap() > 1.01 && problem["element"].is_u64(), "{problem}");
    assert!(job["warnings"].to_string().contains("is stable only"), "{job}");
}
