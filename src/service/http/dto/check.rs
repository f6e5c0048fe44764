use crate::http::extract::short_number;
use prosopon_session::{Fault, FieldFault};

/// Largest magnitude of a coordinate, mm; no scan of a head lies farther from its origin.
pub(super) const REACH_MM: f64 = 10_000.0;

/// Collects all faults of a request, so that one answer reports them all.
#[derive(Debug, Default)]
pub(in crate::http) struct Check {
    faults: Vec<FieldFault>,
}

impl Check {
    pub(in crate::http) fn fault(&mut self, pointer: impl Into<String>, detail: impl Into<String>) {
        self.faults.push(FieldFault::new(pointer, detail));
    }

    /// Checks that a number lies between `min` and `max`, both included.
    pub(super) fn number(&mut self, pointer: &str, value: f64, min: f64, max: f64) -> f64 {
        if !(min..=max).contains(&value) {
            self.fault(pointer, format!("is {}, allowed is {min} to {max}", short_number(value)));
        }
        value
    }

    /// Checks that a point or translation has coordinates within [`REACH_MM`].
    pub(super) fn vector(&mut self, pointer: &str, value: [f64; 3]) -> [f64; 3] {
        for (axis, coordinate) in value.into_iter().enumerate() {
            self.number(&format!("{pointer}/{axis}"), coordinate, -REACH_MM, REACH_MM);
        }
        value
    }

    /// Checks a direction and returns it as a unit vector.
    pub(super) fn direction(&mut self, pointer: &str, value: [f64; 3]) -> prosopon_geometry::Vector {
        self.vector(pointer, value);
        prosopon_geometry::Vector::from(value).try_normalize(1e-9).unwrap_or_else(|| {
            self.fault(pointer, "has zero length; give a direction of any length above zero");
            prosopon_geometry::Vector::z()
        })
    }

    /// Checks that a box has its smallest and largest corners in order.
    pub(super) fn bounds(
        &mut self,
        pointer: &str,
        value: prosopon_session::BoxDocument,
    ) -> prosopon_session::BoxDocument {
        self.vector(&format!("{pointer}/min_mm"), value.min_mm);
        self.vector(&format!("{pointer}/max_mm"), value.max_mm);
        if value.min_mm.iter().zip(value.max_mm).any(|(min, max)| *min >= max) {
            self.fault(pointer, "min_mm must be below max_mm along every axis");
        }
        value
    }

    /// Checks that a tag has at most 200 characters.
    pub(super) fn label(&mut self, pointer: &str, value: Option<String>) -> Option<String> {
        if let Some(label) = &value
            && label.chars().count() > 200
        {
            self.fault(pointer, format!("has {} characters, at most 200 are allowed", label.chars().count()));
        }
        value
    }

    /// Fails with all faults if there are any.
    pub(in crate::http) fn finish(self) -> Result<(), Fault> {
        if self.faults.is_empty() { Ok(()) } else { Err(Fault::invalid(self.faults)) }
    }
}
