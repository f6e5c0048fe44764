//! Proposed landmarks against known ones.

use std::io::Write;

use super::error::BenchError;
use super::head::{Head, HeadSource};
use prosopon_planning::plan::propose;

/// How far proposed landmarks are from those that people have set.
#[derive(Debug)]
pub struct ProposalStudy<'a> {
    /// The heads.
    pub heads: &'a [HeadSource],
}

impl ProposalStudy<'_> {
    /// Prints each proposal, with its distance from the known landmark where there is one.
    ///
    /// # Errors
    /// [`BenchError`].
    pub fn run(&self, out: &mut dyn Write) -> Result<(), BenchError> {
        for source in self.heads {
            let head = Head::load(source)?;
            let found = propose(&head.anatomy.skin, &head.anatomy.skull);
            writeln!(
                out,
                "{}: midline {:.1}, occlusal plane {:?}",
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
