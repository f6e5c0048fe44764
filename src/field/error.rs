use prosopon_geometry::control::Cancelled;

/// Why no field could be built.
#[derive(Debug, thiserror::Error)]
pub enum FieldError {
    /// A setting is out of range.
    #[error("{name} is {found}, allowed is {allowed}")]
    Setting {
        /// Name of the setting.
        name: &'static str,
        /// Its value.
        found: f64,
        /// What is allowed.
        allowed: &'static str,
    },
    /// The field would need too much memory.
    #[error("a spacing of {spacing_mm} mm needs {samples} samples, at most {allowed} are allowed")]
    TooLarge {
        /// Spacing asked for, mm.
        spacing_mm: f64,
        /// Samples needed.
        samples: u64,
        /// Samples allowed.
        allowed: u64,
    },
    /// The box within which the field is wanted lies beyond the field's domain.
    #[error("the box within which the field is wanted does not meet the surface's box, grown by the margin")]
    Elsewhere,
    /// The surface encloses nothing.
    #[error("the surface encloses no volume: the winding number is below one half everywhere")]
    NothingInside,
    /// Stopped by the caller.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

/// Refuses a setting that is not within `range`.
pub(super) fn within(
    name: &'static str,
    found: f64,
    range: std::ops::RangeInclusive<f64>,
    allowed: &'static str,
) -> Result<(), FieldError> {
    if range.contains(&found) { Ok(()) } else { Err(FieldError::Setting { name, found, allowed }) }
}
