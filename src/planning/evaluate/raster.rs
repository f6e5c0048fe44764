//! Orthographic z-buffer renderer for shaded triangles.

use super::colour::{NO_VALUE, SKIN, diverging};
use prosopon_geometry::{Point, TriMesh, Vector};

/// RGB pixels, row by row from the top left.
#[derive(Debug, Clone)]
pub(super) struct Canvas {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) pixels: Vec<[u8; 3]>,
}

impl Canvas {
    pub(super) fn white(width: usize, height: usize) -> Self {
        Self { width, height, pixels: vec![[255; 3]; width * height] }
    }

    /// Sets a pixel; positions outside the canvas are ignored.
    pub(super) fn set(&mut self, x: usize, y: usize, colour: [u8; 3]) {
        if x < self.width && y < self.height {
            self.pixels[y * self.width + x] = colour;
        }
    }

    /// Copies `other` with its top left at `(x, y)`.
    pub(super) fn paste(&mut self, other: &Self, x: usize, y: usize) {
        for row in 0..other.height {
            for column in 0..other.width {
                self.set(x + column, y + row, other.pixels[row * other.width + column]);
            }
        }
    }

    /// Halves the size by averaging blocks of 2 × 2 pixels.
    pub(super) fn halved(&self) -> Self {
        let (width, height) = (self.width / 2, self.height / 2);
        let mut out = Self::white(width, height);
        for y in 0..height {
            for x in 0..width {
                let four =
                    [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(i, j)| self.pixels[(2 * y + j) * self.width + 2 * x + i]);
                let mean = |c: usize| (four.iter().map(|p| u16::from(p[c])).sum::<u16>() + 2) / 4;
                out.pixels[y * width + x] = std::array::from_fn(|c| mean(c) as u8);
            }
        }
        out
    }
}

/// Parallel projection; `centre` is projected onto the middle of the canvas.
#[derive(Debug, Clone, Copy)]
pub(super) struct Camera {
    pub(super) centre: Point,
    /// Unit axes of the picture: right, up, and into the scene.
    pub(super) right: Vector,
    pub(super) up: Vector,
    pub(super) into: Vector,
    pub(super) pixels_per_mm: f64,
}

impl Camera {
    /// Column and row (pixel centres at half-integers) and depth in mm.
    fn project(&self, canvas: &Canvas, p: &Point) -> [f64; 3] {
        let d = p - self.centre;
        let x = 0.5 * canvas.width as f64 + self.right.dot(&d) * self.pixels_per_mm;
        let y = 0.5 * canvas.height as f64 - self.up.dot(&d) * self.pixels_per_mm;
        [x, y, self.into.dot(&d)]
    }
}

/// A lamp above the viewer's left shoulder, and enough ambient light to keep colours readable.
struct Light {
    towards_eye: Vector,
    towards_lamp: Vector,
    halfway: Vector,
}

impl Light {
    fn of(camera: &Camera) -> Self {
        let towards_eye = -camera.into;
        let towards_lamp = (towards_eye + 0.45 * camera.up - 0.3 * camera.right).normalize();
        Self { towards_eye, towards_lamp, halfway: (towards_eye + towards_lamp).normalize() }
    }

    /// Shades a colour on a surface with `normal`, which may face either side and have any length.
    fn on(&self, colour: [u8; 3], normal: &Vector) -> [u8; 3] {
        let n = normal.try_normalize(1e-12).unwrap_or(self.towards_eye);
        let n = if n.dot(&self.towards_eye) < 0.0 { -n } else { n };
        let bright = 0.4 + 0.6 * n.dot(&self.towards_lamp).max(0.0);
        let gloss = 20.0 * n.dot(&self.halfway).max(0.0).powi(24);
        colour.map(|c| (f64::from(c) * bright + gloss).round().min(255.0) as u8)
    }
}

/// Values of a surface's vertices and the range of their colours.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Coloured<'a> {
    /// Value of each vertex, mm; NaN is drawn grey.
    pub values: &'a [f32],
    /// The diverging colour map covers the range from `-limit_mm` to `limit_mm`, mm.
    pub limit_mm: f64,
}

/// How surfaces are lit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Shading {
    /// By the lamp.
    Lit,
    /// Not at all: the plain colours.
    #[cfg(test)]
    Flat,
}

