use super::{Point, Vector};
use nalgebra::Matrix3;

/// Step of the central differences of the default Hessian, mm.
const DIFFERENCE_MM: f64 = 1e-4;

/// A solid given by a function that is negative inside, zero on its surface and positive outside.
///
/// Values are in mm and approximate the signed distance near the surface. The gradient is the exact derivative of the value.
pub trait Implicit: Sync {
    /// Signed value at `p`, mm; negative inside. Always finite for a finite point.
    fn value(&self, p: &Point) -> f64;

    /// Value (mm) and gradient (dimensionless) at `p`.
    fn value_gradient(&self, p: &Point) -> (f64, Vector);

    /// Symmetric matrix of second derivatives at `p`, 1/mm.
    ///
    /// The default takes central differences of the gradient.
    fn hessian(&self, p: &Point) -> Matrix3<f64> {
        let column = |axis: usize| {
            let step = Vector::ith(axis, DIFFERENCE_MM);
            (self.value_gradient(&(p + step)).1 - self.value_gradient(&(p - step)).1) / (2.0 * DIFFERENCE_MM)
        };
        let h = Matrix3::from_columns(&[column(0), column(1), column(2)]);
        (h + h.transpose()) * 0.5
    }
}
