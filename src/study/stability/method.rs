use prosopon_tissue::fem::{Locking, Model, SkinElement};

/// A mechanical model with its elements.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Method {
    pub(super) name: &'static str,
    pub(super) model: Model,
    pub(super) skin_element: SkinElement,
    pub(super) locking: Locking,
}

const fn method(name: &'static str, model: Model, skin_element: SkinElement, locking: Locking) -> Method {
    Method { name, model, skin_element, locking }
}

/// The methods that the service offers.
pub(super) const METHODS: [Method; 8] = [
    method("linear", Model::Linear, SkinElement::Wedge, Locking::None),
    method("mass_tensor", Model::MassTensor, SkinElement::Wedge, Locking::None),
    method("nonlinear", Model::Nonlinear, SkinElement::Tetrahedron, Locking::None),
    method("nonlinear smoothed", Model::Nonlinear, SkinElement::Tetrahedron, Locking::Smoothed),
    method("nonlinear patched", Model::Nonlinear, SkinElement::Tetrahedron, Locking::Patched),
    method("mixed", Model::Mixed, SkinElement::C1Prism, Locking::None),
    method("mixed smoothed", Model::Mixed, SkinElement::C1Prism, Locking::Smoothed),
    method("mixed patched", Model::Mixed, SkinElement::C1Prism, Locking::Patched),
];

impl Method {
    /// The method at finite strain on the same elements: itself, or the nonlinear model in place of a linear one.
    pub(super) fn at_finite_strain(self) -> Self {
        if self.model.is_linear() { Self { model: Model::Nonlinear, ..self } } else { self }
    }

    /// The other of the two linear models; other models unchanged.
    pub(super) fn other_way(self) -> Self {
        let model = match self.model {
            Model::Linear => Model::MassTensor,
            Model::MassTensor => Model::Linear,
            Model::Nonlinear | Model::Mixed => self.model,
        };
        Self { model, ..self }
    }

    /// The same method with the locking-free formulation.
    pub(super) fn cured(self) -> Self {
        Self { locking: Locking::Smoothed, ..self }
    }
}
