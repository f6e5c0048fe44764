use axum::http::StatusCode;
use serde_json::{Value, json};

use crate::support::app::{TestApp, pointers};

/// The body of an osteotomy with one horizontal plane.
pub(super) fn plane(z: f64) -> Value {
    json!({"cuts": [{"plane": {"point_mm": [0, 0, z], "normal": [0, 0, 1]}}]})
}

#[tokio::test]
async fn a_cut_gives_segments_with_surfaces() {
    let app = TestApp::new().await;
    let session = app.session_with_field().await;
    let answer = app.post(&format!("{session}/osteotomies"), plane(0.0)).await;
    assert_eq!(answer.status, StatusCode::CREATED);
    let path = answer.header("location").to_owned();
    let made = answer.json();
    assert_eq!(made["segments"].as_array().unwrap().len(), 2);
    assert!((made["segments"][1]["volume_mm3"].as_f64().unwrap() - 64000.0).abs() < 1e-6);
    assert_eq!(app.get(&path).await.ok(), made);
    assert_eq!(app.get(&format!("{session}/osteotomies")).await.ok()["osteotomies"], json!([made]));
    let surface = app.get(&format!("{path}/segments/1?format=stl")).await;
    assert_eq!((surface.status, surface.body.len()), (StatusCode::OK, 84 + 50 * 12));
    app.get(&format!("{path}/segments/7")).await.problem(404, "not-found");
    assert_eq!(app.delete(&path).await.status, StatusCode::NO_CONTENT);
    app.get(&path).await.problem(410, "gone");
}

#[tokio::test]
async fn a_template_takes_the_sessions_landmarks() {
    let app = TestApp::new().await;
    let session = app.session_with_field().await;
    let path = format!("{session}/osteotomies");
    let template = json!({"template": {"name": "le_fort_1"}});
    let far = json!({"template": {"name": "le_fort_1", "midline_x_mm": 1e6}});
    assert_eq!(pointers(&app.post(&path, far).await), ["/template/midline_x_mm"]);
    let landmarks = json!({"points": {}, "midline_x_mm": 6, "occlusal_plane_z_mm": 17,
        "le_fort_1_plane": {"point_mm": [6, -60, 38], "normal": [0, 0, 1]}});
    app.put_json(&format!("{session}/landmarks"), landmarks).await.ok();
    let made = app.post(&path, template).await.ok();
    assert_eq!(
        (&made["template"], &made["cuts"][0]["plane"]["point_mm"]),
        (&json!("le_fort_1"), &json!([6.0, -60.0, 38.0]))
    );
}

#[tokio::test]
async fn a_preview_shows_the_cuts_that_a_request_would_make() {
    let app = TestApp::new().await;
    let session = app.session_with_field().await;
    let templates = app.get("/v1/templates").await.ok();
    assert_eq!(templates["templates"].as_array().unwrap().len(), 8);
    assert_eq!(
        templates["templates"][5],
        json!({"name": "genioplasty", "needs": ["pogonion", "menton"], "improved_by": []})
    );
    let path = format!("{session}/osteotomies");
    let request = json!({"template": {"name": "le_fort_1", "plane": {"point_mm": [6, -60, 38], "normal": [0, 0, 1]}},
        "cuts": plane(3.0)["cuts"]});
    let preview = app.post(&format!("{path}/preview"), request.clone()).await;
    assert_eq!(preview.status, StatusCode::OK);
    let made = app.post(&path, request).await.ok();
    assert_eq!(preview.json()["cuts"], made["cuts"]);
    let again = app.post(&path, json!({"cuts": preview.json()["cuts"]})).await.ok();
    assert_eq!((&again["cuts"], &again["segments"]), (&made["cuts"], &made["segments"]));
    let guarded =
        json!({"cuts": plane(3.0)["cuts"], "protected": [{"name": "nerve", "points_mm": [[0, 0, 3]], "margin_mm": 5}]});
    let unmeasured = app.post(&format!("{path}/preview"), guarded).await.json();
    assert_eq!(unmeasured["warnings"][0]["code"], "distances-not-measured");
    // The same faults, at the same places, and nothing is stored.
    let far = json!({"template": {"name": "le_fort_1", "midline_x_mm": 1e6}});
    assert_eq!(pointers(&app.post(&format!("{path}/preview"), far).await), ["/template/midline_x_mm"]);
    assert_eq!(app.get(&path).await.ok()["osteotomies"].as_array().unwrap().len(), 2);
}

