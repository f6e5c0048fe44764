//! Random cuts and random paths on a skull: each result must be correct or refused with a reason.

use std::collections::BTreeMap;
use std::io::Write;
use std::path::Path;
use std::time::Instant;

use super::error::{BenchError, write};
use super::files::{read_landmarks, read_surface, refuse_unwritable};
use prosopon_field::{Envelope, EnvelopeSettings, envelope};
use prosopon_geometry::control::Control;
use prosopon_geometry::{Motion, Point, TopologyFaults, TriMesh, Vector};
use prosopon_planning::plan::{
    BoundedPlane, Cut, CutShape, Landmarks, Osteotomy, Path as BonePath, Plan, PlanError, Template, cut, follow,
};

/// Largest relative difference between the volume of the bone and the sum of segments and dropped fragments.
const VOLUME_TOLERANCE: f64 = 5e-3;
/// Largest distance of a segment's vertices outside the bone, in grid spacings; corners between cuts are exact to half a spacing.
const INTRUSION: f64 = 1.0;

/// Applies random cuts to a skull, moves segments on random paths, and checks each result.
#[derive(Debug)]
pub struct CutStudy<'a> {
    /// Surface of the skull.
    pub skull: &'a Path,
    /// Landmarks for templates; without them only free cuts are tried.
    pub landmarks: Option<&'a Path>,
    /// Number of cuts, and number of paths.
    pub count: usize,
    /// Seed of the random numbers.
    pub seed: u64,
    /// CSV file to write.
    pub csv: &'a Path,
}

/// SplitMix64 (Steele, Lea & Flood 2014).
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// Uniform in [-1, 1).
    fn unit(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * 0.5 * (self.unit() + 1.0)
    }

    fn below(&mut self, n: usize) -> usize {
        (self.next() % n.max(1) as u64) as usize
    }

    fn direction(&mut self) -> Vector {
        loop {
            let v = Vector::new(self.unit(), self.unit(), self.unit());
            if (0.01..1.0).contains(&v.norm_squared()) {
                return v.normalize();
            }
        }
    }
}

/// Result of one case.
struct Row {
    kind: String,
    outcome: String,
    segments: usize,
    volume_error: f64,
    wall_s: f64,
    wrong: Option<String>,
    detail: String,
}

impl CutStudy<'_> {
    /// Runs the study and prints to `out`; returns whether no result is wrong.
    ///
    /// # Errors
    /// [`BenchError`].
    pub fn run(&self, out: &mut dyn Write) -> Result<bool, BenchError> {
        refuse_unwritable(self.csv)?;
        let skull = read_surface(self.skull)?;
        let landmarks = self.landmarks.map(read_landmarks).transpose()?;
        let bone = envelope(&skull, &EnvelopeSettings::default(), &Control::new())
            .map_err(|source| BenchError::Field { method: "envelope", source })?;
        let rows = rows(&bone, landmarks.as_ref(), self.count, self.seed);
        let mut csv = String::from("case,kind,outcome,segments,volume_error,wall_s,wrong,detail\n");
        for (i, r) in rows.iter().enumerate() {
            let wrong = r.wrong.clone().unwrap_or_default();
            let quoted = r.detail.replace('"', "'");
            csv += &format!(
                "{i},{},{},{},{:.2e},{:.3},{wrong},\"{quoted}\"\n",
                r.kind, r.outcome, r.segments, r.volume_error, r.wall_s
            );
        }
        write(self.csv, csv.as_bytes())?;
        let mut outcomes: BTreeMap<(&str, &str), (usize, f64)> = BTreeMap::new();
        for r in &rows {
            let family = if r.kind.starts_with("path") { "paths" } else { "cuts" };
            let entry = outcomes.entry((family, &r.outcome)).or_default();
            *entry = (entry.0 + 1, entry.1.max(r.wall_s));
        }
        for ((family, outcome), (count, slowest)) in outcomes {
            writeln!(out, "{family}: {count} {outcome}, the slowest in {slowest:.2} s")?;
        }
        let worst = rows.iter().map(|r| r.volume_error).fold(0.0, f64::max);
        let wrong = rows.iter().filter(|r| r.wrong.is_some()).count();
        writeln!(out, "volumes add up to within {:.3} %; {wrong} wrong results", 100.0 * worst)?;
        Ok(wrong == 0)
    }
}

