//! Exact winding numbers on a lattice, from the crossings of its rows with the surface.

use super::lanes::with_vectors;
use super::ray::is_left;
use super::rim::{Cap, Rim};
use prosopon_geometry::{Point, TriMesh};
use rayon::prelude::*;
use robust::{Coord, orient2d};

/// A lattice of nodes, x fastest.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rows {
    pub(super) origin: Point,
    pub(super) spacing: f64,
    pub(super) dims: [usize; 3],
}

/// Changes of the winding number along the rows of a lattice.
#[derive(Debug, Clone)]
pub(super) struct Crossings {
    /// Number of rows in a layer.
    ny: usize,
    /// All crossings, sorted.
    all: Vec<Crossing>,
}

/// Packed crossing: row (y fastest, from bit 32), first node behind it (from bit 10), change plus 512.
type Crossing = u64;

/// Largest change that one crossing can store.
const MOST: i32 = 511;

fn packed(row: u64, node: u64, change: i32) -> Crossing {
    row << 32 | node << 10 | (change + MOST + 1) as u64
}

impl Crossings {
    /// Finds where the rows of `rows` cross the counted triangles of `mesh` and the caps of its rim.
    ///
    /// Rows that meet an edge or a vertex are treated as if shifted by an infinitesimal amount, so that every closed surface is
    /// crossed as often inwards as outwards.
    pub(super) fn new(mesh: &TriMesh, counts: &[bool], rim: &Rim, rows: &Rows) -> Self {
        let parts: Vec<Vec<Crossing>> = (0..mesh.triangles().len())
            .into_par_iter()
            .filter(|&t| counts[t])
            .fold(Vec::new, |mut found, t| {
                with_vectors(
                    #[inline(always)]
                    || cross(&mesh.corners(t), 1, rows, &mut found),
                );
                found
            })
            .collect();
        let mut all = Vec::with_capacity(parts.iter().map(Vec::len).sum());
        parts.into_iter().for_each(|mut part| all.append(&mut part));
        for Cap { corners, times } in rim.caps() {
            // A change that exceeds one crossing is split.
            let mut rest = times;
            while rest != 0 {
                let part = rest.clamp(-MOST, MOST);
                cross(&corners, part, rows, &mut all);
                rest -= part;
            }
        }
        all.par_sort_unstable();
        Self { ny: rows.dims[1], all }
    }

    /// Visits runs of nodes with a nonzero winding number, in rows `first_row..` of layer `k`.
    ///
    /// The winding number is that of the closed surface. Calls `run(row, first, last, winding)` for the nodes from `first` up
    /// to before `last`.
    pub(super) fn for_runs(
        &self,
        k: usize,
        rows: std::ops::Range<usize>,
        nx: usize,
        mut run: impl FnMut(usize, usize, usize, i32),
    ) {
        let before = |row: usize| self.all.partition_point(|c| ((c >> 32) as usize) < row + self.ny * k);
        let (start, end) = (before(rows.start), before(rows.end));
        for row in self.all[start..end].chunk_by(|a, b| a >> 32 == b >> 32) {
            let mut winding = 0;
            for (n, crossing) in row.iter().enumerate() {
                winding += (crossing & 0x3ff) as i32 - MOST - 1;
                let node = |c: &Crossing| (c >> 10 & 0x3f_ffff) as usize;
                let last = row.get(n + 1).map_or(nx, node);
                if winding != 0 && node(crossing) < last {
                    run((crossing >> 32) as usize - self.ny * k, node(crossing), last, winding);
                }
            }
        }
    }
}

/// Adds the crossings of one triangle with the rows along x.
#[inline(always)]
fn cross(corners: &[Point; 3], times: i32, rows: &Rows, found: &mut Vec<Crossing>) {
    let flat = corners.map(|p| Coord { x: p.y, y: p.z });
    let [a, b, c] = flat;
    let area = orient2d(a, b, c);
    if area == 0.0 {
        return;
    }
    let range = |axis: usize, min: f64, max: f64| {
        let first = ((min - rows.origin[axis]) / rows.spacing - 1e-6).ceil().max(0.0);
        let last = ((max - rows.origin[axis]) / rows.spacing + 1e-6).floor().min((rows.dims[axis] - 1) as f64);
        (first <= last).then_some(first as usize..=last as usize)
    };
    let extent = |f: fn(&Point) -> f64| {
        let v = [f(&corners[0]), f(&corners[1]), f(&corners[2])];
        (v[0].min(v[1]).min(v[2]), v[0].max(v[1]).max(v[2]))
    };
    let ((y_min, y_max), (z_min, z_max), (x_min, x_max)) = (extent(|p| p.y), extent(|p| p.z), extent(|p| p.x));
    let (Some(js), Some(ks)) = (range(1, y_min, y_max), range(2, z_min, z_max)) else { return };
    let positive = area > 0.0;
    for k in ks {
        for j in js.clone() {
            let p = Coord { x: rows.origin.y + rows.spacing * j as f64, y: rows.origin.z + rows.spacing * k as f64 };
            let (wa, wb, wc) = (orient2d(b, c, p), orient2d(c, a, p), orient2d(a, b, p));
            if is_left(wa, b, c) != positive || is_left(wb, c, a) != positive || is_left(wc, a, b) != positive {
                continue;
            }
            let x = (wa * corners[0].x + wb * corners[1].x + wc * corners[2].x) / (wa + wb + wc);
            let x = if x.is_finite() { x.clamp(x_min, x_max) } else { x_min };
            let node = ((x - rows.origin.x) / rows.spacing).ceil().max(0.0);
            if node < rows.dims[0] as f64 {
                // Where the normal points along +x the row leaves the solid.
                found.push(packed((j + rows.dims[1] * k) as u64, node as u64, if positive { -times } else { times }));
            }
        }
    }
}
