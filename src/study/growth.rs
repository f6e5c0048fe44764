use std::io::Write;
use std::path::Path;
use std::time::Instant;

use super::chart::{self, Curve, Labels, color};
use super::error::{BenchError, write};
use super::files::{read_surface, refuse_unwritable};
use prosopon_field::{FieldSettings, Method, MethodSettings, SignedField};
use prosopon_geometry::control::Control;
use prosopon_geometry::{Point, TriMesh, decimate};

/// Requested numbers of triangles, ascending; surfaces finer than the input are subdivided from decimated ones.
const TRIANGLES: [usize; 8] = [12_000, 24_000, 48_000, 96_000, 192_000, 384_000, 768_000, 1_000_000];
/// Half-width of the band and margin, mm.
const BAND_MM: f64 = 5.0;
/// Number of times each field is built; the shortest time counts.
const ROUNDS: usize = 3;

/// Measures the build time of a field against the number of triangles, for all builders at 0.8 mm.
///
/// Coarser surfaces come from quadric decimation, finer ones from halving all edges, which does not change the shape.
#[derive(Debug)]
pub struct GrowthStudy<'a> {
    /// Surface file.
    pub mesh: &'a Path,
    /// Where the rows go; the chart gets the same name with `.svg`.
    pub csv: &'a Path,
}

impl GrowthStudy<'_> {
    /// Runs the study; prints to `out`.
    ///
    /// # Errors
    /// [`BenchError`].
    pub fn run(&self, out: &mut dyn Write) -> Result<(), BenchError> {
        refuse_unwritable(self.csv)?;
        let surface = read_surface(self.mesh)?;
        let mut csv = String::from("method,triangles,build_wall_s\n");
        write!(out, "{csv}")?;
        let mut curves: Vec<(Method, Vec<(f64, f64)>)> = Method::ALL.map(|m| (m, Vec::new())).into();
        for wanted in TRIANGLES {
            let mesh = with_triangles(&surface, wanted);
            for (method, curve) in &mut curves {
                let wall_s = build_s(&mesh, *method)?;
                let row = format!("{},{},{wall_s:.4}\n", method.name(), mesh.triangles().len());
                write!(out, "{row}")?;
                csv += &row;
                curve.push((mesh.triangles().len() as f64, wall_s));
                write(self.csv, csv.as_bytes())?;
            }
        }
        let curves = curves.into_iter().map(|(method, points)| {
            // From here on the number of triangles, not the number of nodes, determines the cost.
            let large: Vec<(f64, f64)> = points.iter().copied().filter(|p| p.0 > 90_000.0).collect();
            let name = format!("{} ({:.2}, {:.2})", method.name(), exponent(&points), exponent(&large));
            Curve { name, color: color(method), points, marks: Vec::new() }
        });
        let curves: Vec<Curve> = curves.collect();
        for curve in &curves {
            writeln!(out, "{}: fitted exponents (all sizes, from 96 000 triangles)", curve.name)?;
        }
        let labels = Labels {
            title: "Build time of a field (fitted exponents: all sizes, from 96 000 triangles)",
            x: "triangles",
            y: "build, s",
        };
        let svg = self.csv.with_extension("svg");
        write(&svg, chart::draw(&labels, &curves)?.as_bytes())?;
        writeln!(out, "wrote {} and {}", self.csv.display(), svg.display())?;
        Ok(())
    }
}

fn build_s(mesh: &TriMesh, method: Method) -> Result<f64, BenchError> {
    let field = FieldSettings { spacing_mm: 0.8, band_mm: BAND_MM, margin_mm: BAND_MM };
    let settings = MethodSettings { method, field, ..MethodSettings::default() };
    let mut best = f64::INFINITY;
    for _ in 0..ROUNDS {
        let start = Instant::now();
        SignedField::build_only(mesh, &settings, &Control::new())
            .map_err(|source| BenchError::Field { method: method.name(), source })?;
        best = best.min(start.elapsed().as_secs_f64());
    }
    Ok(best)
}

/// The surface with about `wanted` triangles: decimated, or subdivided from a decimated one.
fn with_triangles(surface: &TriMesh, wanted: usize) -> TriMesh {
    let own = surface.triangles().len();
    let mut halvings = 0u32;
    while wanted > own * 4usize.pow(halvings) + own / 20 {
        halvings += 1;
    }
    let base = wanted / 4usize.pow(halvings);
    let start = if base + own / 20 < own { decimate(surface, f64::INFINITY, base).0 } else { surface.clone() };
    (0..halvings).fold(start, |mesh, _| halved(&mesh))
}

/// The surface with all edges halved, which divides each triangle into four.
fn halved(mesh: &TriMesh) -> TriMesh {
    let mut edges: Vec<(u32, u32)> = mesh
        .triangles()
        .iter()
        .flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)])
        .map(|(a, b)| (a.min(b), a.max(b)))
        .collect();
    edges.sort_unstable();
    edges.dedup();
    let mut positions = mesh.positions().to_vec();
    let n_corners = positions.len() as u32;
    let middles: Vec<Point> =
        edges.iter().map(|&(a, b)| nalgebra::center(&positions[a as usize], &positions[b as usize])).collect();
    positions.extend(middles);
    let middle = |a: u32, b: u32| {
        let place = edges.partition_point(|e| *e < (a.min(b), a.max(b)));
        n_corners + place as u32
    };
    let triangles = mesh.triangles().iter().flat_map(|&[a, b, c]| {
        let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
        [[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]
    });
    // Vertices of a valid mesh and the midpoints between them are finite, and all indices are in range.
    TriMesh::new(positions, triangles.collect()).unwrap_or_else(|_| mesh.clone())
}

/// Exponent of a fitted power law: slope of the line fitted to the logarithms.
pub(super) fn exponent(points: &[(f64, f64)]) -> f64 {
    let n = points.len() as f64;
    let logs = || points.iter().map(|(x, y)| (x.ln(), y.ln()));
    let (mx, my) = logs().fold((0.0, 0.0), |(sx, sy), (x, y)| (sx + x / n, sy + y / n));
    let (sxy, sxx) = logs().fold((0.0, 0.0), |(xy, xx), (x, y)| (xy + (x - mx) * (y - my), xx + (x - mx) * (x - mx)));
    sxy / sxx
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halving_keeps_the_surface_and_the_exponent_of_a_power_is_found() {
        let p = vec![Point::origin(), Point::new(1.0, 0.0, 0.0), Point::new(0.0, 1.0, 0.0), Point::new(0.0, 0.0, 1.0)];
        let mesh = TriMesh::new(p, vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]).unwrap();
        let finer = with_triangles(&mesh, 64);
        assert_eq!(finer.triangles().len(), 64);
        assert!((finer.area() - mesh.area()).abs() < 1e-12 && (finer.volume() - mesh.volume()).abs() < 1e-12);
        let power: Vec<(f64, f64)> = (1..5).map(|n| (f64::from(n), 3.0 * f64::from(n).powf(1.25))).collect();
        assert!((exponent(&power) - 1.25).abs() < 1e-12);
    }
}
