//! Evaluation against a synthetic truth: recovery of a known motion and a known error.

use std::io::Write;
use std::path::Path;
use std::time::Instant;

use nalgebra::UnitQuaternion;

use super::error::{BenchError, write};
use super::head::{Head, HeadSource};
use super::scan::{Scan, scanned};
use prosopon_geometry::control::Control;
use prosopon_geometry::{Motion, TriMesh, Vector};
use prosopon_planning::evaluate::{ErrorMap, Registration, error_map, register};
use prosopon_planning::simulate::{Frame, RunSettings, solve};
use prosopon_tissue::fem::{Model, Preset, SolveSettings};

/// Steps of the path.
const STEPS: usize = 3;
/// Translation and rotation of the scan against the prediction.
const SHIFT_MM: f64 = 5.0;
const TURN_DEG: f64 = 5.0;
/// Skin that the plan moves less than this counts as unaltered, mm, as in a job.
const UNMOVED_MM: f64 = 0.1;

/// Evaluates a coarse prediction against a simulated scan of a finer one.
///
/// The skin of the finer model is the truth. It is scanned with noise and displaced, and the prediction is evaluated against
/// the scan.
#[derive(Debug)]
pub struct TruthStudy<'a> {
    /// The head.
    pub source: &'a HeadSource,
    /// CSV file to write.
    pub csv: &'a Path,
    /// Edge length of the prediction's mesh, mm; the mesh of the truth has half of it.
    pub edge_mm: f64,
    /// Standard deviation of the scan's noise along each axis, mm.
    pub noise_mm: f64,
    /// Step (1 to 3) whose skin is the prediction; steps before the last differ from the truth by millimetres.
    pub prediction_step: usize,
}

/// Result of one scan.
struct Row {
    turned_about: [f64; 3],
    shift_off_mm: f64,
    turn_off_deg: f64,
    residual_mm: f64,
    overlap: f64,
    register_s: f64,
    map_s: f64,
    reported: ErrorMap,
}

