use super::cell_table::{CASES, edge_corners};
use crate::{Point, ScalarGrid, TriMesh, Vector};

/// Smallest distance of a vertex from either end of its grid edge, as a share of the edge.
///
/// Without it, samples at the isolevel would put several vertices on one grid point and make triangles without area. The
/// surface moves by at most this share of the spacing.
const NUDGE: f64 = 0.01;

const NONE: u32 = u32::MAX;

/// Closed surface of the solid where `grid` is below `iso`; `None` when no sample is below `iso`.
///
/// Triangles are counter-clockwise seen from outside. Where the solid reaches the border of the grid, the surface is capped.
///
/// The method is marching cubes with polygons traced on the faces of the cells. For any values the surface is closed,
/// two-manifold at edges and vertices, and free of triangles without area. A NaN counts as outside. Two diagonally opposite
/// inside corners of a face are joined.
///
/// # Accuracy
/// Vertices lie on grid edges by linear interpolation, at least 1 % of the spacing away from the ends of the edge.
///
/// # Source
/// Lorensen & Cline, Marching Cubes, SIGGRAPH 1987. Nielson & Hamann, The asymptotic decider, 1991, discuss why the rule for
/// a face must depend on the face only.
#[must_use]
pub fn isosurface(grid: &ScalarGrid, iso: f32) -> Option<TriMesh> {
    let mut builder = Builder::new(grid, iso);
    // The grid is padded with one virtual layer of outside samples on every side.
    for k in 0..grid.dims[2] + 2 {
        builder.add_layer(k);
    }
    TriMesh::new(builder.positions, builder.triangles).ok()
}

/// Sweeps the padded grid layer by layer; holds the signs and the edge vertices of two layers.
struct Builder<'a> {
    grid: &'a ScalarGrid,
    iso: f32,
    /// Number of padded samples along x and y.
    width: usize,
    height: usize,
    below: Layer,
    above: Layer,
    /// Vertices on the edges along z between the two layers.
    z_edges: Vec<u32>,
    positions: Vec<Point>,
    triangles: Vec<[u32; 3]>,
}

#[derive(Clone)]
struct Layer {
    inside: Vec<u8>,
    any_inside: bool,
    x_edges: Vec<u32>,
    y_edges: Vec<u32>,
}

impl<'a> Builder<'a> {
    fn new(grid: &'a ScalarGrid, iso: f32) -> Self {
        let (width, height) = (grid.dims[0] + 2, grid.dims[1] + 2);
        let n = width * height;
        let empty = Layer { inside: vec![0; n], any_inside: false, x_edges: vec![NONE; n], y_edges: vec![NONE; n] };
        Self {
            grid,
            iso,
            width,
            height,
            below: empty.clone(),
            above: empty,
            z_edges: vec![NONE; n],
            positions: Vec::new(),
            triangles: Vec::new(),
        }
    }

    fn add_layer(&mut self, k: usize) {
        std::mem::swap(&mut self.below, &mut self.above);
        self.read_signs(k);
        if self.above.any_inside {
            self.cut_in_layer(k);
        }
        if k > 0 && (self.above.any_inside || self.below.any_inside) {
            self.cut_between_layers(k);
            self.add_cells();
        }
    }

    fn read_signs(&mut self, k: usize) {
        let [nx, ny, nz] = self.grid.dims;
        let layer = &mut self.above;
        layer.any_inside = false;
        if k == 0 || k == nz + 1 {
            layer.inside.fill(0);
            return;
        }
        for j in 0..ny {
            let row = &self.grid.values[nx * (j + ny * (k - 1))..][..nx];
            let signs = &mut layer.inside[(j + 1) * self.width + 1..][..nx];
            let mut any = 0;
            for (sign, value) in signs.iter_mut().zip(row) {
                *sign = u8::from(*value < self.iso);
                any |= *sign;
            }
            layer.any_inside |= any != 0;
        }
    }

    fn cut_in_layer(&mut self, k: usize) {
        let w = self.width;
        for j in 0..self.height {
            for i in 0..w {
                let at = i + w * j;
                let here = self.above.inside[at];
                if i + 1 < w && here != self.above.inside[at + 1] {
                    self.above.x_edges[at] = self.cut([i, j, k], 0);
                }
                if j + 1 < self.height && here != self.above.inside[at + w] {
                    self.above.y_edges[at] = self.cut([i, j, k], 1);
                }
            }
        }
    }

