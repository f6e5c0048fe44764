//! Dental arches, from which teeth and the air beside them are built.

use super::shapes::Arch;

/// Centre line of the upper teeth's crowns.
pub(super) const UPPER_ARCH: Arch = Arch { half_width: 27.0, depth: 53.0, back_y: -31.0 };
/// Centre line of the lower teeth's crowns, which gives an overjet of 2 mm.
pub(super) const LOWER_ARCH: Arch = Arch { half_width: 25.5, depth: 51.0, back_y: -31.0 };
