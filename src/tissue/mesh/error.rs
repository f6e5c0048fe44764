use prosopon_geometry::control::Cancelled;

/// Why no mesh came out.
#[derive(Debug, thiserror::Error)]
pub enum MeshError {
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
    /// There is no tissue between skin and bone in the region.
    #[error("no tissue between skin and bone in the region: is the skin inside the skull?")]
    NoTissue,
    /// More elements than allowed.
    #[error("an edge of {edge_mm} mm gives about {found} tetrahedra, at most {allowed} are allowed")]
    TooLarge {
        /// Edge asked for, mm.
        edge_mm: f64,
        /// Tetrahedra expected.
        found: u64,
        /// Tetrahedra allowed.
        allowed: u64,
    },
    /// Inverted elements could not be mended.
    #[error("{count} inverted elements could not be mended, the first near ({x:.1}, {y:.1}, {z:.1}) mm")]
    Inverted {
        /// How many.
        count: usize,
        /// Where the first lies.
        x: f64,
        /// Where the first lies.
        y: f64,
        /// Where the first lies.
        z: f64,
    },
    /// Stopped by the caller.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}
