use std::io::Write;

use indicatif::{MultiProgress, ProgressBar, ProgressStyle};
use serde_json::{Value, json};

use super::client::Client;
use super::output::{before_after, write};
use super::patient::Patient;
use super::{DemoArgs, DemoError};
use prosopon_study::read_ct;

/// Runs the main job on the service at `base` (`http://host:port`) and writes the results.
///
/// # Errors
/// [`DemoError`]; results written before the error remain.
pub fn run(args: &DemoArgs, base: String) -> Result<(), DemoError> {
    let patient = Patient::of(args)?;
    let client = Client::new(base);
    let bars = MultiProgress::new();
    let case = Case { args, client: &client, bars: &bars, session: open_session(&client)? };
    case.upload(&patient)?;
    case.wait_for("field", &case.post("field", &json!({}))?)?;
    let cut = case.osteotomy()?;
    let mouth = if args.part_lips { "auto" } else { "glued" };
    let mut mesh = json!({ "osteotomy": cut.osteotomy, "mouth": mouth });
    if let Some(edge_mm) = args.edge_mm {
        mesh["edge_mm"] = json!(edge_mm);
    }
    case.wait_for("mesh", &case.post("mesh", &mesh)?)?;
    let plan = case.plan(&cut)?;
    let job = case.solve(&plan, &args.model, None)?;
    let report_path = format!("/v1/jobs/{job}/report");
    write(&args.out, "report.json", &client.download(&report_path)?)?;
    write(&args.out, "profile.svg", &client.download(&format!("/v1/jobs/{job}/profile.svg"))?)?;
    // Not the session's skin: parted lips add vertices to that of the solve.
    let [before, after] =
        [0, args.steps].map(|k| client.download(&format!("/v1/jobs/{job}/steps/{k}/skin?format=ply")));
    let (before, after) = (before?, after?);
    before_after(&args.out, &before, &after)?;
    if !args.no_compare {
        let linear = case.solve(&plan, "linear", Some(&job))?;
        case.error_map(&linear)?;
    }
    say(&bars, &format!("results are in {}", args.out.display()));
    Ok(())
}

/// Prints a line; hidden progress bars, as in a log file, would swallow it, so it then goes to stderr.
fn say(bars: &MultiProgress, line: &str) {
    if bars.is_hidden() {
        writeln!(std::io::stderr(), "{line}").ok();
    } else {
        bars.println(line).ok();
    }
}

fn open_session(client: &Client) -> Result<String, DemoError> {
    let path = "/v1/sessions";
    text(&client.post(path, &json!({ "label": "demo" }))?, "id", path)
}

fn text(answer: &Value, field: &'static str, path: &str) -> Result<String, DemoError> {
    let found = answer[field].as_str().map(str::to_owned);
    found.ok_or_else(|| DemoError::Answer { path: path.to_owned(), field })
}

struct Case<'a> {
    args: &'a DemoArgs,
    client: &'a Client,
    bars: &'a MultiProgress,
    session: String,
}

/// The segment that the demo moves.
struct Cut {
    osteotomy: String,
    segment: u64,
    centroid: Value,
}

