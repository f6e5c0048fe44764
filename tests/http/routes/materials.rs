use axum::body::Body;
use axum::http::Method;
use serde_json::{Value, json};

use crate::support::app::TestApp;

fn near(found: &Value, expected: f64, within: f64) {
    let found = found.as_f64().unwrap_or_else(|| panic!("no number: {found}"));
    assert!((found - expected).abs() <= within, "{found}, expected {expected}");
}

#[tokio::test]
async fn laws_and_presets_are_listed_with_units_moduli_and_stable_ranges() {
    let app = TestApp::new().await;
    let list = app.get("/v1/materials").await.ok();
    let laws: Vec<&str> = list["laws"].as_array().unwrap().iter().map(|l| l["name"].as_str().unwrap()).collect();
    assert_eq!(laws, ["neo_hookean", "mooney_rivlin", "yeoh", "ogden"]);
    assert_eq!(list["laws"][3]["constants"], json!({"alpha": "", "poisson": "", "shear_modulus_mpa": "MPa"}));
    assert!(list["volumetric_energy"].as_str().unwrap().contains("ln J"));
    let presets = list["presets"].as_array().unwrap();
    let names: Vec<&str> = presets.iter().map(|p| p["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["wang_2009_stable", "wang_2009_tension", "wang_2009", "nazari_2010", "chabanas_2003"]);
    for preset in presets {
        assert!(preset["source"].as_str().unwrap().contains("20"), "{preset}");
        assert_eq!(preset["default"], preset["name"] == "wang_2009_stable");
        assert_eq!(preset["tissues"].as_object().unwrap().len(), 5);
    }
    // Wang 2009, Table 1: shear moduli 70.142923, 41.229888, 11.776447 kPa.
    for preset in &presets[..3] {
        for (tissue, kpa) in [("skin", 70.142923), ("muscle", 41.229888), ("fat", 11.776447)] {
            near(&preset["tissues"][tissue]["moduli"]["shear_modulus_kpa"], kpa, 1e-5);
        }
    }
    let stable = &presets[0]["tissues"]["fat"];
    assert_eq!((&stable["polyconvex"], &stable["stable_range"]["planar"]), (&json!(true), &json!([0.5, 2.0])));
    let published = &presets[2]["tissues"]["fat"];
    assert_eq!(published["polyconvex"], false);
    // The incompressible limit is 1.019; with the Poisson ratio 0.49 the limit is not larger.
    let high = published["stable_range"]["uniaxial"][1].as_f64().unwrap();
    assert!((1.01..1.0187).contains(&high), "{high}");
    near(&presets[4]["tissues"]["fat"]["moduli"]["young_modulus_kpa"], 15.0, 1e-9);
    app.call(Method::DELETE, "/v1/materials", &[], Body::empty()).await.problem(405, "method-not-allowed");
}

#[tokio::test]
async fn the_reading_of_d1_changes_only_the_published_bulk_moduli() {
    let app = TestApp::new().await;
    for (reading, ratios) in [
        ("poisson_ratio", [0.49, 0.30, 0.49]),
        ("per_mpa", [0.4915, 0.4969, 0.4986]),
        ("mm2_per_gf", [-0.0531, 0.2394, 0.3660]),
    ] {
        let list = app.get(&format!("/v1/materials?d1_reading={reading}")).await.ok();
        assert_eq!(list["presets"][2]["d1_reading"], reading);
        for (tissue, ratio) in ["skin", "muscle", "fat"].into_iter().zip(ratios) {
            near(&list["presets"][2]["tissues"][tissue]["moduli"]["poisson"], ratio, 1e-4);
        }
        near(&list["presets"][0]["tissues"]["skin"]["moduli"]["poisson"], 0.49, 1e-12);
    }
    app.get("/v1/materials?d1_reading=kpa").await.problem(400, "malformed-request");
}

#[tokio::test]
async fn a_check_lists_each_loss_of_stability_with_mode_and_stretch() {
    let app = TestApp::new().await;
    let check = async |material: Value| app.post("/v1/materials/check", json!({"material": material})).await.ok();
    let good = check(json!({"law": "ogden", "shear_modulus_mpa": 0.02, "alpha": 6, "poisson": 0.45})).await;
    assert_eq!((&good["admissible"], &good["losses"], &good["polyconvex"]), (&json!(true), &json!([]), &json!(true)));
    near(&good["moduli"]["bulk_modulus_kpa"], 1e3 * 2.0 * 0.02 * 1.45 / 0.3, 1e-9);
    assert_eq!(good["tests"].as_array().unwrap().len(), 4);
    assert!(good["warning"].is_null());

    // Fat as published, nearly incompressible; the reference is an independent table.
    let (c10, c01) = (16.6131140 * 9.80665e-3, -16.0126823 * 9.80665e-3);
    let bad = check(json!({"law": "mooney_rivlin", "c10_mpa": c10, "c01_mpa": c01, "poisson": 0.4999})).await;
    assert_eq!(bad["admissible"], false);
    assert!(bad["warning"]["message"].as_str().unwrap().contains("is stable only"));
    let at = |criterion: &str, mode: &str| {
        let losses = bad["losses"].as_array().unwrap().iter();
        let of = losses.filter(|l| l["criterion"] == criterion && l["mode"] == mode);
        let mut stretches: Vec<f64> = of.map(|l| l["stretch"].as_f64().unwrap()).collect();
        stretches.sort_by(f64::total_cmp);
        stretches
    };
    for (criterion, mode, expected) in [
        ("strong_ellipticity", "uniaxial", vec![0.9638, 1.0186]),
        ("strong_ellipticity", "planar", vec![0.9817, 1.0186]),
        ("strong_ellipticity", "shear", vec![1.0186 - 1.0 / 1.0186]),
        ("drucker", "uniaxial", vec![0.9817, 1.0186]),
        ("stress_sign", "uniaxial", vec![0.9638]),
        ("rising_stress", "uniaxial", vec![0.9815]),
        ("stress_sign", "planar", vec![]),
    ] {
        let found = at(criterion, mode);
        // Samples are 1e-3 apart; at this Poisson ratio ellipticity is lost a little earlier.
        let close = found.len() == expected.len() && found.iter().zip(&expected).all(|(f, e)| (f - e).abs() < 2e-3);
        assert!(close, "{criterion} {mode}: {found:?} {expected:?}");
    }
    // The stretch nearest to rest comes first.
    let first = bad["losses"][0]["stretch"].as_f64().unwrap();
    assert!((first - 1.0).abs() < 0.02, "{}", bad["losses"][0]);
}

#[tokio::test]
async fn invalid_materials_are_refused_with_their_pointer() {
    let app = TestApp::new().await;
    let refused = async |material: Value, pointer: &str| {
        let body = json!({"material": material});
        let problem = app.post("/v1/materials/check", body).await.problem(422, "invalid-request");
        assert_eq!(problem["errors"][0]["pointer"], pointer, "{problem}");
    };
    refused(json!({"law": "neo_hookean", "shear_modulus_mpa": 0.07, "poisson": 0.5}), "/material/poisson").await;
    refused(json!({"law": "neo_hookean", "shear_modulus_mpa": -1, "poisson": 0.4}), "/material").await;
    refused(json!({"law": "ogden", "shear_modulus_mpa": 0.07, "alpha": 0, "poisson": 0.4}), "/material/alpha").await;
    refused(json!({"law": "yeoh", "poisson": 0.4}), "/material").await;
    refused(json!({"law": "yeoh", "c1_mpa": "x", "poisson": 0.4}), "/material/c1_mpa").await;
    refused(json!({"law": "yeoh", "c1_mpa": 1, "c9_mpa": 1, "poisson": 0.4}), "/material/c9_mpa").await;
    refused(json!(["neo_hookean", 0.4, 0.07]), "/material").await;
    app.post("/v1/materials/check", json!({})).await.problem(422, "invalid-request");
}
