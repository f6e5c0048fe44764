//! Rigid bodies of the hard scenes, each with its top at z = 0.

use std::f64::consts::{PI, TAU};

use prosopon_geometry::{Implicit, Point, TriMesh, Vector};

/// The half-space below z = 0.
#[derive(Debug)]
pub(super) struct Floor;

impl Implicit for Floor {
    fn value(&self, p: &Point) -> f64 {
        p.z
    }

    fn value_gradient(&self, p: &Point) -> (f64, Vector) {
        (p.z, Vector::z())
    }
}

/// A square plate with rounded edges.
#[derive(Debug)]
pub(super) struct Plate {
    pub(super) half_width_mm: f64,
    pub(super) thickness_mm: f64,
    /// At most half the thickness.
    pub(super) edge_radius_mm: f64,
}

impl Implicit for Plate {
    fn value(&self, p: &Point) -> f64 {
        self.value_gradient(p).0
    }

    fn value_gradient(&self, p: &Point) -> (f64, Vector) {
        let (inner, r) = (self.half_width_mm - self.edge_radius_mm, self.edge_radius_mm);
        let centre = Point::new(0.0, 0.0, -0.5 * self.thickness_mm);
        let d = p - centre;
        let q = d.abs() - Vector::new(inner, inner, 0.5 * self.thickness_mm - r);
        let sign = d.map(f64::signum);
        let deepest = q.imax();
        let (distance, normal) = if q[deepest] <= 0.0 {
            (q[deepest], Vector::ith(deepest, 1.0))
        } else {
            let out = q.map(|c| c.max(0.0));
            (out.norm(), out.normalize())
        };
        (distance - r, normal.component_mul(&sign))
    }
}

/// A plate on a stem, which prevents tissue from passing through its middle.
#[derive(Debug)]
pub(super) struct Table {
    pub(super) top: Plate,
    /// Stem; at least as high as the tissue reaches below the top.
    pub(super) stem: Plate,
}

impl Implicit for Table {
    fn value(&self, p: &Point) -> f64 {
        self.value_gradient(p).0
    }

    fn value_gradient(&self, p: &Point) -> (f64, Vector) {
        let (top, stem) = (self.top.value_gradient(p), self.stem.value_gradient(p));
        if top.0 <= stem.0 { top } else { stem }
    }
}

/// Triangles of a ball with its upper pole at `pole`, up to the polar angle `open_at` (pi: closed); vertices are on the sphere.
pub(super) fn ball(pole: Point, radius_mm: f64, open_at: f64) -> (Vec<Point>, Vec<[u32; 3]>) {
    const RINGS: usize = 40;
    const SECTORS: usize = 72;
    let centre = pole - Vector::z() * radius_mm;
    let rings = ((RINGS as f64 * open_at / PI).round() as usize).clamp(2, RINGS);
    let closed = rings == RINGS;
    let mut points = vec![pole];
    let last = if closed { rings - 1 } else { rings };
    for ring in 1..=last {
        let theta = PI * ring as f64 / RINGS as f64;
        for sector in 0..SECTORS {
            let phi = TAU * sector as f64 / SECTORS as f64;
            points
                .push(centre + Vector::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()) * radius_mm);
        }
    }
    let at = |ring: usize, sector: usize| (1 + (ring - 1) * SECTORS + sector % SECTORS) as u32;
    let mut triangles: Vec<[u32; 3]> = (0..SECTORS).map(|s| [0, at(1, s), at(1, s + 1)]).collect();
    for ring in 1..last {
        for s in 0..SECTORS {
            let [a, b, c, d] = [at(ring, s), at(ring + 1, s), at(ring + 1, s + 1), at(ring, s + 1)];
            triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    if closed {
        let south = points.len() as u32;
        points.push(centre - Vector::z() * radius_mm);
        triangles.extend((0..SECTORS).map(|s| [south, at(last, s + 1), at(last, s)]));
    }
    (points, triangles)
}

/// Joins several surfaces, which may cross, into one.
pub(super) fn together(parts: Vec<(Vec<Point>, Vec<[u32; 3]>)>) -> Option<TriMesh> {
    let (mut points, mut triangles) = (Vec::new(), Vec::new());
    for (own, faces) in parts {
        let first = points.len() as u32;
        points.extend(own);
        triangles.extend(faces.into_iter().map(|t| t.map(|v| v + first)));
    }
    TriMesh::new(points, triangles).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ball_is_closed_outwards_unless_it_is_opened() {
        let pole = Point::new(0.0, 0.0, 0.0);
        let closed = together(vec![ball(pole, 10.0, PI)]).unwrap();
        let exact = 4.0 / 3.0 * PI * 1000.0;
        assert!((closed.volume() / exact - 1.0).abs() < 0.01, "{}", closed.volume());
        assert!(closed.bounds().max.z.abs() < 1e-12);
        let open = together(vec![ball(pole, 10.0, 0.7 * PI)]).unwrap();
        assert!(open.triangles().len() < closed.triangles().len());
    }

    #[test]
    fn the_plates_gradient_is_that_of_its_value() {
        let plate = Plate { half_width_mm: 8.0, thickness_mm: 1.0, edge_radius_mm: 0.4 };
        assert!(plate.value(&Point::origin()).abs() < 1e-12);
        for p in [
            Point::new(1.0, 2.0, 0.3),
            Point::new(8.5, -3.0, -0.2),
            Point::new(-8.2, 8.3, 0.1),
            Point::new(0.3, 0.1, -2.0),
        ] {
            let (value, gradient) = plate.value_gradient(&p);
            for axis in 0..3 {
                let h = Vector::ith(axis, 1e-6);
                let slope = (plate.value(&(p + h)) - plate.value(&(p - h))) / 2e-6;
                assert!((slope - gradient[axis]).abs() < 1e-6, "{p} {value}");
            }
        }
    }
}
