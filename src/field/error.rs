use prosopon_geometry::Aabb;
use prosopon_geometry::control::Cancelled;

/// Why no field could be built.
///
/// ```
/// use prosopon_field::{DistanceField, FieldError, FieldSettings};
/// use prosopon_geometry::control::Control;
/// use prosopon_geometry::{Point, TriMesh};
///
/// let corners = [[0.0, 0.0, 0.0], [9.0, 0.0, 0.0], [0.0, 9.0, 0.0], [0.0, 0.0, 9.0]];
/// let positions = corners.map(Point::from).to_vec();
/// let tetrahedron = TriMesh::new(positions, vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])?;
/// let settings = FieldSettings { spacing_mm: 0.0, ..FieldSettings::default() };
/// let refused = DistanceField::build(&tetrahedron, &settings, &Control::new());
/// assert!(matches!(refused, Err(FieldError::Setting { name: "spacing_mm", .. })));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, thiserror::Error)]
pub enum FieldError {
    /// A setting is out of range.
    #[error("{name} is {found}, allowed is {allowed}")]
    Setting {
        /// Name of the setting.
        name: &'static str,
        /// Value that was passed.
        found: f64,
        /// Allowed range with its unit.
        allowed: &'static str,
    },
    /// The field would need too many samples.
    #[error("a spacing of {spacing_mm} mm needs {samples} samples, allowed are {allowed}; use a larger spacing")]
    TooLarge {
        /// Requested spacing, mm.
        spacing_mm: f64,
        /// Number of samples that this spacing needs.
        samples: u64,
        /// Largest number of samples allowed.
        allowed: u64,
    },
    /// The requested box does not overlap the field's domain.
    #[error("the requested box does not overlap the surface's bounding box plus margin; move or enlarge the box")]
    BoxOutsideDomain,
    /// The surface encloses nothing.
    #[error("the surface encloses no volume at this spacing; close its holes or use a smaller spacing")]
    NothingInside,
    /// The surface is more holes than surface.
    #[error(
        "the surface is open along {open} of its {edges} edges, so that inside and outside cannot be distinguished; export the surface with joined \
         vertices, or fill its holes"
    )]
    TooOpen {
        /// Number of edges at rims.
        open: usize,
        /// Number of all edges.
        edges: usize,
    },
    /// The caller cancelled the work.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

/// Refuses a setting outside `range`.
pub(super) fn within(
    name: &'static str,
    found: f64,
    range: std::ops::RangeInclusive<f64>,
    allowed: &'static str,
) -> Result<(), FieldError> {
    if range.contains(&found) { Ok(()) } else { Err(FieldError::Setting { name, found, allowed }) }
}

/// Largest coordinate and extent, mm: squares of larger distances exceed the range of `f32`.
const MOST_MM: f64 = 1e8;

/// The largest magnitude of a coordinate of `bounds`, mm; refuses coordinates beyond [`MOST_MM`].
pub(super) fn within_coordinates(bounds: &Aabb) -> Result<f64, FieldError> {
    let largest = bounds.min.iter().chain(bounds.max.iter()).fold(0.0f64, |m, c| m.max(c.abs()));
    within("largest coordinate", largest, 0.0..=MOST_MM, "up to 1e8 mm")?;
    Ok(largest)
}
