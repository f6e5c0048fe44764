use crate::session::{Fault, FaultKind, SurfaceDocument, SurfaceOrigin};
use prosopon_geometry::{SurfaceReport, TriMesh, Vector, surface_report};
use prosopon_store::{PartKind, PartRecord, SessionId, Store, encode_mesh, now_rfc3339};

/// A surface measured and encoded, ready to be stored. Measuring computes: make it on the CPU pool.
#[derive(Debug)]
pub struct PreparedSurface {
    document: SurfaceDocument,
    bytes: Vec<u8>,
}

impl PreparedSurface {
    /// Measures `mesh`. It may be open, but must be such that it bounds a solid once its holes are closed.
    ///
    /// # Errors
    /// [`FaultKind::SurfaceNotUsable`].
    pub fn new(mesh: &TriMesh, origin: SurfaceOrigin, warnings: Vec<String>) -> Result<Self, Fault> {
        let report = surface_report(mesh);
        if let Some(detail) = why_no_solid(mesh, &report) {
            return Err(Fault::new(FaultKind::SurfaceNotUsable, detail));
        }
        Ok(Self { document: SurfaceDocument::new(origin, &report, warnings), bytes: encode_mesh(mesh) })
    }
}

/// Thickness of a surface that counts as flat, as a share of its diagonal: above what single precision makes of a plane.
const FLAT: f64 = 1e-4;

fn why_no_solid(mesh: &TriMesh, report: &SurfaceReport) -> Option<String> {
    if report.triangles < 4 {
        return Some(format!("too few triangles to bound a solid: {}, at least 4 are needed", report.triangles));
    }
    let diagonal = report.bounds.diagonal();
    let thickness = thickness(mesh);
    if thickness <= FLAT * diagonal {
        let detail = "all triangles lie in one plane and bound no solid";
        return Some(format!("{detail}: {thickness:.3} mm thick, {diagonal:.1} mm across"));
    }
    let encloses = report.volume_mm3.abs() > FLAT * report.area_mm2 * diagonal;
    (report.closed && !encloses)
        .then(|| format!("the surface is closed but encloses no volume: {:.3} mm³", report.volume_mm3))
}

/// Largest distance of a vertex from the plane through three far ones, mm.
fn thickness(mesh: &TriMesh) -> f64 {
    let Some(first) = mesh.positions().first() else { return 0.0 };
    let farthest = |measure: &dyn Fn(Vector) -> f64| {
        let arms = mesh.positions().iter().map(|p| p - first);
        arms.max_by(|a, b| measure(*a).total_cmp(&measure(*b))).unwrap_or_else(Vector::zeros)
    };
    let along = farthest(&|arm| arm.norm_squared());
    let aside = farthest(&|arm| along.cross(&arm).norm_squared());
    let Some(normal) = along.cross(&aside).try_normalize(0.0) else { return 0.0 };
    normal.dot(&farthest(&|arm| normal.dot(&arm).abs())).abs()
}

/// Stores the surface's file and returns the row that will name it, with its document.
///
/// # Errors
/// The store's.
pub async fn surface_part(
    store: &Store,
    session: SessionId,
    kind: PartKind,
    surface: PreparedSurface,
    wall_s: f64,
) -> Result<(PartRecord, SurfaceDocument), Fault> {
    let document = serde_json::to_string(&surface.document).unwrap_or_default();
    let blob = store.blobs().put(session, surface.bytes).await?;
    let part = PartRecord {
        kind,
        key: blob.sha256,
        blob: Some(blob.key),
        bytes: blob.bytes,
        wall_s,
        document,
        updated_at: now_rfc3339(),
    };
    Ok((part, surface.document))
}

#[cfg(test)]
mod tests {
    use super::*;
    use prosopon_geometry::Point;

    const CUBE: [[u32; 4]; 6] = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];

    /// The box of these sides, without its first `left_out` triangles.
    fn refusal(sides: [f64; 3], left_out: usize) -> Option<String> {
        let at = |v: u32, a: usize| if v >> a & 1 == 1 { sides[a] } else { 0.0 };
        let positions = (0..8).map(|v| Point::new(at(v, 0), at(v, 1), at(v, 2))).collect();
        let triangles: Vec<[u32; 3]> = CUBE.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
        let mesh = TriMesh::new(positions, triangles[left_out..].to_vec()).unwrap();
        why_no_solid(&mesh, &surface_report(&mesh))
    }

    #[test]
    fn open_surfaces_are_taken_and_those_that_bound_nothing_are_not() {
        assert_eq!(refusal([100.0; 3], 0), None);
        assert_eq!(refusal([100.0; 3], 2), None, "one side away");
        assert!(refusal([100.0; 3], 11).is_some_and(|d| d.contains("solid: 1,")));
        assert!(refusal([100.0, 100.0, 1e-4], 0).is_some_and(|d| d.contains("one plane")));
        assert!(refusal([100.0, 1e-4, 1e-4], 0).is_some_and(|d| d.contains("one plane")));
    }

    #[test]
    fn a_bent_sheet_with_two_equal_faces_encloses_nothing() {
        let positions = [[0., 0., 0.], [100., 0., 0.], [0., 100., 0.], [100., 100., 60.]].map(Point::from).to_vec();
        let mesh = TriMesh::new(positions, vec![[0, 1, 2], [1, 3, 2], [0, 2, 1], [1, 2, 3]]).unwrap();
        let report = SurfaceReport { closed: true, ..surface_report(&mesh) };
        assert!(why_no_solid(&mesh, &report).is_some_and(|d| d.contains("no volume")));
    }
}