    fn cut_between_layers(&mut self, k: usize) {
        for j in 0..self.height {
            for i in 0..self.width {
                let at = i + self.width * j;
                if self.below.inside[at] != self.above.inside[at] {
                    self.z_edges[at] = self.cut([i, j, k - 1], 2);
                }
            }
        }
    }

    /// Adds the vertex on the padded grid edge from `low` along `axis`.
    fn cut(&mut self, low: [usize; 3], axis: usize) -> u32 {
        let mut high = low;
        high[axis] += 1;
        let t = match (self.value(low), self.value(high)) {
            (Some(a), Some(b)) => {
                let t = (f64::from(self.iso) - f64::from(a)) / (f64::from(b) - f64::from(a));
                if t.is_nan() { 0.5 } else { t.clamp(NUDGE, 1.0 - NUDGE) }
            }
            // The cap of a solid that reaches the border lies just outside the last samples.
            (Some(_), None) => NUDGE,
            _ => 1.0 - NUDGE,
        };
        let mut p = low.map(|c| c as f64 - 1.0);
        p[axis] += t;
        self.positions.push(self.grid.origin + Vector::from(p) * self.grid.spacing);
        (self.positions.len() - 1) as u32
    }

    fn value(&self, padded: [usize; 3]) -> Option<f32> {
        let d = self.grid.dims;
        if (0..3).any(|a| padded[a] == 0 || padded[a] > d[a]) {
            return None;
        }
        Some(self.grid.values[self.grid.index(padded[0] - 1, padded[1] - 1, padded[2] - 1)])
    }

    fn add_cells(&mut self) {
        let w = self.width;
        for j in 0..self.height - 1 {
            // Four corners of one column: bits 0 (y) and 1 (y + 1), bits 2 and 3 the same one layer up.
            let column = |i: usize| {
                let at = i + w * j;
                self.below.inside[at]
                    | self.below.inside[at + w] << 1
                    | self.above.inside[at] << 2
                    | self.above.inside[at + w] << 3
            };
            let mut left = column(0);
            let mut crossed = Vec::new();
            for i in 0..w - 1 {
                let right = column(i + 1);
                if (left | right) != 0 && (left & right) != 0b1111 {
                    crossed.push((i, left, right));
                }
                left = right;
            }
            for (i, left, right) in crossed {
                self.add_cell(i + w * j, left, right);
            }
        }
    }

    fn add_cell(&mut self, at: usize, left: u8, right: u8) {
        let mut pattern = 0usize;
        for bit in 0..4 {
            pattern |= usize::from(left >> bit & 1) << (2 * bit) | usize::from(right >> bit & 1) << (2 * bit + 1);
        }
        let case = &CASES[pattern];
        let mut vertices = [NONE; 12 + 4];
        for edge in 0..12 {
            let low = edge_corners(edge)[0];
            let layer = if low & 4 == 0 { &self.below } else { &self.above };
            let sample = at + (low & 1) + self.width * (low >> 1 & 1);
            vertices[edge] = match edge / 4 {
                0 => layer.x_edges[sample],
                1 => layer.y_edges[sample],
                _ => self.z_edges[sample],
            };
        }
        for (n, polygon) in case.centers.iter().enumerate() {
            let sum: Vector = polygon.iter().map(|&e| self.positions[vertices[e as usize] as usize].coords).sum();
            vertices[12 + n] = self.positions.len() as u32;
            self.positions.push(Point::from(sum / polygon.len() as f64));
        }
        self.triangles.extend(case.triangles.iter().map(|t| t.map(|v| vertices[v as usize])));
    }
}

#[cfg(test)]
mod tests {
    use super::super::topology::TopologyFaults;
    use super::*;
    use crate::Aabb;
    use proptest::prelude::*;

    fn sampled(half_width: f64, spacing: f64, f: impl Fn(&Point) -> f64) -> ScalarGrid {
        let bounds = Aabb { min: Point::origin(), max: Point::origin() }.grown(half_width);
        let mut grid = ScalarGrid::covering(&bounds, spacing, 0.0);
        for k in 0..grid.dims[2] {
            for j in 0..grid.dims[1] {
                for i in 0..grid.dims[0] {
                    let at = grid.index(i, j, k);
                    grid.values[at] = f(&grid.position(i, j, k)) as f32;
                }
            }
        }
        grid
    }