/// Runs `count` cuts, then `count` paths on the resulting osteotomies.
fn rows(bone: &Envelope, landmarks: Option<&Landmarks>, count: usize, seed: u64) -> Vec<Row> {
    let mut random = Random(seed);
    let mut rows = Vec::new();
    let mut made: Vec<Osteotomy> = Vec::new();
    for _ in 0..count {
        let (kind, cuts) = random_cuts(&mut random, bone, landmarks);
        let started = Instant::now();
        let done = cuts.and_then(|cuts| cut(bone, &cuts, &Control::new()));
        let wall_s = started.elapsed().as_secs_f64();
        rows.push(judge(kind, bone, &done, wall_s));
        // The paths use up to twelve of the osteotomies.
        made.extend(done.ok().filter(|_| made.len() < 12));
    }
    for _ in 0..if made.is_empty() { 0 } else { count } {
        let osteotomy = &made[random.below(made.len())];
        rows.push(random_path(&mut random, osteotomy));
    }
    rows
}

/// A random vertex of the bone's surface.
fn somewhere(random: &mut Random, bone: &Envelope) -> Point {
    let points = bone.surface.positions();
    points[random.below(points.len())]
}

fn random_cuts(
    random: &mut Random,
    bone: &Envelope,
    landmarks: Option<&Landmarks>,
) -> (String, Result<Vec<Cut>, PlanError>) {
    let kerf = |random: &mut Random| if random.below(3) == 0 { random.between(0.0, 2.0) } else { 0.0 };
    if let Some(landmarks) = landmarks.filter(|_| random.below(4) == 0) {
        let template = Template::ALL[random.below(Template::ALL.len())];
        let mut shaken = landmarks.clone();
        for p in shaken.points.values_mut() {
            *p += random.direction() * random.between(0.0, 3.0);
        }
        let kerf_mm = kerf(random);
        let cuts = template.cuts(&shaken, bone).map(|cuts| {
            let sawn = |c: Cut| if matches!(c.shape, CutShape::FreePart(_)) { c } else { Cut { kerf_mm, ..c } };
            cuts.into_iter().map(sawn).collect()
        });
        return (format!("template {}", template.name()), cuts);
    }
    let n = 1 + random.below(3);
    let mut kinds = Vec::new();
    let mut cuts = Vec::new();
    for _ in 0..n {
        let at = somewhere(random, bone) + random.direction() * random.between(0.0, 15.0);
        let (name, shape) = match random.below(4) {
            0 => ("endless", CutShape::Plane(BoundedPlane { point: at, normal: random.direction(), bounds: None })),
            1 => {
                let normal = random.direction();
                let along = normal.cross(&random.direction()).normalize();
                let bounds = Some((along, random.between(5.0, 90.0), random.between(5.0, 90.0)));
                ("rectangle", CutShape::Plane(BoundedPlane { point: at, normal, bounds }))
            }
            2 => {
                let direction = random.direction();
                let across = direction.cross(&random.direction()).normalize();
                let turn = direction.cross(&across);
                let start = at - direction * random.between(10.0, 60.0) - across * random.between(10.0, 80.0);
                let mut points = vec![start];
                for i in 1..2 + random.below(6) {
                    // Most lines advance; some turn back and cross themselves.
                    let step = across * random.between(-4.0, 30.0) + turn * random.between(-15.0, 15.0);
                    points.push(points[i - 1] + step);
                }
                ("polyline", CutShape::Polyline { points, direction, depth_mm: random.between(5.0, 160.0) })
            }
            _ => ("surface", CutShape::Surface(wavy(random, at))),
        };
        kinds.push(name);
        cuts.push(Cut { kerf_mm: kerf(random), ..shape.into() });
    }
    (kinds.join(" + "), Ok(cuts))
}

