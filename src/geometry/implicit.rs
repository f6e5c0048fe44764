use super::{Point, Vector};

/// A solid given by a function that is negative inside, zero on its surface and positive outside.
///
/// Values are in mm and near the surface a signed distance; the gradient is the exact derivative of the value.
pub trait Implicit: Sync {
    /// Signed value at `p`, mm; negative inside. Always finite for a finite point.
    fn value(&self, p: &Point) -> f64;

    /// Value (mm) and gradient (dimensionless) at `p`.
    fn value_gradient(&self, p: &Point) -> (f64, Vector);
}
