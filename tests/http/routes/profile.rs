use prosopon_geometry::TriMesh;
use serde_json::json;

use super::results::solved;
use crate::support::app::TestApp;
use crate::support::shapes::{cube, stl};

#[tokio::test]
async fn a_report_names_points_ratios_and_the_profile_and_draws_them() {
    let app = TestApp::new().await;
    let (session, plan) = app.session_with_plan().await;
    let landmarks = json!({"points": {"subnasale": [0, -100, 0], "menton": [0, -60, -80]}, "midline_x_mm": 1.5,
        "proposed": ["midline_x_mm"]});
    app.put_json(&format!("{session}/landmarks"), landmarks).await.ok();
    let job = app.solve(&session, &plan, json!({"steps": 2})).await;
    app.ended(&job).await.ok();
    let clinical = app.get(&format!("{job}/report")).await.ok()["clinical"].clone();
    assert_eq!((&clinical["midline_x_mm"], &clinical["midline_proposed"]), (&json!(1.5), &json!(true)));
    let point = &clinical["soft_points"][0];
    // 6 mm forward and 1.5 mm down.
    assert_eq!((&point["name"], &point["proposed"]), (&json!("subnasale"), &json!(false)));
    assert_eq!((&point["forward_mm"], &point["down_mm"], &point["left_mm"]), (&json!(6.0), &json!(1.5), &json!(0.0)));
    assert_eq!(clinical["hard_points"][0]["proposed"], true);
    assert_eq!((&clinical["ratios"][0]["ratio"], clinical["ratios"][0].get("reason")), (&json!(1.0), None));
    assert_eq!(clinical["ratios"][1]["ratio"], json!(null));
    assert!(clinical["ratios"][1]["reason"].as_str().unwrap().contains("0.2 mm"));
    assert_eq!(clinical["profile"][0]["after_yz_mm"], json!([[-106.0, 30.0], [-106.0, -30.0]]));
    assert_eq!(clinical["nasolabial_deg"], json!({"before": 100.0, "after": 92.5}));
    assert_eq!((&clinical["labiomental_deg"], &clinical["mouth_sealed"]), (&json!(null), &json!(true)));
    let picture = app.get(&format!("{job}/profile.svg")).await;
    assert_eq!(picture.header("content-type"), "image/svg+xml");
    assert!(picture.body.starts_with(b"<svg"));
    let text = String::from_utf8(app.get(&format!("{job}/report?format=html")).await.body.to_vec()).unwrap();
    let text = text.replace('\n', "");
    for part in [
        "Profile before and after",
        "subnasale (Sn)",
        "A point *",
        "<td>1.00 of A point</td>",
        "nasolabial angle</th><td>100.0°</td><td>92.5°</td><td>-7.5°",
        "The lips are joined in this prediction",
    ] {
        assert!(text.contains(part), "{part}");
    }
}

#[tokio::test]
async fn a_failed_measurement_is_a_warning_and_no_end_of_a_solve() {
    let app = TestApp::new().await;
    let (session, plan) = app.session_with_plan().await;
    app.put_json(&format!("{session}/landmarks"), json!({"points": {"nowhere": [0, 0, 0]}})).await.ok();
    let job = app.solve(&session, &plan, json!({"steps": 1})).await;
    let ended = app.ended(&job).await.ok();
    assert_eq!(ended["status"], "succeeded");
    let codes: Vec<&str> = ended["warnings"].as_array().unwrap().iter().filter_map(|w| w["code"].as_str()).collect();
    assert!(codes.contains(&"points-not-measured"), "{ended}");
    assert!(app.get(&format!("{job}/report")).await.ok().get("clinical").is_none());
    let problem = app.get(&format!("{job}/profile.svg")).await.problem(404, "not-found");
    assert!(problem["detail"].as_str().unwrap().contains("profile"), "{problem}");
}

