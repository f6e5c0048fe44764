use nalgebra::SMatrix;

/// Second derivative of the energy by `F`, MPa.
///
/// Both indices are column-major: `F[(r, c)]` is entry `r + 3 c`.
pub type Tangent = SMatrix<f64, 9, 9>;

/// The deformation gradient is not admissible: `det F <= 0` or not finite.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error("det F is {det_f:.3e}, it must be positive")]
pub struct Inverted {
    /// The determinant.
    pub det_f: f64,
}
