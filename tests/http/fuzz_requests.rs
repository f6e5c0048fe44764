//! Randomly damaged request bodies: each is answered, refusals are problems, and none is an internal error.

use std::time::{Duration, Instant};

use axum::http::StatusCode;
use serde_json::{Value, json};

use crate::api_examples::examples;
use crate::support::app::{Answer, TestApp};

/// Pseudo-random numbers, the same in every run.
struct Dice(u64);

impl Dice {
    fn below(&mut self, n: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 33) as usize) % n.max(1)
    }
}

fn odd_value(dice: &mut Dice) -> Value {
    let deep = |n: usize| (0..n).fold(json!(1), |inner, _| json!([inner]));
    match dice.below(22) {
        0 => Value::Null,
        1 => json!(true),
        2 => json!(0),
        3 => json!(-1),
        4 => json!(u64::MAX),
        5 => json!(i64::MIN),
        6 => json!(1e308),
        7 => json!(-1e308),
        8 => json!(5e-324),
        9 => json!(0.1),
        10 => json!(""),
        11 => json!("x".repeat(5000)),
        12 => json!("\u{0}\u{feff}\u{202e}\"'<>&%00../../"),
        13 => json!([]),
        14 => json!({}),
        15 => json!([[1, 2, 3], [4, 5, 6]]),
        16 => json!(vec![0.5; 3000]),
        17 => json!({"": {"~/": 1}}),
        18 => deep(100),
        19 => json!("00000000-0000-0000-0000-000000000000"),
        20 => json!([1e308, -1e308, 1e308]),
        _ => json!([0, 0, 0]),
    }
}

/// Changes one member of a value.
fn change(value: &mut Value, dice: &mut Dice) {
    let descend = dice.below(4) > 0;
    match value {
        Value::Object(members) if descend && !members.is_empty() => {
            let name = members.keys().nth(dice.below(members.len())).unwrap().clone();
            match dice.below(8) {
                0 => drop(members.remove(&name)),
                1 => drop(members.insert(format!("{name}_"), odd_value(dice))),
                _ => change(members.get_mut(&name).unwrap(), dice),
            }
        }
        Value::Array(items) if descend && !items.is_empty() => {
            let at = dice.below(items.len());
            match dice.below(8) {
                0 => drop(items.remove(at)),
                1 => items.extend(std::iter::repeat_n(items[at].clone(), 1 + dice.below(300))),
                _ => change(&mut items[at], dice),
            }
        }
        Value::Number(_) if dice.below(2) == 0 => {
            let scale = [0.0, -1.0, 1e-3, 1e3, 1e9, 1e300][dice.below(6)];
            *value = json!(value.as_f64().unwrap() * scale);
        }
        Value::Null | Value::Bool(_) | Value::Number(_) | Value::String(_) | Value::Array(_) | Value::Object(_) => {
            *value = odd_value(dice);
        }
    }
}

/// Damages the text in ways that are not valid JSON.
fn damage(text: &mut Vec<u8>, dice: &mut Dice) {
    let at = dice.below(text.len());
    match dice.below(6) {
        0 => text.truncate(at),
        1 => text[at] = b"{}[]\",:0\\\xff"[dice.below(10)],
        2 => drop(text.splice(at..at, b"\"points\":1,".iter().copied())),
        3 => drop(text.splice(at..at, std::iter::repeat_n(b'[', 5000))),
        4 => {
            let piece = text[at..(at + 40).min(text.len())].to_vec();
            text.splice(at..at, piece);
        }
        _ => text.extend(b" x"),
    }
}

fn check(answer: &Answer, request: &str) {
    let status = answer.status;
    assert!(status.as_u16() < 500, "{status} to {request}: {}", String::from_utf8_lossy(&answer.body));
    if status.is_client_error() {
        assert_eq!(answer.header("content-type"), "application/problem+json", "{request}");
        let problem = answer.json();
        assert_eq!(problem["status"], status.as_u16(), "{request}");
        assert!(problem["detail"].as_str().unwrap().len() < 600, "a long echo: {problem}");
        for error in problem["errors"].as_array().into_iter().flatten() {
            let pointer = error["pointer"].as_str().unwrap();
            assert!(pointer.is_empty() || pointer.starts_with('/'), "{problem}");
        }
    } else {
        assert_ne!(status, StatusCode::NO_CONTENT, "{request}");
        answer.json();
    }
}

/// Runs for `FUZZ_SECONDS` (default 3), with at least one round of every example.
#[tokio::test]
async fn damaged_bodies_never_cause_an_internal_error() {
    let app = TestApp::with(|config| {
        config.service.max_waiting = 1_000_000;
        config.service.max_waiting_tenant = 1_000_000;
    })
    .await;
    let examples = examples(&app).await;
    let seconds = std::env::var("FUZZ_SECONDS").ok().and_then(|s| s.parse().ok()).unwrap_or(3);
    let end = Instant::now() + Duration::from_secs(seconds);
    let mut dice = Dice(11);
    let (mut sent, mut refused) = (0usize, 0usize);
    while sent < 20 * examples.len() || Instant::now() < end {
        let example = &examples[sent % examples.len()];
        let mut body = example.body.clone();
        for _ in 0..=dice.below(3) {
            change(&mut body, &mut dice);
        }
        let mut text = body.to_string().into_bytes();
        if dice.below(4) == 0 {
            damage(&mut text, &mut dice);
        }
        let request =
            format!("{} {}: {}", example.method, example.path, String::from_utf8_lossy(&text[..text.len().min(2000)]));
        let answer =
            app.call(example.method.clone(), &example.path, &[("content-type", "application/json")], text).await;
        check(&answer, &request);
        sent += 1;
        refused += usize::from(answer.status.is_client_error());
    }
    eprintln!("{sent} bodies, {refused} refused");
    assert!(refused > sent / 2 && refused < sent, "{refused} of {sent}");
}
