//! The oral slit: where the lips part.
//!
//! Closed lips touch, and a lattice sees no gap between them. [`Opening`] therefore pulls the tissue apart along the slit before
//! it is meshed, so that prisms grow on both red margins, and [`close`] moves the finished mesh back.

mod close;
mod curve;
mod opened;
mod opening;
mod parted_skin;
#[cfg(test)]
mod tests;

pub(super) use close::{close, drop_folded_when_closed};
pub use curve::{Slit, SlitError, SlitKnot};
pub(super) use opened::{Opened, OpenedSkin};
pub(super) use opening::Opening;
pub use parted_skin::{PartedSkin, embed_parted, part_skin};
