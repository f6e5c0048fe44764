use super::{Aabb, Point, Vector};

/// Scalar samples on an axis-aligned lattice with the same spacing in x, y and z.
///
/// Sample `(i, j, k)` lies at `origin + spacing * (i, j, k)` and is stored at `i + nx * (j + ny * k)`.
#[derive(Debug, Clone, PartialEq)]
pub struct ScalarGrid {
    /// Number of samples along x, y and z; each at least 2.
    pub dims: [usize; 3],
    /// Position of sample (0, 0, 0), LPS mm.
    pub origin: Point,
    /// Distance between neighbours, mm.
    pub spacing: f64,
    /// The `dims[0] * dims[1] * dims[2]` samples, x fastest.
    pub values: Vec<f32>,
}

impl ScalarGrid {
    /// A grid that covers `bounds` with `spacing` (mm), filled with `value`.
    #[must_use]
    pub fn covering(bounds: &Aabb, spacing: f64, value: f32) -> Self {
        let extent = bounds.max - bounds.min;
        let dims = [0, 1, 2].map(|a| ((extent[a] / spacing).ceil() as usize + 1).max(2));
        Self { dims, origin: bounds.min, spacing, values: vec![value; dims[0] * dims[1] * dims[2]] }
    }

    /// Storage index of sample `(i, j, k)`.
    #[must_use]
    pub fn index(&self, i: usize, j: usize, k: usize) -> usize {
        i + self.dims[0] * (j + self.dims[1] * k)
    }

    /// Position of sample `(i, j, k)`, LPS mm.
    #[must_use]
    pub fn position(&self, i: usize, j: usize, k: usize) -> Point {
        self.origin + Vector::new(i as f64, j as f64, k as f64) * self.spacing
    }

    /// Trilinear interpolation at `p`; points outside take the value of the nearest point of the grid.
    #[must_use]
    pub fn sample(&self, p: &Point) -> f64 {
        let mut base = [0usize; 3];
        let mut t = [0.0f64; 3];
        for a in 0..3 {
            let x = ((p[a] - self.origin[a]) / self.spacing).clamp(0.0, (self.dims[a] - 1) as f64);
            base[a] = (x as usize).min(self.dims[a] - 2);
            t[a] = x - base[a] as f64;
        }
        let at = |di: usize, dj: usize, dk: usize| {
            f64::from(self.values[self.index(base[0] + di, base[1] + dj, base[2] + dk)])
        };
        let line = |dj, dk| at(0, dj, dk) * (1.0 - t[0]) + at(1, dj, dk) * t[0];
        let face = |dk| line(0, dk) * (1.0 - t[1]) + line(1, dk) * t[1];
        face(0) * (1.0 - t[2]) + face(1) * t[2]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sampling_reproduces_a_linear_function() {
        let bounds = Aabb { min: Point::new(-1.0, 0.0, 2.0), max: Point::new(3.0, 2.0, 5.0) };
        let mut grid = ScalarGrid::covering(&bounds, 0.5, 0.0);
        let f = |p: &Point| 2.0 * p.x - p.y + 0.5 * p.z;
        for k in 0..grid.dims[2] {
            for j in 0..grid.dims[1] {
                for i in 0..grid.dims[0] {
                    let index = grid.index(i, j, k);
                    grid.values[index] = f(&grid.position(i, j, k)) as f32;
                }
            }
        }
        let p = Point::new(0.3, 1.1, 3.7);
        assert!((grid.sample(&p) - f(&p)).abs() < 1e-5);
    }
}
