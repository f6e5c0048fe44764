use super::{SurfaceReport, TriMesh, Vector};

/// From this many triangles on, a surface with more open sides than triangles is a heap of pieces.
const LEAST_HEAP: usize = 100;

/// A surface thinner than this share of its diagonal counts as flat. Rounding a plane to `f32` stays below it.
const MAX_FLAT_SHARE: f64 = 1e-4;

/// Reason why a surface bounds no solid even when its holes are closed; `None` when it bounds one.
///
/// The reasons are: fewer than four triangles, a heap of single triangles, all triangles in one plane, or a closed surface without volume. `report` is
/// the [`surface_report`](super::surface_report) of `mesh`.
#[must_use]
pub fn not_solid_reason(mesh: &TriMesh, report: &SurfaceReport) -> Option<String> {
    if report.triangles < 4 {
        return Some(format!("too few triangles to bound a solid: {}, at least 4 are needed", report.triangles));
    }
    if report.triangles >= LEAST_HEAP && report.boundary_edges > report.triangles {
        return Some(format!(
            "the triangles hardly touch each other: of the {} sides of {} triangles {} are open; export the surface with joined vertices",
            3 * report.triangles,
            report.triangles,
            report.boundary_edges
        ));
    }
    let diagonal = report.bounds.diagonal();
    let thickness = thickness(mesh);
    if thickness <= MAX_FLAT_SHARE * diagonal {
        let detail = "all triangles lie in one plane and bound no solid";
        return Some(format!("{detail}: {thickness:.3} mm thick, {diagonal:.1} mm across"));
    }
    let encloses = report.volume_mm3.abs() > MAX_FLAT_SHARE * report.area_mm2 * diagonal;
    (report.closed && !encloses)
        .then(|| format!("the surface is closed but encloses no volume: {:.3} mm³", report.volume_mm3))
}

/// Largest distance of a vertex from the plane through three vertices that are far apart, mm.
fn thickness(mesh: &TriMesh) -> f64 {
    let Some(first) = mesh.positions().first() else { return 0.0 };
    let farthest = |measure: &dyn Fn(Vector) -> f64| {
        let arms = mesh.positions().iter().map(|p| p - first);
        arms.max_by(|a, b| measure(*a).total_cmp(&measure(*b))).unwrap_or_else(Vector::zeros)
    };
    let along = farthest(&|arm| arm.norm_squared());
    let across = farthest(&|arm| along.cross(&arm).norm_squared());
    let Some(normal) = along.cross(&across).try_normalize(0.0) else { return 0.0 };
    normal.dot(&farthest(&|arm| normal.dot(&arm).abs())).abs()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Point, surface_report};

    const CUBE: [[u32; 4]; 6] = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];

    /// Reason for a box of these sides, mm, without its first `left_out` triangles.
    fn refusal(sides: [f64; 3], left_out: usize) -> Option<String> {
        let at = |v: u32, a: usize| if v >> a & 1 == 1 { sides[a] } else { 0.0 };
        let positions = (0..8).map(|v| Point::new(at(v, 0), at(v, 1), at(v, 2))).collect();
        let triangles: Vec<[u32; 3]> = CUBE.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
        let mesh = TriMesh::new(positions, triangles[left_out..].to_vec()).unwrap();
        not_solid_reason(&mesh, &surface_report(&mesh))
    }

    #[test]
    fn open_surfaces_are_taken_and_those_that_bound_nothing_are_not() {
        assert_eq!(refusal([100.0; 3], 0), None);
        assert_eq!(refusal([100.0; 3], 2), None, "one side is missing");
        assert!(refusal([100.0; 3], 11).is_some_and(|d| d.contains("solid: 1,")));
        assert!(refusal([100.0, 100.0, 1e-4], 0).is_some_and(|d| d.contains("one plane")));
        assert!(refusal([100.0, 1e-4, 1e-4], 0).is_some_and(|d| d.contains("one plane")));
    }

    #[test]
    fn a_heap_of_single_triangles_is_no_surface() {
        let positions: Vec<Point> =
            (0..300).map(|i| Point::new(f64::from(i), f64::from(i * i % 97), f64::from(i * 31 % 89))).collect();
        let triangles: Vec<[u32; 3]> = (0..100).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
        let mesh = TriMesh::new(positions, triangles).unwrap();
        let reason = not_solid_reason(&mesh, &surface_report(&mesh)).unwrap();
        assert!(reason.contains("of the 300 sides of 100 triangles 300 are open"), "{reason}");
    }

    #[test]
    fn a_bent_sheet_with_two_equal_faces_encloses_nothing() {
        let positions = [[0., 0., 0.], [100., 0., 0.], [0., 100., 0.], [100., 100., 60.]].map(Point::from).to_vec();
        let mesh = TriMesh::new(positions, vec![[0, 1, 2], [1, 3, 2], [0, 2, 1], [1, 2, 3]]).unwrap();
        let report = SurfaceReport { closed: true, ..surface_report(&mesh) };
        assert!(not_solid_reason(&mesh, &report).is_some_and(|d| d.contains("no volume")));
    }
}