impl Case<'_> {
    fn path(&self, rest: &str) -> String {
        format!("/v1/sessions/{}/{rest}", self.session)
    }

    fn post(&self, rest: &str, body: &Value) -> Result<Value, DemoError> {
        self.client.post(&self.path(rest), body)
    }

    fn say(&self, line: &str) {
        say(self.bars, line);
    }

    /// Prints the warnings of an answer that is not a job.
    fn warn(&self, name: &str, answer: &Value) {
        for warning in answer["warnings"].as_array().into_iter().flatten() {
            self.say(&format!("{name}: {}", finding(warning)));
        }
    }

    fn upload(&self, patient: &Patient) -> Result<(), DemoError> {
        if let Some(ct) = &patient.ct {
            // A folder of DICOM images is uploaded as one archive.
            let path = self.path("ct");
            let import = if ct.is_dir() {
                self.client.upload_bytes(&path, &read_ct(ct)?)?
            } else {
                self.client.upload(&path, ct)?
            };
            self.wait_for("import", &import)?;
        }
        if let Some((skin, skull)) = &patient.surfaces {
            for (name, file) in [("skin", skin), ("skull", skull)] {
                let report = self.client.upload(&self.path(name), file)?;
                self.say(&format!("{name}: {} triangles, {} parts", report["triangles"], report["components"]));
                self.warn(name, &report);
            }
        }
        if let Some(landmarks) = &patient.landmarks {
            self.client.put(&self.path("landmarks"), landmarks)?;
        }
        Ok(())
    }

    fn osteotomy(&self) -> Result<Cut, DemoError> {
        let path = self.path("osteotomies");
        let answer = self.client.post(&path, &json!({ "template": { "name": "le_fort_1" } }))?;
        self.warn("cut", &answer);
        let segments = answer["segments"].as_array().cloned().unwrap_or_default();
        for segment in &segments {
            let cm3 = segment["volume_mm3"].as_f64().unwrap_or_default() / 1e3;
            self.say(&format!("segment {}: {cm3:.1} cm3, {} triangles", segment["id"], segment["triangles"]));
        }
        // The template's first cut is the Le Fort I plane; a lower jaw that was connected at the teeth is not bounded by it.
        let upper_jaw =
            |s: &&Value| s["id"] != 0 && s["bounded_by"].as_array().is_some_and(|cuts| cuts.contains(&json!(0)));
        let moving = segments.iter().find(upper_jaw);
        let lacks = || DemoError::Answer { path: path.clone(), field: "segments" };
        let segment = moving.and_then(|s| s["id"].as_u64()).ok_or_else(lacks)?;
        let centroid = moving.map(|s| s["centroid_mm"].clone()).unwrap_or_default();
        Ok(Cut { osteotomy: text(&answer, "id", &path)?, segment, centroid })
    }

    fn plan(&self, cut: &Cut) -> Result<String, DemoError> {
        let path = self.path("plans");
        // Forward and down as the head lies.
        let frame_path = self.path("frame");
        let frame = self.client.get(&frame_path)?;
        let axis = |name: &'static str| {
            let missing = DemoError::Answer { path: frame_path.clone(), field: name };
            serde_json::from_value::<[f64; 3]>(frame[name].clone()).map_err(|_| missing)
        };
        let (back, up) = (axis("back")?, axis("up")?);
        let by = [0, 1, 2].map(|k| -self.args.forward_mm * back[k] - self.args.down_mm * up[k]);
        let end = json!({ "t": 1.0, "translation_mm": by });
        let body = json!({
            "osteotomy": cut.osteotomy,
            "paths": [{ "segment": cut.segment, "waypoints": [end] }],
        });
        let answer = self.client.post(&path, &body)?;
        self.say(&format!(
            "plan: segment {} at {} moves forward {} mm and down {} mm",
            cut.segment, cut.centroid, self.args.forward_mm, self.args.down_mm
        ));
        text(&answer, "id", &path)
    }

    /// Runs a solver job; without a reference, downloads every step as soon as it is solved.
    fn solve(&self, plan: &str, model: &str, reference: Option<&str>) -> Result<String, DemoError> {
        let mut body = json!({ "plan": plan, "model": model, "steps": self.args.steps });
        if let Some(reference) = reference {
            body["reference_job"] = json!(reference);
        }
        let answer = self.post("jobs", &body)?;
        let job = text(&answer, "id", "jobs")?;
        let bar = self.bar(&format!("solve ({model})"));
        self.follow("solve", &job, &bar, &mut |k| {
            if reference.is_some() {
                return Ok(());
            }
            for format in ["glb", "ply"] {
                let path = format!("/v1/jobs/{job}/steps/{k}/skin?format={format}");
                let bytes = self.client.download(&path)?;
                write(&self.args.out, &format!("steps/{k:02}.{format}"), &bytes)?;
            }
            Ok(())
        })?;
        Ok(job)
    }

    fn error_map(&self, job: &str) -> Result<(), DemoError> {
        let step = format!("/v1/jobs/{job}/steps/{}", self.args.steps);
        write(&self.args.out, "error.png", &self.client.download(&format!("{step}/error.png"))?)?;
        write(&self.args.out, "error.json", &self.client.download(&format!("{step}/error"))?)
    }

    fn bar(&self, name: &str) -> ProgressBar {
        let style = ProgressStyle::with_template("{prefix:16} [{bar:40}] {percent:>3} % {elapsed} {msg}");
        let bar = self.bars.add(ProgressBar::new(1000));
        if let Ok(style) = style {
            bar.set_style(style.progress_chars("=> "));
        }
        bar.set_prefix(name.to_owned());
        bar
    }

    fn wait_for(&self, kind: &'static str, accepted: &Value) -> Result<(), DemoError> {
        let job = text(accepted, "id", kind)?;
        self.follow(kind, &job, &self.bar(kind), &mut |_| Ok(()))
    }

    /// Follows a job's events to its end.
    fn follow(
        &self,
        kind: &'static str,
        job: &str,
        bar: &ProgressBar,
        on_step: &mut dyn FnMut(u64) -> Result<(), DemoError>,
    ) -> Result<(), DemoError> {
        let (mut ended, mut last) = (false, 0);
        while !ended {
            self.client.events(job, &mut last, &mut |event, data| {
                match event {
                    "progress" => bar.set_position((1000.0 * data["progress"].as_f64().unwrap_or_default()) as u64),
                    "step" => on_step(data["k"].as_u64().unwrap_or_default())?,
                    "warning" => self.say(&format!("{kind}: {}", finding(data))),
                    "end" => ended = true,
                    _ => {}
                }
                Ok(!ended)
            })?;
        }
        let view = self.client.get(&format!("/v1/jobs/{job}"))?;
        let status = view["status"].as_str().unwrap_or_default();
        if status != "succeeded" {
            bar.abandon();
            let detail = view["problem"]["detail"].as_str().unwrap_or("no reason given").to_owned();
            return Err(DemoError::Job { kind, status: status.to_owned(), detail });
        }
        bar.set_position(1000);
        bar.finish();
        if bar.is_hidden() {
            self.say(&format!("{}: done in {:.1} s", bar.prefix(), bar.elapsed().as_secs_f64()));
        }
        Ok(())
    }
}
/// Message and action of a warning.
fn finding(warning: &Value) -> String {
    let [message, action] = ["message", "action"].map(|name| warning[name].as_str().unwrap_or_default());
    if action.is_empty() { message.to_owned() } else { format!("{message}. {action}") }
}
