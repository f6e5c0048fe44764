use super::bounds::BoxDocument;
use super::fault::{Fault, FieldFault};

/// Largest magnitude of a coordinate, mm; no scan of a head lies farther from its origin.
pub const REACH_MM: f64 = 10_000.0;

/// Collects all faults of a request, so that one answer reports them all.
#[derive(Debug, Default)]
pub struct Check {
    faults: Vec<FieldFault>,
}

impl Check {
    /// Adds a fault at a JSON pointer.
    pub fn fault(&mut self, pointer: impl Into<String>, detail: impl Into<String>) {
        self.faults.push(FieldFault::new(pointer, detail));
    }

    /// Checks that a number lies between `min` and `max`, both included.
    pub fn number(&mut self, pointer: &str, value: f64, min: f64, max: f64) -> f64 {
        if !(min..=max).contains(&value) {
            self.fault(pointer, format!("is {}, allowed is {min} to {max}", short_number(value)));
        }
        value
    }

    /// Checks that a point or translation has coordinates within [`REACH_MM`].
    pub fn vector(&mut self, pointer: &str, value: [f64; 3]) -> [f64; 3] {
        for (axis, coordinate) in value.into_iter().enumerate() {
            self.number(&format!("{pointer}/{axis}"), coordinate, -REACH_MM, REACH_MM);
        }
        value
    }

    /// Checks a direction and returns it as a unit vector.
    pub fn direction(&mut self, pointer: &str, value: [f64; 3]) -> prosopon_geometry::Vector {
        self.vector(pointer, value);
        let direction = prosopon_geometry::Vector::from(value);
        // A unit vector of an answer stays as it is, bit for bit.
        if (direction.norm() - 1.0).abs() < 1e-15 {
            return direction;
        }
        direction.try_normalize(1e-9).unwrap_or_else(|| {
            self.fault(pointer, "has zero length; give a direction of any length above zero");
            prosopon_geometry::Vector::z()
        })
    }

    /// Checks that a box has its smallest and largest corners in order.
    pub fn bounds(&mut self, pointer: &str, value: BoxDocument) -> BoxDocument {
        self.vector(&format!("{pointer}/min_mm"), value.min_mm);
        self.vector(&format!("{pointer}/max_mm"), value.max_mm);
        if value.min_mm.iter().zip(value.max_mm).any(|(min, max)| *min >= max) {
            self.fault(pointer, "min_mm must be below max_mm along every axis");
        }
        value
    }

    /// Checks that a tag has at most 200 characters.
    pub fn label(&mut self, pointer: &str, value: Option<String>) -> Option<String> {
        if let Some(label) = &value
            && label.chars().count() > 200
        {
            self.fault(pointer, format!("has {} characters, at most 200 are allowed", label.chars().count()));
        }
        self.text(pointer, value.as_deref());
        value
    }

    /// Checks that a name has 1 to 64 characters.
    pub(super) fn name(&mut self, pointer: &str, value: Option<&str>) {
        if value.is_some_and(|name| !(1..=64).contains(&name.chars().count())) {
            self.fault(pointer, "must have 1 to 64 characters");
        }
        self.text(pointer, value);
    }

    /// Checks that a text has no control characters, which a database or a page may not take.
    fn text(&mut self, pointer: &str, value: Option<&str>) {
        if value.is_some_and(|text| text.chars().any(char::is_control)) {
            self.fault(pointer, "has a control character; remove it");
        }
    }

    /// Fails with all faults if there are any.
    ///
    /// # Errors
    /// A fault of the kind `invalid-request` that lists them.
    pub fn finish(self) -> Result<(), Fault> {
        if self.faults.is_empty() { Ok(()) } else { Err(Fault::invalid(self.faults)) }
    }
}

/// Formats a number; very large and very small ones in scientific notation.
#[must_use]
pub fn short_number(value: f64) -> String {
    let usual = value == 0.0 || (1e-6..1e15).contains(&value.abs());
    if usual { value.to_string() } else { format!("{value:e}") }
}
