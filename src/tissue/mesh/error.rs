use prosopon_geometry::control::Cancelled;

/// Reason why no mesh could be built.
#[derive(Debug, thiserror::Error)]
pub enum MeshError {
    /// A setting is out of range.
    #[error("{name} is {found}, allowed is {allowed}")]
    Setting {
        /// Name of the setting.
        name: &'static str,
        /// Value found.
        found: f64,
        /// Allowed values.
        allowed: String,
    },
    /// The region contains no tissue between skin and bone.
    #[error("no tissue between skin and bone in the region: check that the skin encloses the skull")]
    NoTissue,
    /// The mesh would have too many elements.
    #[error("an edge of {edge_mm} mm gives about {found} tetrahedra, at most {allowed} are allowed: use a longer edge")]
    TooLarge {
        /// Requested edge length, mm.
        edge_mm: f64,
        /// Estimated number of tetrahedra.
        found: u64,
        /// Largest number of tetrahedra allowed.
        allowed: u64,
    },
    /// The skin is too rough for its layer of prisms.
    #[error(
        "the skin is too rough for edges of {edge_mm} mm, or no skin: of the {nodes} nodes of its layer, {folded} stay beside folded \
         prisms; smooth the skin, or use shorter edges"
    )]
    RoughSkin {
        /// Edge length, mm.
        edge_mm: f64,
        /// Number of nodes of the layer.
        nodes: usize,
        /// Number of nodes beside prisms that fold.
        folded: usize,
    },
    /// Inverted elements could not be repaired.
    #[error("{count} inverted elements could not be repaired, the first near ({x:.1}, {y:.1}, {z:.1}) mm")]
    Inverted {
        /// Number of inverted elements.
        count: usize,
        /// x of the first one, LPS mm.
        x: f64,
        /// y of the first one, LPS mm.
        y: f64,
        /// z of the first one, LPS mm.
        z: f64,
    },
    /// The caller cancelled the computation.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}