impl TruthStudy<'_> {
    /// Runs the study, prints the results to `out` and writes the rows.
    ///
    /// # Errors
    /// [`BenchError`].
    pub fn run(&self, out: &mut dyn Write) -> Result<(), BenchError> {
        let head = Head::load(self.source)?;
        let mut solved = |edge_mm: f64, step: usize| -> Result<Frame, BenchError> {
            let start = Instant::now();
            let frame = Self::solved(&head, edge_mm, step)?;
            writeln!(out, "edge {edge_mm} mm: solved in {:.1} s", start.elapsed().as_secs_f64())?;
            Ok(frame)
        };
        let (coarse, fine) = (solved(self.edge_mm, self.prediction_step)?, solved(0.5 * self.edge_mm, STEPS)?);
        let face = head.face();
        let control = Control::new();
        let true_error = error_map(&coarse.skin, &fine.skin, Some(&face), &[], &control)?;
        let unmoved: Vec<bool> = coarse.displacement_mm.iter().map(|d| f64::from(*d) < UNMOVED_MM).collect();
        let mut csv = String::from(
            "axis,shift_off_mm,turn_off_deg,residual_mm,overlap,true_mean_mm,true_mean_abs_mm,reported_mean_mm,reported_mean_abs_mm,\
             smoothed_mean_abs_mm,roughness_mm,register_s,map_s\n",
        );
        let t = &true_error.whole;
        writeln!(
            out,
            "true error: mean {:+.4}, mean absolute {:.4}, P95 {:.3}, max {:.3} mm",
            t.mean, t.mean_abs, t.p95, t.max
        )?;
        for axis in [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, -1.0, 1.0]] {
            let row = self.evaluated(&head, &coarse.skin, &fine.skin, axis, &unmoved, &face)?;
            row.tell(&true_error, out)?;
            csv += &row.csv(&true_error);
        }
        write(self.csv, csv.as_bytes())
    }

    fn solved(head: &Head, edge_mm: f64, step: usize) -> Result<Frame, BenchError> {
        let ready = head.prepare(edge_mm)?;
        let solver = SolveSettings::new(Model::Mixed, Preset::Wang2009Stable.materials());
        let settings = RunSettings { solver, steps: STEPS, attachment: None, leave_out_below_mm: 0.0 };
        let mut last = None;
        let mut seen = 0;
        let mut keep = |frame: Frame| {
            seen += 1;
            if seen <= step {
                last = Some(frame);
            }
        };
        solve(&head.anatomy, &ready.tissue, &ready.bone, &ready.plan, &settings, &Control::new(), &mut keep)?;
        last.ok_or_else(|| BenchError::Head { detail: "the solver returned no step".to_owned() })
    }

    fn evaluated(
        &self,
        head: &Head,
        prediction: &TriMesh,
        truth: &TriMesh,
        axis: [f64; 3],
        unmoved: &[bool],
        face: &[bool],
    ) -> Result<Row, BenchError> {
        let rotation = UnitQuaternion::from_scaled_axis(Vector::from(axis).normalize() * TURN_DEG.to_radians());
        // The rotation is about the centre of the head, so that the translation is that of the head and not of the origin.
        let middle = head.anatomy.skin.bounds().center().coords;
        let shift = Vector::new(-1.0, 1.0, 1.0).normalize() * SHIFT_MM;
        let known = Motion::from_parts((middle - rotation * middle + shift).into(), rotation);
        let scan = scanned(&Scan { truth, noise_mm: self.noise_mm, seed: 2009 })
            .ok_or_else(|| BenchError::Head { detail: "the simulated scan of the skin is empty".to_owned() })?
            .moved(&known);
        let control = Control::new();
        let start = Instant::now();
        let found: Registration = register(prediction, &scan, Some(unmoved), &control)?;
        let register_s = start.elapsed().as_secs_f64();
        let off = found.motion * known.inverse();
        let at_middle = known * nalgebra::Point3::from(middle);
        let start = Instant::now();
        let reported = error_map(&prediction.moved(&found.motion), &scan, Some(face), &[], &control)?;
        Ok(Row {
            turned_about: axis,
            shift_off_mm: (off * at_middle - at_middle).norm(),
            turn_off_deg: off.rotation.angle().to_degrees(),
            residual_mm: found.residual_mm,
            overlap: found.overlap,
            register_s,
            map_s: start.elapsed().as_secs_f64(),
            reported,
        })
    }
}

impl Row {
    fn tell(&self, truth: &ErrorMap, out: &mut dyn Write) -> Result<(), BenchError> {
        let (w, s, t) = (&self.reported.whole, &self.reported.smoothed, &truth.whole);
        writeln!(
            out,
            "scan turned about {:?}: registration error {:.4} mm, {:.4} degrees (residual {:.3} mm, overlap {:.2}); \
             reported mean {:+.4} mm, mean absolute {:.4} ({:+.1} % from the true one), smoothed {:.4} ({:+.1} %), \
             roughness {:.3} mm; registration {:.2} s, map {:.2} s",
            self.turned_about,
            self.shift_off_mm,
            self.turn_off_deg,
            self.residual_mm,
            self.overlap,
            w.mean,
            w.mean_abs,
            100.0 * (w.mean_abs / t.mean_abs - 1.0),
            s.mean_abs,
            100.0 * (s.mean_abs / t.mean_abs - 1.0),
            self.reported.roughness_mm,
            self.register_s,
            self.map_s
        )?;
        Ok(())
    }

    fn csv(&self, truth: &ErrorMap) -> String {
        let (w, s, t) = (&self.reported.whole, &self.reported.smoothed, &truth.whole);
        let [x, y, z] = self.turned_about;
        format!(
            "{x} {y} {z},{:.5},{:.5},{:.4},{:.3},{:.5},{:.5},{:.5},{:.5},{:.5},{:.4},{:.2},{:.2}\n",
            self.shift_off_mm,
            self.turn_off_deg,
            self.residual_mm,
            self.overlap,
            t.mean,
            t.mean_abs,
            w.mean,
            w.mean_abs,
            s.mean_abs,
            self.reported.roughness_mm,
            self.register_s,
            self.map_s
        )
    }
}
