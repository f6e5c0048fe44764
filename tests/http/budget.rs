//! Budgets of `auto`, with the real numerics on a phantom.

use serde_json::{Value, json};

use crate::support::binary::Server;

fn report(server: &Server, session: &str, plan: &Value, solve: Value) -> Value {
    let mut request = solve;
    request["plan"] = plan.clone();
    let job = server.finish(&server.post(&format!("{session}/jobs"), &request));
    server.get(&format!("/v1/jobs/{}/report", job["id"].as_str().unwrap())).ok()
}

fn planned(server: &Server, session: &str, forward_mm: f64) -> (Value, Value) {
    let (osteotomy, jaw) = server.cut(session);
    let waypoints = json!([{ "t": 1, "translation_mm": [0, -forward_mm, 0] }]);
    let plan = json!({ "osteotomy": osteotomy, "paths": [{ "segment": jaw, "waypoints": waypoints }] });
    (osteotomy, server.post(&format!("{session}/plans"), &plan).ok()["id"].clone())
}

/// With a generous error the fastest setting is chosen and its error estimated; a mesh that is named stays; a time that was not
/// kept is reported.
#[test]
fn a_budget_chooses_estimates_and_says_what_it_missed() {
    let directory = tempfile::tempdir().unwrap();
    let server = Server::start(directory.path(), &[]);
    let session = server.session_with_field();
    let (osteotomy, plan) = planned(&server, &session, 4.0);

    let loose = json!({ "plan": plan, "steps": 2, "budget": { "max_error_mm": 10 } });
    let accepted = server.post(&format!("{session}/jobs"), &loose);
    let job = server.finish(&accepted);
    let loose = server.get(&format!("/v1/jobs/{}/report", job["id"].as_str().unwrap())).ok();
    let budget = &loose["budget"];
    // The choice is known before the solve.
    for early in [&accepted.ok()["budget"], &job["budget"]] {
        assert_eq!(
            [&early["chosen"], &early["expected"], &early["why"]],
            ["chosen", "expected", "why"].map(|n| &budget[n])
        );
        assert!(early.get("estimated").is_none() && early.get("within_s").is_none(), "{early}");
    }
    assert_eq!(budget["chosen"]["edge_mm"], loose["mesh"]["settings"]["edge_mm"], "{budget}");
    assert_eq!(budget["chosen"]["locking"], loose["parameters"]["locking"], "{budget}");
    let at = |pointer: &str| budget.pointer(pointer).and_then(Value::as_f64).unwrap();
    assert_eq!(at("/estimated/edge_mm"), 1.25 * at("/chosen/edge_mm"));
    assert!(at("/estimated/error_mm") > 0.0 && at("/estimated/error_mm") < 4.0, "{budget}");
    for other in budget["alternatives"].as_array().unwrap() {
        let [slower, better] = ["wall_s", "error_mm"].map(|name| {
            let expected = &other["expected"][name];
            (expected.as_f64().unwrap(), budget["expected"][name].as_f64().unwrap())
        });
        assert!(slower.0 > slower.1 && better.0 < better.1, "{other}");
    }
    let codes = |report: &Value| report["warnings"].to_string();
    assert!(!codes(&loose).contains("budget-missed") && !codes(&loose).contains("error-not-estimated"));

    // The mesh of before is built, so that the job itself names it.
    let mesh =
        server.finish(&server.post(&format!("{session}/mesh"), &json!({ "osteotomy": osteotomy, "edge_mm": 8 })));
    let hasty = json!({ "steps": 2, "mesh": mesh["id"], "locking": "none", "attachment": { "tie_gap_mm": 2 }, "budget": { "max_wall_s": 1 } });
    let hasty = report(&server, &session, &plan, hasty);
    assert_eq!(hasty["budget"]["chosen"]["edge_mm"], 8.0);
    assert_eq!(hasty["budget"]["alternatives"], json!([]));
    assert_eq!(hasty["budget"]["within_s"], 1.0);
    assert!(codes(&hasty).contains("budget-not-studied") && !codes(&loose).contains("budget-not-studied"));
    // Its estimate's mesh is deep enough for edges of 10 mm, and comes on top of the time.
    assert_eq!(hasty["budget"]["estimated"]["edge_mm"], 10.0, "{}", hasty["budget"]);
    let [spent, solve] = [&hasty["budget"]["spent_s"], &hasty["phases"]["solve_s"]].map(|s| s.as_f64().unwrap());
    assert!(spent >= solve, "{}", hasty["budget"]);
    assert_eq!(codes(&hasty).contains("budget-missed"), spent > 1.0, "{}", codes(&hasty));
    assert!(hasty["notes"].to_string().contains("budget-ended"), "{}", hasty["notes"]);

    // The named mesh is stored, so a restart does not make it dearer.
    let again = json!({ "plan": plan, "mesh": mesh["id"], "budget": { "max_error_mm": 10, "go_on": false } });
    let expected = |server: &Server| {
        let job = server.post(&format!("{session}/jobs"), &again);
        server.finish(&job);
        job.ok()["budget"]["expected"]["wall_s"].as_f64().unwrap()
    };
    let before = expected(&server);
    drop(server);
    let server = Server::start(directory.path(), &[]);
    assert_eq!(expected(&server), before);
}

