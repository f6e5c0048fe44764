//! Accuracy of proposed landmarks.

use std::io::Write;

use super::error::BenchError;
use super::head::{Head, HeadSource};
use prosopon_planning::plan::propose;

/// Measures the distances of proposed landmarks from landmarks that were set by hand.
#[derive(Debug)]
pub struct ProposalStudy<'a> {
    /// The heads.
    pub heads: &'a [HeadSource],
}

impl ProposalStudy<'_> {
    /// Prints each proposed landmark and its distance from the known one, if there is one.
    ///
    /// # Errors
    /// [`BenchError`].
    pub fn run(&self, out: &mut dyn Write) -> Result<(), BenchError> {
        for source in self.heads {
            let head = Head::load(source)?;
            let found = propose(&head.anatomy.skin, &head.anatomy.skull);
            writeln!(
                out,
                "{}: midline x {:.1} mm, occlusal plane z {:?} mm",
                source.name(),
                found.midline_x_mm,
                found.occlusal_z_mm
            )?;
            for (name, p) in &found.points {
                let known = head.landmarks.points.get(name);
                let off = known.map_or(String::new(), |k| {
                    format!("known ({:.1}, {:.1}, {:.1}), off by {:.1} mm", k.x, k.y, k.z, (p - k).norm())
                });
                writeln!(out, "  {name:<22} ({:>6.1}, {:>6.1}, {:>6.1}) {off}", p.x, p.y, p.z)?;
            }
        }
        Ok(())
    }
}
