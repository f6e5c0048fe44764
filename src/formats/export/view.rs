use prosopon_geometry::TriMesh;

/// A surface with named values and colours per vertex, for the writers of surfaces.
#[derive(Debug, Clone, Copy)]
pub struct SurfaceView<'a> {
    /// The surface.
    pub mesh: &'a TriMesh,
    /// Name with unit (for example `displacement_mm`) and one value per vertex.
    ///
    /// Names must differ in more than case. A vertex without a value has NaN.
    pub scalars: &'a [(&'a str, &'a [f32])],
    /// sRGB colour per vertex; STL drops it.
    pub colours: Option<&'a [[u8; 3]]>,
}

impl SurfaceView<'_> {
    /// Panics unless there are one value and one colour per vertex.
    pub(super) fn assert_lengths(&self) {
        let n = self.mesh.positions().len();
        for (name, values) in self.scalars {
            assert_eq!(values.len(), n, "values of {name}, of vertices");
        }
        assert_eq!(self.colours.map_or(n, <[_]>::len), n, "colours, of vertices");
    }
}

/// `name` with underscores for all but ASCII letters and digits, which every format and program accepts.
pub(super) fn identifier(name: &str) -> String {
    name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect()
}