/// With an error between what the table promises for the first setting and what that setting is found to have, the first job
/// misses it and another one follows.
#[test]
fn a_job_that_missed_its_error_is_continued() {
    let directory = tempfile::tempdir().unwrap();
    let server = Server::start(directory.path(), &[]);
    let session = server.session_with_field();
    // On the lattice along the phantom's own axes the promise is missed.
    let axes = json!({ "left": [1, 0, 0], "back": [0, 1, 0], "up": [0, 0, 1], "origin_mm": [0, 0, 0] });
    server.put_json(&format!("{session}/frame"), &axes).ok();
    server.finish(&server.post(&format!("{session}/field"), &json!({})));
    let (_, plan) = planned(&server, &session, 1.0);
    let number = |value: &Value| value.as_f64().unwrap();
    let solve = |budget: Value| {
        let request = json!({ "plan": plan, "steps": 1, "locking": "none", "budget": budget });
        server.finish(&server.post(&format!("{session}/jobs"), &request))
    };
    let budget_of =
        |job: &Value| server.get(&format!("/v1/jobs/{}/report", job["id"].as_str().unwrap())).ok()["budget"].clone();
    let loose = budget_of(&solve(json!({ "max_error_mm": 10 })));
    let (promised, found) = (number(&loose["expected"]["error_at_most_mm"]), number(&loose["estimated"]["error_mm"]));
    assert!(promised < found, "the scene no longer misses what is promised: {loose}");
    let asked = 0.5 * (promised + found);

    let stopped = solve(json!({ "max_error_mm": asked, "go_on": false }));
    assert_eq!((stopped.get("continued_by"), budget_of(&stopped).get("continued_by")), (None, None));

    let mut job = solve(json!({ "max_error_mm": asked }));
    let mut budget = budget_of(&job);
    assert_eq!(
        (&budget["chosen"], &budget["estimated"]["error_mm"]),
        (&loose["chosen"], &loose["estimated"]["error_mm"])
    );
    let mut jobs = vec![job["id"].clone()];
    while let Some(next) = job.get("continued_by").cloned() {
        assert_eq!(budget["continued_by"], next);
        assert!(number(&budget["estimated"]["error_mm"]) > asked);
        let begun = server.get(&format!("/v1/jobs/{}", next.as_str().unwrap()));
        assert_eq!(begun.ok()["continues"], job["id"]);
        job = server.finish(&begun);
        let before = std::mem::replace(&mut budget, budget_of(&job));
        let tried: Vec<&Value> = budget["tried"].as_array().unwrap().iter().map(|tried| &tried["job"]).collect();
        assert_eq!(tried, jobs.iter().collect::<Vec<_>>());
        assert!(number(&budget["expected"]["error_mm"]) < number(&before["estimated"]["error_mm"]), "{budget}");
        assert_ne!(budget["chosen"], before["chosen"]);
        jobs.push(next);
        assert!(jobs.len() < 8, "{jobs:?}");
    }
    assert!(jobs.len() > 1, "{job}");
    let last = server.get(&format!("/v1/jobs/{}/report", job["id"].as_str().unwrap())).ok();
    let missed = number(&budget["estimated"]["error_mm"]) > asked;
    assert_eq!(last["notes"].to_string().contains("budget-ended"), missed, "{last}");
    let late = server.post(&format!("/v1/jobs/{}/cancel", jobs[0].as_str().unwrap()), &json!({}));
    assert_eq!(late.refused(409, "wrong-state", "cancel that one")["continued_by"], jobs[1]);
    let events = server.get_lines(&format!("/v1/jobs/{}/events", jobs[0].as_str().unwrap()));
    assert_eq!(events.last().unwrap()["data"].get("continued_by"), jobs.get(1), "{events:?}");
}
