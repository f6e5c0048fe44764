//! Statistics of values at vertices, weighted by area.

use prosopon_geometry::TriMesh;

/// Area-weighted statistics of signed values, mm.
#[derive(Debug, Clone, PartialEq)]
pub struct Statistics {
    /// Number of vertices counted.
    pub count: usize,
    /// Signed mean.
    pub mean: f64,
    /// Mean of absolute values.
    pub mean_abs: f64,
    /// Root mean square.
    pub rms: f64,
    /// Median of the absolute values.
    pub p50: f64,
    /// 90th percentile of the absolute values.
    pub p90: f64,
    /// 95th percentile of the absolute values.
    pub p95: f64,
    /// Largest absolute value.
    pub max: f64,
    /// Square root of the unweighted sum of squares over the vertices, as in Wang 2009, Figure 18.
    pub l2_norm: f64,
    /// Variance of the signed values, mm².
    pub variance: f64,
    /// Shares of the area with absolute values below 1, 2 and 3 mm, 0 to 1.
    pub share_below: [f64; 3],
}

/// Area of each vertex, mm²: a third of the area of its triangles.
pub(super) fn vertex_areas(mesh: &TriMesh) -> Vec<f64> {
    let mut areas = vec![0.0; mesh.positions().len()];
    for (t, corners) in mesh.triangles().iter().enumerate() {
        let third = mesh.scaled_normal(t).norm() / 6.0;
        for v in corners {
            areas[*v as usize] += third;
        }
    }
    areas
}

/// Statistics of `values` (mm) at the vertices of `mesh` where `mask` holds.
///
/// A `mask` of `None` selects all vertices.
///
/// Each value has the weight of its vertex's area, a third of the triangles around it. A percentile is the smallest absolute
/// value that at least that share of the area does not exceed. Values that are not finite, and vertices beyond the end of
/// `values` or `mask`, are not counted. Returns `None` when no vertex with an area is counted.
///
/// # Examples
/// ```
/// use prosopon_geometry::{Point, TriMesh};
/// use prosopon_planning::evaluate::statistics;
///
/// let corners = [[0.0, 0.0], [10.0, 0.0], [0.0, 10.0]].map(|[x, y]| Point::new(x, y, 0.0));
/// let triangle = TriMesh::new(corners.to_vec(), vec![[0, 1, 2]])?;
/// let found = statistics(&triangle, &[1.0, -2.0, 4.0], None).ok_or("nothing to count")?;
/// assert_eq!(found.count, 3);
/// assert!((found.mean - 1.0).abs() < 1e-9 && (found.mean_abs - 7.0 / 3.0).abs() < 1e-9);
/// assert_eq!((found.p50, found.max), (2.0, 4.0));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[must_use]
pub fn statistics(mesh: &TriMesh, values: &[f32], mask: Option<&[bool]>) -> Option<Statistics> {
    let areas = vertex_areas(mesh);
    let chosen = |i: usize| mask.is_none_or(|m| m.get(i) == Some(&true));
    let counted: Vec<(f64, f64)> = values
        .iter()
        .zip(&areas)
        .enumerate()
        .filter(|(i, (v, _))| v.is_finite() && chosen(*i))
        .map(|(_, (v, a))| (f64::from(*v), *a))
        .collect();
    let total: f64 = counted.iter().map(|c| c.1).sum();
    if total <= 0.0 {
        return None;
    }
    let mean_of = |f: &dyn Fn(f64) -> f64| counted.iter().map(|(v, w)| w * f(*v)).sum::<f64>() / total;
    let mean = mean_of(&|v| v);

    let mut sizes: Vec<(f64, f64)> = counted.iter().map(|(v, w)| (v.abs(), *w)).collect();
    sizes.sort_by(|a, b| a.0.total_cmp(&b.0));
    let max = sizes.last().map_or(0.0, |s| s.0);
    let percentile = |share: f64| {
        let mut sum = 0.0;
        let reached = |s: &&(f64, f64)| {
            sum += s.1;
            // Tolerance for rounding in the sum, far below the area of one vertex.
            sum >= share * total * (1.0 - 1e-12)
        };
        sizes.iter().find(reached).map_or(max, |s| s.0)
    };
    Some(Statistics {
        count: counted.len(),
        mean,
        mean_abs: mean_of(&f64::abs),
        rms: mean_of(&|v| v * v).sqrt(),
        p50: percentile(0.50),
        p90: percentile(0.90),
        p95: percentile(0.95),
        max,
        l2_norm: counted.iter().map(|(v, _)| v * v).sum::<f64>().sqrt(),
        variance: mean_of(&|v| (v - mean).powi(2)),
        share_below: [1.0, 2.0, 3.0].map(|limit| mean_of(&|v| f64::from(u8::from(v.abs() < limit)))),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use prosopon_geometry::Point;

    /// Two triangles: areas 3 and 6, so that the vertices have areas 1, 1 + 2, 1 + 2 and 2.
    fn mesh() -> TriMesh {
        let p = vec![
            Point::new(-2.0, 0.0, 0.0),
            Point::new(0.0, 0.0, 0.0),
            Point::new(0.0, 3.0, 0.0),
            Point::new(4.0, 0.0, 0.0),
        ];
        TriMesh::new(p, vec![[0, 1, 2], [1, 3, 2]]).unwrap()
    }

    #[test]
    fn statistics_by_hand() {
        let s = statistics(&mesh(), &[-4.0, 1.0, 0.5, -2.0], None).unwrap();
        assert_eq!(s.count, 4);
        let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-12, "{a} {b}");
        let mean = (-4.0 + 3.0 + 1.5 - 4.0) / 9.0;
        near(s.mean, mean);
        near(s.mean_abs, (4.0 + 3.0 + 1.5 + 4.0) / 9.0);
        let square: f64 = (16.0 + 3.0 + 0.75 + 8.0) / 9.0;
        near(s.rms, square.sqrt());
        near(s.variance, square - mean * mean);
        near(s.l2_norm, (16.0f64 + 1.0 + 0.25 + 4.0).sqrt());
        // In ascending order: 0.5 (area 3), 1 (to 6), 2 (to 8), 4 (to 9).
        assert_eq!((s.p50, s.p90, s.p95, s.max), (1.0, 4.0, 4.0, 4.0));
        near(s.share_below[0], 3.0 / 9.0);
        near(s.share_below[1], 6.0 / 9.0);
        near(s.share_below[2], 8.0 / 9.0);
    }

    #[test]
    fn masked_and_missing_values_do_not_count() {
        let all = [f32::NAN, 1.0, 7.0, -2.0];
        let s = statistics(&mesh(), &all, Some(&[true, true, false, true])).unwrap();
        assert_eq!((s.count, s.max), (2, 2.0));
        assert!((s.mean - (3.0 - 4.0) / 5.0).abs() < 1e-12);
        assert_eq!(statistics(&mesh(), &all, Some(&[true, false, false, false])), None);
        assert_eq!(statistics(&mesh(), &[], None), None);
    }
}
