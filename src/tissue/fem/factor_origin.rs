use prosopon_geometry::Vector;

/// Matrix from which a factor was computed.
#[derive(Debug, Clone, PartialEq)]
pub enum FactorOrigin {
    /// The elements' stiffness at rest.
    Rest,
    /// The elements' stiffness at a state.
    State {
        /// Values of the generalised nodes, mm.
        x: Vec<[f64; 3]>,
        /// Whether negative eigenvalues of the elements were set to zero.
        projected: bool,
        /// Blocks of the springs, N/mm, in the order of nodes, row-major.
        springs: Vec<[f64; 9]>,
    },
    /// No factor: inverse tensors with which the vertices are relaxed, by unknown node, row-major.
    Vertices(Vec<[f64; 9]>),
    /// No usable factor: the next system is factorised.
    Nothing,
}

/// Vectors as plain numbers.
pub(super) fn numbers(x: &[Vector]) -> Vec<[f64; 3]> {
    x.iter().map(|x| (*x).into()).collect()
}

/// The vectors of [`numbers`].
pub(super) fn vectors(x: &[[f64; 3]]) -> Vec<Vector> {
    x.iter().map(|x| Vector::from(*x)).collect()
}