/// A wavy sheet of triangles centred at `at`; about one triangle in seven has reversed orientation.
fn wavy(random: &mut Random, at: Point) -> TriMesh {
    let n = 12u32;
    let normal = random.direction();
    let u = normal.cross(&random.direction()).normalize();
    let v = normal.cross(&u);
    let (half, height, waves) = (random.between(15.0, 120.0), random.between(0.0, 6.0), random.between(0.5, 3.0));
    let mut positions = Vec::new();
    for j in 0..=n {
        for i in 0..=n {
            let (s, t) = (2.0 * f64::from(i) / f64::from(n) - 1.0, 2.0 * f64::from(j) / f64::from(n) - 1.0);
            let rise = height * (waves * (s + 0.7 * t) * std::f64::consts::PI).sin();
            positions.push(at + u * (s * half) + v * (t * half) + normal * rise);
        }
    }
    let mut triangles = Vec::new();
    for j in 0..n {
        for i in 0..n {
            let a = i + (n + 1) * j;
            for mut t in [[a, a + 1, a + n + 2], [a, a + n + 2, a + n + 1]] {
                if random.below(7) == 0 {
                    t.swap(1, 2);
                }
                triangles.push(t);
            }
        }
    }
    match TriMesh::new(positions, triangles) {
        Ok(mesh) => mesh,
        Err(_) => unreachable!("finite points and indices in range"),
    }
}

fn judge(kind: String, bone: &Envelope, done: &Result<Osteotomy, PlanError>, wall_s: f64) -> Row {
    let blank = Row {
        kind,
        outcome: String::new(),
        segments: 0,
        volume_error: 0.0,
        wall_s,
        wrong: None,
        detail: String::new(),
    };
    match done {
        Ok(o) => {
            let (volume_error, wrong) = check(bone, o);
            let detail = o.warnings.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ");
            Row { outcome: "parted".into(), segments: o.segments.len(), volume_error, wrong, detail, ..blank }
        }
        Err(error) => {
            let outcome = match error {
                PlanError::MissesBone { .. } => "misses bone",
                PlanError::NotParted { .. } => "not parted",
                PlanError::MissingLandmarks { .. } => "landmarks missing",
                PlanError::Cut { .. } | PlanError::Value { .. } => "refused",
                PlanError::Cancelled(_) => "cancelled",
            };
            // The study never cancels.
            let wrong = (outcome == "cancelled").then(|| "cancelled without a request".to_owned());
            Row { outcome: outcome.into(), wrong, detail: error.to_string(), ..blank }
        }
    }
}

/// Relative error of the volumes, and what is wrong.
///
/// A kerf removes bone, so with one the volumes must only not exceed that of the bone.
fn check(bone: &Envelope, o: &Osteotomy) -> (f64, Option<String>) {
    let sum = o.segments.iter().map(|s| s.volume_mm3).sum::<f64>() + o.dropped_mm3;
    let error = sum / bone.surface.volume() - 1.0;
    let slots = o.cuts.iter().any(|c| c.kerf_mm > 0.0);
    let relative = if slots { error.max(0.0) } else { error.abs() };
    if relative > VOLUME_TOLERANCE {
        return (relative, Some(format!("the volumes differ from that of the bone by {:.2} %", 100.0 * error)));
    }
    for s in &o.segments {
        if !TopologyFaults::of(&s.surface).is_closed_manifold() {
            return (relative, Some(format!("segment {} is not closed", s.id)));
        }
        if (s.volume_mm3 - s.surface.volume()).abs() > 1e-6 * s.volume_mm3 || s.volume_mm3 <= 0.0 {
            return (relative, Some(format!("the reported volume of segment {} is not that of its surface", s.id)));
        }
        // A segment must lie inside the uncut bone.
        let out = s.surface.positions().iter().map(|p| bone.grid.sample(p)).fold(f64::MIN, f64::max);
        if out > INTRUSION * bone.grid.spacing {
            return (relative, Some(format!("segment {} extends {out:.2} mm outside the bone", s.id)));
        }
    }
    (relative, None)
}

