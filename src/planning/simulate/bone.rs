use std::sync::Arc;

use rayon::prelude::*;

use super::SimulateError;
use super::globes::{Globe, WithGlobes};
use super::tuning::{CONTACT_SPACING, ORBITS_ABOVE_TEETH_MM};
use crate::plan::{Cut, Osteotomy, Segment, cut};
use prosopon_field::{Envelope, MethodSettings, SignedField};
use prosopon_geometry::control::Control;
use prosopon_geometry::{Aabb, Implicit, Point};
use prosopon_tissue::fem::ContactBody;

/// Bone cut into segments, each with a distance field in its rest frame.
#[derive(Debug)]
pub struct CutBone {
    /// The cuts and the segments.
    pub osteotomy: Arc<Osteotomy>,
    /// Field of each segment, in the order of the osteotomy's segments.
    pub fields: Vec<Arc<SignedField>>,
    /// The skull with the globes, where there are some.
    skull_with_globes: Option<WithGlobes<Arc<SignedField>>>,
}

impl CutBone {
    /// Segments with a field each, in their order.
    #[must_use]
    pub fn new(osteotomy: Arc<Osteotomy>, fields: Vec<Arc<SignedField>>) -> Self {
        Self { osteotomy, fields, skull_with_globes: None }
    }

    /// The same bone with globes that stay with the skull.
    #[must_use]
    pub fn with_globes(&self, globes: &[Globe]) -> Self {
        let skull = self.osteotomy.segments.iter().zip(&self.fields).find(|(segment, _)| segment.id == 0);
        let skull_with_globes = skull
            .filter(|_| !globes.is_empty())
            .map(|(_, field)| WithGlobes { solid: Arc::clone(field), globes: globes.to_vec() });
        Self { osteotomy: Arc::clone(&self.osteotomy), fields: self.fields.clone(), skull_with_globes }
    }

    /// The globe at which `p` lies, whose nearest solid is that of segment `nearest`.
    pub(super) fn globe_at(&self, p: &Point, nearest: u32) -> Option<&Globe> {
        self.skull_with_globes.as_ref().filter(|_| nearest == 0)?.globe_before_solid(p)
    }

    /// The segments as solids for ties and contact; the skull includes the globes.
    #[must_use]
    pub fn bodies(&self) -> Vec<ContactBody<'_>> {
        let segments = self.osteotomy.segments.iter().zip(&self.fields);
        segments.map(|(s, f)| ContactBody { segment: s.id, solid: self.solid(s, f) }).collect()
    }

    fn solid<'a>(&'a self, segment: &Segment, field: &'a Arc<SignedField>) -> &'a dyn Implicit {
        match &self.skull_with_globes {
            Some(skull) if segment.id == 0 => skull,
            Some(_) | None => field.as_ref(),
        }
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

    /// Boxes around each segment that can move, by its number, and may reach an orbit; all of these where the teeth are not known.
    pub(super) fn boxes_near_orbits(&self, moves: impl Fn(u32) -> bool) -> Vec<Aabb> {
        let movable = self.osteotomy.segments.iter().filter(|s| s.id != 0 && moves(s.id));
        let boxes = movable.filter_map(|s| Aabb::of(s.surface.positions()));
        let is_high = |part: &Aabb| {
            let top = Point::new(part.center().x, part.center().y, part.max.z);
            self.osteotomy.arch.as_ref().is_none_or(|arch| arch.height(&top) > ORBITS_ABOVE_TEETH_MM)
        };
        boxes.filter(is_high).collect()
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
    Ok(CutBone::new(Arc::clone(osteotomy), fields))
}
