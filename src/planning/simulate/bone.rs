use std::sync::Arc;

use rayon::prelude::*;

use super::SimulateError;
use super::tuning::CONTACT_SPACING;
use crate::plan::{Cut, Osteotomy, cut};
use prosopon_field::{Envelope, MethodSettings, SignedField};
use prosopon_geometry::control::Control;
use prosopon_geometry::{Aabb, Implicit};
use prosopon_tissue::fem::ContactBody;

/// Bone cut into segments, each with a distance field in its rest frame.
#[derive(Debug)]
pub struct CutBone {
    /// The cuts and the segments.
    pub osteotomy: Arc<Osteotomy>,
    /// Field of each segment, in the order of the osteotomy's segments.
    pub fields: Vec<Arc<SignedField>>,
}

impl CutBone {
    /// The segments as solids for ties and contact.
    #[must_use]
    pub fn bodies(&self) -> Vec<ContactBody<'_>> {
        let segments = self.osteotomy.segments.iter();
        segments.zip(&self.fields).map(|(s, f)| ContactBody { segment: s.id, solid: f.as_ref() }).collect()
    }

    /// Each segment's number and solid.
    #[must_use]
    pub fn solids(&self) -> Vec<(u32, &dyn Implicit)> {
        self.bodies().into_iter().map(|b| (b.segment, b.solid)).collect()
    }

    /// Box around the segments that can move; `None` when there is only the skull.
    #[must_use]
    pub fn movable_bounds(&self) -> Option<Aabb> {
        Aabb::of(self.osteotomy.segments.iter().filter(|s| s.id != 0).flat_map(|s| s.surface.positions()))
    }
}

/// Cuts the bone and builds a field for each segment, at twice the spacing that `settings` names.
///
/// # Errors
/// [`SimulateError::Plan`] when the cuts do not part the bone, [`SimulateError::Field`].
pub fn cut_bone(
    bone: &Envelope,
    cuts: &[Cut],
    settings: &MethodSettings,
    control: &Control,
) -> Result<CutBone, SimulateError> {
    let osteotomy = Arc::new(cut(bone, cuts, &control.stage(0.0, 0.4))?);
    segment_fields(&osteotomy, settings, &control.stage(0.4, 1.0))
}

/// Builds a field for each segment, at twice the spacing that `settings` names.
///
/// # Errors
/// [`SimulateError::Field`].
pub fn segment_fields(
    osteotomy: &Arc<Osteotomy>,
    settings: &MethodSettings,
    control: &Control,
) -> Result<CutBone, SimulateError> {
    let settings = settings.coarser(CONTACT_SPACING);
    let unseen = control.without_progress();
    // In parallel, because parts of each build run on one thread.
    let fields = osteotomy
        .segments
        .par_iter()
        .map(|s| Ok(Arc::new(SignedField::build_only(&s.surface, &settings, &unseen)?.0)))
        .collect::<Result<_, SimulateError>>()?;
    control.report(1.0);
    Ok(CutBone { osteotomy: Arc::clone(osteotomy), fields })
}
