use serde_json::{Value, json};

use crate::support::app::{TestApp, pointers};
use crate::support::boxes::{scene, solved};

#[tokio::test]
async fn the_report_of_the_last_build_is_returned() {
    let app = TestApp::new().await;
    let session = app.session_with_field().await;
    let path = format!("{session}/mesh");
    let before = app.get(&path).await.ok();
    assert_eq!((&before["state"], &before["report"]), (&json!("missing"), &json!(null)));
    let job = app.finish(app.post(&path, json!({"edge_mm": 5})).await).await;
    assert_eq!(job["status"], "succeeded", "{job}");
    let built = app.get(&path).await.ok();
    assert_eq!((&built["state"], &built["report"]["settings"]["edge_mm"]), (&json!("ready"), &json!(5.0)));
    assert_eq!(built["report"]["tetrahedra"], 60_000);
}

#[tokio::test]
async fn invalid_mesh_settings_are_refused_with_their_pointer() {
    let app = TestApp::new().await;
    let session = app.session_with_field().await;
    let region = json!({"region": [[0, 0, 0], [50, 50, 50]]});
    assert_eq!(pointers(&app.post(&format!("{session}/mesh"), region).await), ["/region"]);
    let shallow = json!({"edge_mm": 20, "depth_mm": 40, "skin_thickness_mm": 10});
    assert_eq!(pointers(&app.post(&format!("{session}/mesh"), shallow).await), ["/depth_mm"]);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_mesh_that_lacks_moving_bone_gives_a_warning() {
    let app = TestApp::real().await;
    let (session, osteotomy) = scene(&app).await;
    let lacking = async |more: Value| {
        let job = solved(&app, &session, &osteotomy, 1.0, more).await;
        let warnings = app.get(&job).await.ok()["warnings"].to_string();
        warnings.contains("lacks").then_some(warnings)
    };
    let linear = json!({"model": "linear", "steps": 1});
    assert_eq!(lacking(linear.clone()).await, None, "its own mesh");
    // The skull is a box from -60 to 60 mm; its lower half moves.
    let region = json!({"min_mm": [-110, -110, -110], "max_mm": [30, 110, 110]});
    let settings = json!({"edge_mm": 15, "depth_mm": 60, "skin_thickness_mm": 4, "region": region});
    let mesh = app.finish(app.post(&format!("{session}/mesh"), settings).await).await;
    assert_eq!(mesh["status"], "succeeded", "{mesh}");
    let warning = lacking(linear).await.unwrap();
    assert!(warning.contains("its region lacks 30 mm on the patient's left of the moving bone"), "{warning}");
}