#[tokio::test]
async fn a_preview_says_where_a_request_would_be_refused() {
    let app = TestApp::real().await;
    let path = format!("{}/osteotomies/preview", app.session_with_surfaces().await);
    // Cubes show no head.
    let placed = app.post(&path, plane(0.0)).await.ok();
    let codes: Vec<&Value> = placed["warnings"].as_array().unwrap().iter().map(|w| &w["code"]).collect();
    assert_eq!(codes, ["frame-doubtful"]);
    // A plane beside the bone is shown all the same, so that it can be moved.
    let missed = app.post(&path, plane(500.0)).await.ok();
    assert_eq!(missed["cuts"][0]["plane"]["point_mm"][2], 500.0);
    assert_eq!(missed["warnings"][0]["code"], "cut-misses-bone", "{missed}");
    let bounded = json!({"cuts": [{"plane": {"point_mm": [0, 0, 3], "normal": [0, 0, 1],
        "bounds": {"direction": [1, 0, 0], "half_length_mm": 5, "half_width_mm": 5}}}]});
    assert_eq!(app.post(&path, bounded).await.ok()["warnings"][0]["code"], "bone-not-parted");
    let misspelt = json!({"template": {"name": "le_fort_1", "midline_x_mm": 0, "occlusal_plane_z_mm": -20,
        "plane": {"point_mm": [0, 0, 3], "normal": [0, 0, 1]}, "landmarks": {"zygomaxilare_left": [30, -60, 38]}}});
    let placed = app.post(&path, misspelt).await.ok();
    assert_eq!(placed["notes"][0]["code"], "landmarks-not-used", "{placed}");
}

#[tokio::test]
async fn unusable_cuts_are_refused() {
    let app = TestApp::new().await;
    let path = format!("{}/osteotomies", app.session().await);
    let problem = app.post(&path, plane(0.0)).await.problem(409, "missing-input");
    assert_eq!(problem["missing"], json!(["skin", "skull"]));
    // A cut needs only the surfaces, not a field job.
    let path = format!("{}/osteotomies", app.session_with_surfaces().await);
    assert_eq!(app.post(&path, plane(0.0)).await.status, StatusCode::CREATED);

    let path = format!("{}/osteotomies", app.session_with_field().await);
    let problem = app.post(&path, plane(500.0)).await.problem(422, "cut-misses-bone");
    assert_eq!((&problem["cut"], &problem["distance_mm"]), (&json!(0), &json!(440.0)));
    assert_eq!(problem["errors"][0]["pointer"], "/cuts/0");
    assert_eq!(pointers(&app.post(&path, json!({})).await), [""]);
    assert_eq!(pointers(&app.post(&path, json!({"cuts": []})).await), ["/cuts"]);
    let slanted = json!({"cuts": [{"plane": {"point_mm": [0, 0, 1e7], "normal": [0, 0, 0],
        "bounds": {"direction": [0, 0, 1], "half_length_mm": -1, "half_width_mm": 10}}}]});
    assert_eq!(
        pointers(&app.post(&path, slanted).await),
        [
            "/cuts/0/plane/normal",
            "/cuts/0/plane/bounds/direction",
            "/cuts/0/plane/bounds/half_length_mm",
            "/cuts/0/plane/point_mm/2"
        ]
    );
    let high = json!({"template": {"name": "le_fort_1", "plane": {"point_mm": [0, 0, 500], "normal": [0, 0, 1]}}});
    let problem = app.post(&path, high).await.problem(422, "cut-misses-bone");
    assert_eq!(problem["errors"][0]["pointer"], "/template");
    let problem = app.post(&path, json!({"template": {"name": "bsso_left"}})).await.problem(422, "plan-not-usable");
    assert_eq!(problem["template"], "bsso_left");
    assert!(problem["missing"].as_array().unwrap().contains(&json!("lingula_left")), "{problem}");
    assert_eq!(pointers(&app.post(&path, json!({"cut": []})).await), ["/cut"]);
}

#[tokio::test]
async fn cuts_of_every_shape_are_returned_as_sent() {
    let app = TestApp::new().await;
    let path = format!("{}/osteotomies", app.session_with_field().await);
    let polyline =
        json!({"points_mm": [[-40, -80, 5], [0, -80, 9], [40, -80, 5]], "direction": [0, 2, 0], "depth_mm": 90});
    let surface = json!({"points_mm": [[-50, -50, 1], [50, -50, 1], [0, 90, 1]], "triangles": [[0, 1, 2]]});
    let cuts = json!([
        {"plane": {"point_mm": [0, 0, 3], "normal": [0, 0, 1]}, "kerf_mm": 0.5},
        {"polyline": polyline}, {"surface": surface}, {"free_part": {"point_mm": [0, -20, -30]}},
    ]);
    let nerve = json!({"name": "nerve", "points_mm": [[0, 0, 2], [10, 0, 2]], "margin_mm": 2});
    let made = app.post(&path, json!({"cuts": cuts, "protected": [nerve]})).await.ok();
    let kinds = ["plane", "polyline", "surface", "free_part"];
    for (cut, kind) in made["cuts"].as_array().unwrap().iter().zip(kinds) {
        assert!(cut[kind].is_object() && cut["purpose"] == "osteotomy", "{cut}");
    }
    assert_eq!(
        (&made["cuts"][0]["kerf_mm"], &made["cuts"][1]["polyline"]["direction"]),
        (&json!(0.5), &json!([0.0, 1.0, 0.0]))
    );
    let near = &made["clearances"][0];
    assert_eq!(
        (&near["protected"], &near["distance_mm"], &near["below_margin"]),
        (&json!("nerve"), &json!(1.5), &json!(true))
    );
    let own = format!("{path}/{}", made["id"].as_str().unwrap());
    assert_eq!(app.get(&own).await.ok(), made);
    // The numerics receive exactly what was stored.
    let plans = own.split("/osteotomies").next().unwrap().to_owned() + "/plans";
    let paths = json!([{"segment": 1, "waypoints": [{"t": 1, "translation_mm": [0, -6, 0]}]}]);
    app.post(&plans, json!({"osteotomy": made["id"], "paths": paths})).await.ok();
}

