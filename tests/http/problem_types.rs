//! Problems that no other test provokes, and a check that every problem type has a test.

use std::path::Path;

use prosopon_contract::Halt;
use prosopon_field::FieldError;
use prosopon_planning::plan::PlanError;
use prosopon_tissue::fem::SolveError;
use serde_json::json;

use crate::support::app::TestApp;

#[tokio::test]
async fn each_refusal_of_the_numerics_has_its_problem_type() {
    let app = TestApp::new().await;
    let plant = |halt: Halt| *app.stand_in.fails_with.lock().unwrap() = Some(halt);
    let (session, plan) = app.session_with_plan().await;

    plant(FieldError::NothingInside.into());
    app.put_json(&format!("{session}/field/settings"), json!({"spacing_mm": 3})).await.ok();
    let field = app.finish(app.post(&format!("{session}/field"), json!({})).await).await;
    assert_eq!(field["problem"]["type"], "/problems/field-not-usable", "{field}");
    app.put_json(&format!("{session}/field/settings"), json!({})).await.ok();

    plant(PlanError::NotParted { bridges: Vec::new() }.into());
    let cut = json!({"cuts": [{"plane": {"point_mm": [0, 0, 0], "normal": [0, 0, 2]}}]});
    app.post(&format!("{session}/osteotomies"), cut).await.problem(422, "bone-not-parted");

    let inverted = SolveError::Inverted { path_share: 0.5, kind: "tetrahedron", element: 3, x: 1.0, y: 2.0, z: 3.0 };
    let deep = SolveError::Penetration { path_share: 0.5, found_mm: 1.0, allowed_mm: 0.05 };
    for (error, kind) in [
        (SolveError::Problem { detail: "no node is free".to_owned() }, "/problems/scene-not-usable"),
        (inverted, "/problems/solver-inverted"),
        (deep, "/problems/solver-penetration"),
    ] {
        plant(error.into());
        let job = app.solve(&session, &plan, json!({})).await;
        let ended = app.ended(&job).await.ok();
        assert_eq!(ended["problem"]["type"], kind, "{ended}");
    }
}

/// The text of all files below a directory.
fn text_below(directory: &Path) -> String {
    let paths = std::fs::read_dir(directory).unwrap().map(|entry| entry.unwrap().path());
    paths.map(|path| if path.is_dir() { text_below(&path) } else { std::fs::read_to_string(path).unwrap() }).collect()
}

/// Every problem type must be asserted in some test.
#[test]
fn every_type_of_problem_is_provoked_by_a_test() {
    let tests = text_below(Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/http")));
    let compact: String = tests.split_whitespace().collect();
    let documented = include_str!("../../api/problems.md");
    for slug in documented.lines().filter_map(|line| line.strip_prefix("## ")) {
        // `problem(409,"stale")`, `refused(409,"stale","words")`, or a comparison with the type of a job's problem.
        let asserted = compact.match_indices(&format!(",\"{slug}\"")).any(|(at, _)| {
            let before = &compact[..at];
            let call = before.trim_end_matches(|c: char| c.is_ascii_digit());
            call.len() < before.len() && [".problem(", ".refused("].iter().any(|name| call.ends_with(name))
        });
        assert!(asserted || compact.contains(&format!("\"/problems/{slug}\"")), "no test provokes {slug}");
    }
}