fn random_path(random: &mut Random, osteotomy: &Osteotomy) -> Row {
    let segment = 1 + random.below(osteotomy.segments.len() - 1) as u32;
    let centroid = osteotomy.segments.iter().find(|s| s.id == segment).map_or_else(Point::origin, |s| s.centroid);
    let n = 1 + random.below(4);
    let mut waypoints = Vec::new();
    for i in 1..=n {
        let turn = nalgebra::UnitQuaternion::from_scaled_axis(random.direction() * random.between(0.0, 0.3));
        let shift = random.direction() * random.between(0.0, 12.0);
        let motion = Motion::from_parts((centroid + shift - turn * centroid).into(), turn);
        waypoints.push((i as f64 / n as f64, motion));
    }
    let started = Instant::now();
    let end = waypoints.last().map_or_else(Motion::identity, |w| w.1);
    let done = BonePath::new(segment, waypoints)
        .and_then(|path| follow(osteotomy, &Plan { paths: vec![path] }, &Control::new()));
    let wall_s = started.elapsed().as_secs_f64();
    let kind = format!("path of {n} waypoints");
    let blank = Row {
        kind,
        outcome: "followed".into(),
        segments: 1,
        volume_error: 0.0,
        wall_s,
        wrong: None,
        detail: String::new(),
    };
    let reports = match done {
        Ok(reports) => reports,
        Err(error) => {
            return Row {
                outcome: "refused".into(),
                wrong: Some("a path was refused".into()),
                detail: error.to_string(),
                ..blank
            };
        }
    };
    let Some((report, piece)) = reports.first().zip(osteotomy.segments.iter().find(|s| s.id == segment)) else {
        return Row { wrong: Some("no report".into()), ..blank };
    };
    let (first, last) = (report.along.first(), report.along.last());
    let (Some(first), Some(last)) = (first, last) else { return Row { wrong: Some("no samples".into()), ..blank } };
    let moved = (end * centroid - centroid).norm();
    let finite = report
        .along
        .iter()
        .all(|s| [s.overlap_mm, s.overlap_mm3, s.gap_mm, s.gap_mm3].iter().all(|v| v.is_finite() && *v >= 0.0));
    let whole: f64 = osteotomy.segments.iter().filter(|s| s.id != segment).map(|s| s.volume_mm3).sum();
    let most = piece.volume_mm3.min(whole);
    // At rest only corners between cuts may overlap, and a path cannot be shorter than its chord.
    let wrong = if !finite {
        Some("a value is not finite".to_owned())
    } else if first.overlap_mm3 > 0.02 * piece.volume_mm3 + 5.0 {
        Some(format!("{:.0} mm³ overlap at rest", first.overlap_mm3))
    } else if let Some(s) = report.along.iter().find(|s| s.overlap_mm3 > 1.01 * most) {
        Some(format!("{:.1} mm³ overlap, but the smaller volume is {most:.1} mm³", s.overlap_mm3))
    } else if report.path_length_mm < moved - 1e-9 {
        Some("the path is shorter than its chord".to_owned())
    } else {
        None
    };
    let detail = format!(
        "{:.1} mm; overlap {:.1} of {most:.1} mm³, gap {:.0} mm³ at the end",
        report.path_length_mm,
        last.overlap_mm3,
        last.gap_mm3.abs()
    );
    Row { wrong, detail, ..blank }
}

#[cfg(test)]
mod tests {
    use super::*;
    use prosopon_planning::phantom;

    #[test]
    fn random_cuts_and_paths_on_the_phantom_are_right_or_refused_and_the_same_each_time() {
        let head = phantom::head();
        let skull = phantom::surface_of(head.skull.as_ref(), &head.bounds(), 3.0).unwrap();
        let settings = EnvelopeSettings { spacing_mm: 2.5, closing_mm: 5.0, min_visibility: 0.0 };
        let bone = envelope(&skull, &settings, &Control::new()).unwrap();
        let run = || rows(&bone, None, 16, 7);
        let first = run();
        assert_eq!(first.len(), 32);
        assert!(first.iter().filter(|r| r.outcome == "parted").count() >= 4);
        for r in &first {
            assert!(r.wrong.is_none(), "{}: {:?} {}", r.kind, r.wrong, r.detail);
        }
        for (a, b) in first.iter().zip(run()) {
            assert_eq!((&a.kind, &a.outcome, &a.detail), (&b.kind, &b.outcome, &b.detail));
        }
    }
}