#[tokio::test]
async fn invalid_cuts_are_refused_with_their_pointer() {
    let app = TestApp::new().await;
    let path = format!("{}/osteotomies", app.session_with_field().await);
    let refused = async |cut: Value, expected: &[&str]| {
        assert_eq!(pointers(&app.post(&path, json!({"cuts": [cut]})).await), expected);
    };
    refused(json!({}), &["/cuts/0"]).await;
    let plane = json!({"point_mm": [0, 0, 0], "normal": [0, 0, 1]});
    refused(json!({"plane": plane, "free_part": {"point_mm": [0, 0, 0]}}), &["/cuts/0"]).await;
    refused(json!({"plane": plane, "kerf_mm": -1}), &["/cuts/0/kerf_mm"]).await;
    let line = json!({"points_mm": [], "direction": [0, 0, 0], "depth_mm": 0});
    let expected = ["/cuts/0/polyline/direction", "/cuts/0/polyline/depth_mm", "/cuts/0/polyline/points_mm"];
    refused(json!({"polyline": line}), &expected).await;
    let many = vec![[0.0; 3]; 1001];
    let line = json!({"points_mm": many, "direction": [0, 0, 1], "depth_mm": 5});
    refused(json!({"polyline": line}), &["/cuts/0/polyline/points_mm"]).await;
    let surface = json!({"points_mm": [[0, 0, 0], [1, 0, 0], [0, 1e9, 0]], "triangles": [[0, 1, 7]]});
    let expected = ["/cuts/0/surface/points_mm/2/1", "/cuts/0/surface/triangles"];
    refused(json!({"surface": surface}), &expected).await;
    refused(
        json!({"surface": {"points_mm": [[0, 0, 0], [1, 0, 0], [0, 1, 0]], "triangles": []}}),
        &["/cuts/0/surface/triangles"],
    )
    .await;
    let both = json!({"template": {"name": "le_fort_1"}, "templates": [{"name": "le_fort_1"}]});
    assert_eq!(pointers(&app.post(&path, both).await), ["/templates"]);
    let nobody = json!({"cuts": [{"plane": plane}], "protected": [{"name": "", "points_mm": [], "margin_mm": -1}]});
    let expected = ["/protected/0/name", "/protected/0/margin_mm", "/protected/0/points_mm"];
    assert_eq!(pointers(&app.post(&path, nobody).await), expected);
}

#[tokio::test]
async fn a_later_failure_of_a_cut_points_to_the_osteotomy_or_plan() {
    let app = TestApp::new().await;
    let (session, plan) = app.session_with_plan().await;
    let osteotomy = app.get(&format!("{session}/osteotomies")).await.ok()["osteotomies"][0]["id"].clone();
    let path = format!("{session}/osteotomies/{}", osteotomy.as_str().unwrap());
    app.stand_in.cuts_miss.store(true, std::sync::atomic::Ordering::SeqCst);
    let mesh = app.post(&format!("{session}/mesh"), json!({"osteotomy": osteotomy, "edge_mm": 5})).await;
    let solve = app.post(&format!("{session}/jobs"), json!({"plan": plan})).await;
    for (job, pointer) in [(mesh, "/osteotomy"), (solve, "/plan")] {
        let problem = &app.finish(job).await["problem"];
        assert_eq!(problem["type"], "/problems/cut-misses-bone", "{problem}");
        assert_eq!((&problem["errors"][0]["pointer"], &problem["osteotomy"]), (&json!(pointer), &json!(path)));
    }
    let paths = json!([{"segment": 1, "waypoints": [{"t": 1, "translation_mm": [0, -6, 0]}]}]);
    let problem = app.post(&format!("{session}/plans"), json!({"osteotomy": osteotomy, "paths": paths})).await;
    assert_eq!(problem.problem(422, "cut-misses-bone")["errors"][0]["pointer"], "/osteotomy");
}

#[tokio::test]
async fn a_list_in_place_of_a_plane_is_refused() {
    let app = TestApp::new().await;
    let session = app.session_with_field().await;
    let cut = json!({"cuts": [{"plane": [[0, 0, 0], [0, 0, 1], null]}]});
    assert_eq!(pointers(&app.post(&format!("{session}/osteotomies"), cut).await), ["/cuts/0/plane"]);
}
