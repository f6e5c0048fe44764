//! Whether a head gets the same frame and landmarks however it lies.

use std::io::Write;
use std::time::Instant;

use super::error::BenchError;
use super::head::{Head, HeadSource};
use nalgebra::UnitQuaternion;
use prosopon_geometry::control::Control;
use prosopon_geometry::{Motion, Vector};
use prosopon_planning::evaluate::{HeadFrame, head_frame};

/// Largest turn about each axis, degrees.
const MOST_TURNED_DEG: f64 = 45.0;
/// Largest shift along each axis, mm.
const MOST_SHIFTED_MM: f64 = 500.0;

/// Turns heads and compares their frames with those of the heads as they came.
#[derive(Debug)]
pub struct PoseStudy<'a> {
    /// The heads.
    pub heads: &'a [HeadSource],
    /// Number of turns of each head.
    pub turns: usize,
}

impl PoseStudy<'_> {
    /// Prints the frame of each head, and how far that of each turned head is from it.
    ///
    /// # Errors
    /// [`BenchError`].
    pub fn run(&self, out: &mut dyn Write) -> Result<(), BenchError> {
        for source in self.heads {
            let head = Head::load(source)?;
            let frame_of = |motion: &Motion| -> Result<(HeadFrame, f64), BenchError> {
                let (skin, skull) = (head.anatomy.skin.moved(motion), head.anatomy.skull.moved(motion));
                let begin = Instant::now();
                let unusable =
                    |e: prosopon_planning::evaluate::EvaluateError| BenchError::Head { detail: e.to_string() };
                let frame = head_frame(&skin, &skull, &Control::new()).map_err(unusable)?;
                Ok((frame, begin.elapsed().as_secs_f64()))
            };
            let (upright, seconds) = frame_of(&Motion::identity())?;
            let [roll, pitch, yaw] = {
                let (x, y, z) = upright.from_scan.rotation.euler_angles();
                [y, x, z].map(f64::to_degrees)
            };
            writeln!(
                out,
                "{}: {:?}, pitch {pitch:.1}°, roll {roll:.1}°, yaw {yaw:.1}°, asymmetry {:.2} mm, unlike {:.1} mm, {} landmarks, confidence \
                 {:.2}, {seconds:.1} s",
                source.name(),
                upright.basis,
                upright.asymmetry_mm,
                upright.unlike_mm,
                upright.landmarks,
                upright.confidence()
            )?;
            for turn in 0..self.turns {
                let motion = pose(turn);
                let (found, seconds) = frame_of(&motion)?;
                let off = found.from_scan * motion * upright.from_scan.inverse();
                let (deg, mm) = (off.rotation.angle().to_degrees(), off.translation.vector.norm());
                let [x, y, z] = motion.rotation.scaled_axis().map(f64::to_degrees).into();
                writeln!(
                    out,
                    "  turned by ({x:>5.1}, {y:>5.1}, {z:>5.1})°: {:?}, off by {deg:.3}° and {mm:.3} mm, {seconds:.1} s",
                    found.basis
                )?;
            }
        }
        Ok(())
    }
}

/// The `k`th pose: turns about the three axes, one after the other, and a shift, spread evenly.
fn pose(k: usize) -> Motion {
    // Multiples of powers of an irrational number spread evenly over a cube (Roberts 2018).
    const STEP: f64 = 1.0 / 1.220_744_084_605_759_5;
    let part = |power: i32| 2.0 * (0.5 + STEP.powi(power) * (k + 1) as f64).fract() - 1.0;
    let turn = |axis: usize, power: i32| {
        UnitQuaternion::from_scaled_axis(Vector::ith(axis, (MOST_TURNED_DEG * part(power)).to_radians()))
    };
    let shift = Vector::new(part(2), part(3), part(1)) * MOST_SHIFTED_MM;
    Motion::from_parts(shift.into(), turn(2, 3) * turn(1, 2) * turn(0, 1))
}
