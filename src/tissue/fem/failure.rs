//! Reasons why the solver found no equilibrium.

use super::assembly::Inversion;
use super::factor::Indefinite;
use prosopon_geometry::Point;
use prosopon_geometry::control::Cancelled;

/// Reason why no equilibrium was found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Failure {
    Inverted(Inversion),
    NotConverged { iterations: usize, residual_n: f64, tolerance_n: f64 },
    Penetration { found_mm: f64 },
    PassedThrough { body: usize, place: Point },
    Indefinite,
    Cancelled,
}

impl From<Cancelled> for Failure {
    fn from(_: Cancelled) -> Self {
        Self::Cancelled
    }
}

impl From<Inversion> for Failure {
    fn from(at: Inversion) -> Self {
        Self::Inverted(at)
    }
}

impl From<Indefinite> for Failure {
    fn from(_: Indefinite) -> Self {
        Self::Indefinite
    }
}