/// The skin is a box that moves 6 mm forward; the target is 10 mm forward, and 0.7 of the bone are 4.2 mm.
#[tokio::test]
async fn an_error_map_says_what_simple_predictions_would_score() {
    let app = TestApp::new().await;
    let (session, plan) = app.session_with_plan().await;
    app.upload(&format!("{session}/target"), stl(&finer(&cube([0.0, -10.0, 0.0], 100.0)))).await.ok();
    let job = app.solve(&session, &plan, json!({"steps": 2})).await;
    app.ended(&job).await.ok();
    let report = app.get(&format!("{job}/report")).await.ok();
    let baselines = &report["error"]["baselines"];
    let (none, bone) = (&baselines["no_prediction"], &baselines["nearest_bone"]);
    // The corners at the back, 100 mm from the middle, lie 10 mm behind the target at rest, and 5.8 mm behind it (1.05 mm below
    // it, too, at the lower ones) when they follow the bone. Of the moved skin, two corners remain in the region.
    for (baseline, whole, region) in [(none, 10.0, 10.0), (bone, 5.8f64.hypot(1.05), 5.8)] {
        for (s, count, mm) in [(&baseline["whole"], 8, whole), (&baseline["regions"]["upper_lip"], 2, region)] {
            assert_eq!(s["count"], count);
            assert!((s["max_mm"].as_f64().unwrap() - mm).abs() < 1e-4, "{s} {mm}");
        }
    }
    assert!(baselines.get("missing").is_none());
    assert!(app.get(&format!("{job}/steps/1/error")).await.ok().get("baselines").is_none());
    let html = String::from_utf8(app.get(&format!("{job}/report?format=html")).await.body.to_vec()).unwrap();
    assert!(html.contains("no prediction") && html.contains("0.7 of nearest bone"));

    let id = |path: &str| path.rsplit('/').next().unwrap().to_owned();
    let reference = json!({"session": id(&session), "part": "target"});
    let body = json!({"prediction": {"job": id(&job), "step": 2}, "reference": reference});
    let compared = app.post("/v1/compare", body).await.ok();
    assert_eq!(compared["baselines"]["no_prediction"]["whole"], none["whole"]);
    assert_eq!(compared["baselines"]["nearest_bone"]["whole"], bone["whole"]);
    // At half of the path the bone has moved half as far.
    let body = json!({"prediction": {"job": id(&job), "step": 1}, "reference": reference});
    let half = app.post("/v1/compare", body).await.ok();
    let exact = 7.9f64.hypot(0.525);
    let found = half["baselines"]["nearest_bone"]["whole"]["max_mm"].as_f64().unwrap();
    assert!((found - exact).abs() < 1e-4, "{found} {exact}");
    // A surface that no job moved has no baselines, and the answer says why.
    let body = json!({"prediction": {"session": id(&session), "part": "skin"}, "reference": reference});
    let plain = app.post("/v1/compare", body).await.ok();
    assert_eq!(
        (&plain["baselines"]["no_prediction"], &plain["baselines"]["nearest_bone"]),
        (&json!(null), &json!(null))
    );
    assert!(plain["baselines"]["missing"].as_str().unwrap().contains("not a step"), "{plain}");
    // After the skull is replaced, the cuts no longer part the same bone.
    app.upload(&format!("{session}/skull"), stl(&cube([0.0, 1.0, 0.0], 60.0))).await.ok();
    let body = json!({"prediction": {"job": id(&job), "step": 2}, "reference": reference, "register": {}});
    let later = app.post("/v1/compare", body).await.ok();
    assert!(later["baselines"]["no_prediction"]["whole"]["count"].as_u64().is_some(), "{later}");
    assert_eq!(later["baselines"]["nearest_bone"], json!(null));
    assert!(later["baselines"]["missing"].as_str().unwrap().contains("replaced"), "{later}");
}

/// The same surface with each triangle split in four: other triangles than the skin's.
fn finer(mesh: &TriMesh) -> TriMesh {
    let (mut positions, mut triangles) = (mesh.positions().to_vec(), Vec::new());
    for (t, corners) in mesh.triangles().iter().enumerate() {
        let [a, b, c] = mesh.corners(t);
        let first = positions.len() as u32;
        positions.extend([(a, b), (b, c), (c, a)].map(|(p, q)| middle(&p, &q)));
        let ([a, b, c], [ab, bc, ca]) = (*corners, [first, first + 1, first + 2]);
        triangles.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
    }
    TriMesh::new(positions, triangles).unwrap()
}

fn middle(p: &prosopon_geometry::Point, q: &prosopon_geometry::Point) -> prosopon_geometry::Point {
    p + (q - p) * 0.5
}

#[tokio::test]
async fn only_a_finished_solve_of_a_patient_has_a_profile() {
    let app = TestApp::new().await;
    let (session, _, job) = solved(&app, json!({"steps": 1})).await;
    assert!(app.get(&format!("{job}/profile.svg")).await.status.is_success());
    let field = app.post(&format!("{session}/field"), json!({})).await.header("location").to_owned();
    app.ended(&field).await.ok();
    app.get(&format!("{field}/profile.svg")).await.problem(404, "not-found");
}