    #[test]
    fn a_sphere_has_its_volume_area_and_radius() {
        let (r, h) = (10.0, 0.5);
        let mesh = isosurface(&sampled(12.0, h, |p| p.coords.norm() - r), 0.0).unwrap();
        assert!(TopologyFaults::of(&mesh).is_closed_manifold());
        // Linear interpolation of a distance is off by at most h²/8r, triangles sag by about the same.
        let sag = 2.0 * h * h / (8.0 * r) + NUDGE * h;
        assert!(mesh.positions().iter().all(|p| (p.coords.norm() - r).abs() < sag));
        let exact = 4.0 / 3.0 * std::f64::consts::PI * r.powi(3);
        assert!((mesh.volume() / exact - 1.0).abs() < 3.0 * sag / r);
        assert!((mesh.area() / (4.0 * std::f64::consts::PI * r * r) - 1.0).abs() < 0.01);
    }

    #[test]
    fn a_torus_has_genus_one() {
        let mesh =
            isosurface(&sampled(8.0, 0.7, |p| ((p.x * p.x + p.y * p.y).sqrt() - 5.0).hypot(p.z) - 2.0), 0.0).unwrap();
        assert!(TopologyFaults::of(&mesh).is_closed_manifold());
        let euler = mesh.positions().len() as i64 - mesh.triangles().len() as i64 / 2;
        assert_eq!(euler, 0);
    }

    #[test]
    fn a_solid_that_fills_the_grid_is_capped_at_its_border() {
        let grid = sampled(3.0, 1.0, |_| -1.0);
        let mesh = isosurface(&grid, 0.0).unwrap();
        assert!(TopologyFaults::of(&mesh).is_closed_manifold());
        // The cap rounds the edges of the box; that changes the volume only at second order in NUDGE.
        assert!((mesh.volume() - 216.0).abs() < 216.0 * 3.0 * NUDGE);
        let bounds = mesh.bounds();
        assert!((bounds.max.x - 3.0).abs() < 2.0 * NUDGE && (bounds.min.z + 3.0).abs() < 2.0 * NUDGE);
    }

    #[test]
    fn nothing_below_the_level_gives_no_surface() {
        assert_eq!(isosurface(&sampled(2.0, 1.0, |_| 1.0), 0.0), None);
        assert_eq!(isosurface(&sampled(2.0, 1.0, |_| f64::NAN), 0.0), None);
        assert_eq!(isosurface(&sampled(2.0, 1.0, |_| 0.0), 0.0), None);
    }

    #[test]
    fn every_sign_pattern_and_its_neighbours_are_closed() {
        for pattern in 0..256usize {
            let values = (0..8).map(|c| if pattern >> c & 1 == 1 { -1.0 } else { 1.0 }).collect();
            let grid = ScalarGrid { dims: [2, 2, 2], origin: Point::origin(), spacing: 1.0, values };
            let Some(mesh) = isosurface(&grid, 0.0) else { continue };
            assert!(TopologyFaults::of(&mesh).is_closed_manifold(), "{pattern:08b}");
            assert!(mesh.volume() > 0.0);
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(400))]
        /// Few distinct levels, so that exact iso values, ambiguous faces and pinched cells are common.
        #[test]
        fn any_values_give_a_closed_manifold(
            dims in [2usize..7, 2..7, 2..7],
            levels in prop::collection::vec(prop::sample::select(
                vec![-1.0f32, -0.3, -1e-9, 0.0, 0.0, 1e-9, 0.4, 1.0, f32::NAN, f32::INFINITY, f32::NEG_INFINITY]), 216),
        ) {
            let n = dims.iter().product();
            let grid = ScalarGrid { dims, origin: Point::new(-80.0, 3.0, 120.0), spacing: 0.7, values: levels[..n].to_vec() };
            if let Some(mesh) = isosurface(&grid, 0.0) {
                prop_assert_eq!(TopologyFaults::of(&mesh), TopologyFaults::default());
                let smallest = (0..mesh.triangles().len()).map(|t| mesh.scaled_normal(t).norm()).fold(f64::MAX, f64::min);
                prop_assert!(smallest > 0.5 * (NUDGE * 0.7).powi(2), "area {}", smallest);
                prop_assert!(mesh.volume() > 0.0);
            }
        }
    }
}
