use nalgebra::Matrix3;

/// An element that is inverted in a given configuration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::fem) struct Inversion {
    /// Index of the part.
    pub(in crate::fem) part: usize,
    /// Index of the element in the part.
    pub(in crate::fem) element: usize,
}

/// Where the first element is inverted along a direction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::fem) struct FirstInversion {
    /// Share of the direction, at most 1.
    pub(in crate::fem) share: f64,
    /// The element; `None` when none is inverted.
    pub(in crate::fem) element: Option<Inversion>,
}

/// State of an element, averaged over its quadrature points.
#[derive(Debug, Clone, Copy)]
pub(in crate::fem) struct ElementState {
    /// Volume at rest, mm³.
    pub(in crate::fem) volume: f64,
    /// Cauchy stress, MPa.
    pub(in crate::fem) stress: Matrix3<f64>,
    /// det F.
    pub(in crate::fem) ratio: f64,
}