/// Draws `mesh` with normals interpolated between the vertices.
/// `values` are coloured by the diverging map up to their limit; without them the mesh has skin colour.
pub(super) fn draw(
    canvas: &mut Canvas,
    camera: &Camera,
    mesh: &TriMesh,
    values: Option<Coloured<'_>>,
    shading: Shading,
) {
    let mut depth = vec![f64::INFINITY; canvas.pixels.len()];
    let normals = mesh.vertex_normals();
    let projected: Vec<[f64; 3]> = mesh.positions().iter().map(|p| camera.project(canvas, p)).collect();
    let light = Light::of(camera);
    // A missing or non-finite value is drawn in the colour for "no value".
    let value_at =
        |v: u32| values.and_then(|coloured| coloured.values.get(v as usize)).map_or(f64::NAN, |v| f64::from(*v));
    for triangle in mesh.triangles() {
        let [a, b, c] = triangle.map(|v| projected[v as usize]);
        let twice_area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
        if twice_area == 0.0 || !twice_area.is_finite() {
            continue;
        }
        let span = |i: usize, size: usize| {
            let low = a[i].min(b[i]).min(c[i]) - 0.5;
            let high = a[i].max(b[i]).max(c[i]) - 0.5;
            // Covers the pixels whose centres lie inside; casts saturate.
            (low.ceil().max(0.0) as usize, ((high.floor() + 1.0).max(0.0) as usize).min(size))
        };
        let (x0, x1) = span(0, canvas.width);
        let (y0, y1) = span(1, canvas.height);
        let bent = triangle.map(|v| normals[v as usize]);
        let triple = triangle.map(value_at);
        for y in y0..y1 {
            for x in x0..x1 {
                let (px, py) = (x as f64 + 0.5, y as f64 + 0.5);
                let wb = ((px - a[0]) * (c[1] - a[1]) - (py - a[1]) * (c[0] - a[0])) / twice_area;
                let wc = ((b[0] - a[0]) * (py - a[1]) - (b[1] - a[1]) * (px - a[0])) / twice_area;
                let w = [1.0 - wb - wc, wb, wc];
                if w.iter().any(|w| *w < 0.0) {
                    continue;
                }
                let mixed = |v: [f64; 3]| w[0] * v[0] + w[1] * v[1] + w[2] * v[2];
                let z = mixed([a[2], b[2], c[2]]);
                let place = y * canvas.width + x;
                if z >= depth[place] {
                    continue;
                }
                depth[place] = z;
                let base = match values {
                    None => SKIN,
                    Some(Coloured { limit_mm, .. }) => {
                        let value = mixed(triple);
                        if value.is_finite() { diverging(value, limit_mm) } else { NO_VALUE }
                    }
                };
                canvas.pixels[place] = match shading {
                    Shading::Lit => light.on(base, &(bent[0] * w[0] + bent[1] * w[1] + bent[2] * w[2])),
                    #[cfg(test)]
                    Shading::Flat => base,
                };
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> Camera {
        Camera { centre: Point::origin(), right: Vector::x(), up: Vector::z(), into: Vector::y(), pixels_per_mm: 1.0 }
    }

    #[test]
    fn a_triangle_covers_exactly_the_pixel_centres_inside() {
        // Corners in pixels: (1, 9), (9, 9), (1, 1) on a canvas of 10 × 10.
        let p = vec![Point::new(-4.0, 0.0, -4.0), Point::new(4.0, 0.0, -4.0), Point::new(-4.0, 0.0, 4.0)];
        let mesh = TriMesh::new(p, vec![[0, 1, 2]]).unwrap();
        let mut canvas = Canvas::white(10, 10);
        draw(&mut canvas, &camera(), &mesh, None, Shading::Flat);
        for y in 0..10 {
            for x in 0..10 {
                let (px, py) = (x as f64 + 0.5, y as f64 + 0.5);
                let inside = px > 1.0 && py < 9.0 && px <= py;
                let expected = if inside { SKIN } else { [255; 3] };
                assert_eq!(canvas.pixels[y * 10 + x], expected, "({x}, {y})");
            }
        }
    }

    #[test]
    fn the_nearer_triangle_wins_and_values_colour_it() {
        let at = |y: f64| [Point::new(-8.0, y, -8.0), Point::new(8.0, y, -8.0), Point::new(0.0, y, 8.0)];
        let p: Vec<Point> = at(5.0).into_iter().chain(at(-5.0)).collect();
        let mesh = TriMesh::new(p, vec![[3, 4, 5], [0, 1, 2]]).unwrap();
        let mut canvas = Canvas::white(10, 10);
        let values = [3.0, 3.0, 3.0, -3.0, -3.0, -3.0];
        draw(&mut canvas, &camera(), &mesh, Some(Coloured { values: &values, limit_mm: 3.0 }), Shading::Flat);
        assert_eq!(canvas.pixels[55], diverging(-3.0, 3.0));
        draw(&mut canvas, &camera(), &mesh, Some(Coloured { values: &[f32::NAN; 6], limit_mm: 3.0 }), Shading::Flat);
        assert_eq!(canvas.pixels[55], NO_VALUE);
    }
}
