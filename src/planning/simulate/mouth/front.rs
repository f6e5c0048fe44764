use super::tuning::PIXEL_MM;
use prosopon_geometry::{Aabb, Point, TriMesh};

/// The front of a surface seen along y: its smallest y at each pixel (x, z).
pub(super) struct Front {
    x: f64,
    z: f64,
    size: [usize; 2],
    y: Vec<f64>,
}

impl Front {
    /// The front of `mesh` around some points, grown by a margin, mm; `None` without points.
    pub(super) fn of(mesh: &TriMesh, around: &[Point], margin: f64) -> Option<Self> {
        let bounds = Aabb::of(around)?.grown(margin);
        let cells = |low: f64, high: f64| ((high - low) / PIXEL_MM).ceil().clamp(0.0, 4000.0) as usize + 1;
        let size = [cells(bounds.min.x, bounds.max.x), cells(bounds.min.z, bounds.max.z)];
        let mut front = Self { x: bounds.min.x, z: bounds.min.z, size, y: vec![f64::INFINITY; size[0] * size[1]] };
        for t in 0..mesh.triangles().len() {
            front.draw(mesh.corners(t));
        }
        Some(front)
    }

    fn draw(&mut self, corners: [Point; 3]) {
        let flat = corners.map(|p| [(p.x - self.x) / PIXEL_MM, (p.z - self.z) / PIXEL_MM]);
        let [p, q, r] = flat;
        let area = (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]);
        if area == 0.0 || !area.is_finite() {
            return;
        }
        let range = |axis: usize| {
            let all = flat.map(|c| c[axis]);
            let low = all.iter().copied().fold(f64::INFINITY, f64::min).ceil().max(0.0);
            let high = all.iter().copied().fold(f64::NEG_INFINITY, f64::max).floor();
            low as usize..((high + 1.0).max(0.0) as usize).min(self.size[axis])
        };
        let side = |u: [f64; 2], v: [f64; 2], at: [f64; 2]| {
            ((v[0] - u[0]) * (at[1] - u[1]) - (v[1] - u[1]) * (at[0] - u[0])) / area
        };
        for k in range(1) {
            for i in range(0) {
                let at = [i as f64, k as f64];
                let weights = [side(q, r, at), side(r, p, at), side(p, q, at)];
                if weights.iter().all(|w| *w >= -1e-9) {
                    let y = weights.iter().zip(&corners).map(|(w, c)| w * c.y).sum::<f64>();
                    let pixel = &mut self.y[i + self.size[0] * k];
                    *pixel = pixel.min(y);
                }
            }
        }
    }

    /// Columns and rows.
    pub(super) fn size(&self) -> [usize; 2] {
        self.size
    }

    /// Place of a column and a row.
    pub(super) fn place(&self, i: usize, k: usize) -> [f64; 2] {
        [self.x + i as f64 * PIXEL_MM, self.z + k as f64 * PIXEL_MM]
    }

    /// y at a pixel; infinite where there is no surface.
    pub(super) fn pixel(&self, i: usize, k: usize) -> f64 {
        self.y[i + self.size[0] * k]
    }

    /// y at the pixel nearest to (x, z); `None` outside the view or beside the surface.
    pub(super) fn at(&self, x: f64, z: f64) -> Option<f64> {
        let index = |v: f64, n: usize| {
            let at = (v / PIXEL_MM).round();
            (at >= 0.0 && at < n as f64).then_some(at as usize)
        };
        let (i, k) = (index(x - self.x, self.size[0])?, index(z - self.z, self.size[1])?);
        Some(self.pixel(i, k)).filter(|y| y.is_finite())
    }
}
