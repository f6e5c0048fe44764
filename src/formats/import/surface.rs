use super::text::without_mark;
use super::{ImportError, Limits, obj, ply, stl, vtu};
use prosopon_geometry::{TriMesh, Warning};

/// File formats of surfaces.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SurfaceFormat {
    /// STL, binary or ASCII. Corners at the same coordinates become one vertex.
    Stl,
    /// PLY, binary or ASCII.
    Ply,
    /// Wavefront OBJ.
    Obj,
    /// VTK's XML format of surfaces: ASCII, base64 or appended data, plain or compressed by zlib.
    Vtp,
}

impl SurfaceFormat {
    /// Short lower-case name, for example `stl`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Stl => "stl",
            Self::Ply => "ply",
            Self::Obj => "obj",
            Self::Vtp => "vtp",
        }
    }
}

/// Guesses the format of a surface from its bytes; `None` when no format fits.
#[must_use]
pub fn detect_surface(bytes: &[u8]) -> Option<SurfaceFormat> {
    let bytes = if stl::is_whole_binary(bytes) { bytes } else { without_mark(bytes) };
    // PLY begins with its name. The comment of a binary STL may begin with anything, such as a word of XML or OBJ, so its length
    // is compared with its count before these are tried. OBJ is last: any text whose first statement is one of its words fits.
    if ply::looks_like(bytes) {
        Some(SurfaceFormat::Ply)
    } else if stl::looks_like(bytes) {
        Some(SurfaceFormat::Stl)
    } else if vtu::looks_like_polydata(bytes) {
        Some(SurfaceFormat::Vtp)
    } else if obj::looks_like(bytes) {
        Some(SurfaceFormat::Obj)
    } else {
        None
    }
}

/// Reads a surface; coordinates are taken as LPS mm unless the file states otherwise.
///
/// A coordinate system or unit that the header, a comment or a field array states (`SPACE=RAS`, `units: m`) is converted to LPS
/// and mm. Vertices at the same position become one; so do those at open edges within 0.001 % of the surface's diagonal.
/// Triangles with a repeated vertex, triangles that repeat others and unused vertices are left out. Triangles that face inwards
/// or against their neighbours are turned.
///
/// Returns the mesh and warnings about these changes, others (such as polygons that were split) and doubtful content. STL
/// corners at the same coordinates are merged without a warning, because the format stores no shared vertices.
///
/// An OBJ file has no end mark: a file that is cut off between two lines is read as a smaller surface.
///
/// ```
/// use prosopon_formats::import::{Limits, SurfaceFormat, detect_surface, surface};
///
/// let file = b"solid plate
/// facet normal 0 0 1 outer loop vertex 0 0 0 vertex 100 0 0 vertex 0 100 0 endloop endfacet
/// facet normal 0 0 1 outer loop vertex 100 0 0 vertex 100 100 0 vertex 0 100 0 endloop endfacet
/// endsolid plate";
/// assert_eq!(detect_surface(file), Some(SurfaceFormat::Stl));
/// let (mesh, warnings) = surface(file, SurfaceFormat::Stl, &Limits::default())?;
/// // The two triangles share two of their corners.
/// assert_eq!((mesh.triangles().len(), mesh.positions().len()), (2, 4));
/// assert_eq!(mesh.area(), 10_000.0);
/// assert!(warnings.is_empty());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// [`ImportError`] with the fault and its position.
pub fn surface(bytes: &[u8], format: SurfaceFormat, limits: &Limits) -> Result<(TriMesh, Vec<Warning>), ImportError> {
    if bytes.is_empty() {
        return Err(ImportError::Empty);
    }
    let bytes = if stl::is_whole_binary(bytes) { bytes } else { without_mark(bytes) };
    let raw = match format {
        SurfaceFormat::Stl => stl::read(bytes, limits)?,
        SurfaceFormat::Ply => ply::read(bytes, limits)?,
        SurfaceFormat::Obj => obj::read(bytes, limits)?,
        SurfaceFormat::Vtp => vtu::read_polydata(bytes, limits)?,
    };
    raw.finish()
}
