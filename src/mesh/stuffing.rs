use rayon::prelude::*;

use super::MeshError;
use super::domain::{InnerTissue, crossing};
use super::lattice::{Lattice, STEPS, is_long};
use super::stencil::{Corner, cut_tetrahedron};
use crate::control::{Cancelled, Control};
use crate::geometry::Point;

/// A cut nearer to a vertex than this share of a long edge pulls the vertex onto the surface.
const SNAP_LONG: f64 = 0.24999;
/// The same for a short edge.
const SNAP_SHORT: f64 = 0.41189;

/// Most tetrahedra that a mesh may have.
pub(super) const MOST_TETRAHEDRA: u64 = 2_000_000;

/// Vertices evaluated between two looks at the cancel flag.
const CHUNK: usize = 4096;

/// Tetrahedra with shared nodes, all of positive volume.
#[derive(Debug, Clone, Default)]
pub(super) struct TetMesh {
    pub(super) positions: Vec<Point>,
    pub(super) tetrahedra: Vec<[u32; 4]>,
}

/// Fills the inner tissue with tetrahedra of a body-centred cubic lattice whose edges are `edge` long.
///
/// # Source
/// Labelle and Shewchuk, Isosurface stuffing: fast tetrahedral meshes with good dihedral angles, SIGGRAPH 2007; uniform lattice.
pub(super) fn stuff(inner: &InnerTissue<'_>, edge: f64, control: &Control) -> Result<TetMesh, MeshError> {
    refuse_too_many(inner, edge)?;
    let lattice = Lattice::covering(&inner.domain.region.bounds, edge);
    let n = lattice.vertex_count();
    let mut values = evaluate(inner, &lattice, n, control)?;
    if !values.iter().any(|v| *v < 0.0) {
        return Err(MeshError::NoTissue);
    }
    control.report(0.4);
    let cuts = CutEdges::find(inner, &lattice, &values, control)?;
    control.report(0.8);
    let snapped = snap(&lattice, &cuts, &mut values);
    control.check()?;
    Ok(fill(inner, &lattice, &values, &snapped, &cuts))
}

/// Estimates the number of tetrahedra from a coarse sampling: a cube of the lattice holds twelve.
fn refuse_too_many(inner: &InnerTissue<'_>, edge: f64) -> Result<(), MeshError> {
    let bounds = inner.domain.region.bounds;
    let extent = bounds.max - bounds.min;
    if !(0..3).all(|a| extent[a] > 0.0 && extent[a].is_finite()) {
        return Err(MeshError::NoTissue);
    }
    let box_volume = extent.product();
    let step = (box_volume / 50_000.0).cbrt().max(edge);
    let counts = [0, 1, 2].map(|a| (extent[a] / step).ceil().max(1.0) as usize);
    let total: usize = counts.iter().product();
    let inside = (0..total)
        .into_par_iter()
        .filter(|&c| {
            let at = [c % counts[0], c / counts[0] % counts[1], c / (counts[0] * counts[1])];
            let p = Point::from([0, 1, 2].map(|a| bounds.min[a] + extent[a] * (at[a] as f64 + 0.5) / counts[a] as f64));
            inner.value_side(&p).0 < 0.0
        })
        .count();
    let found = (12.0 * box_volume * inside as f64 / total as f64 / edge.powi(3)).round() as u64;
    // The lattice of the box must also fit into memory where the tissue is a thin shell in it.
    let lattice = (2.0 * box_volume / edge.powi(3)) as u64;
    if found > MOST_TETRAHEDRA || lattice > 20 * MOST_TETRAHEDRA {
        return Err(MeshError::TooLarge { edge_mm: edge, found: found.max(lattice), allowed: MOST_TETRAHEDRA });
    }
    Ok(())
}

fn evaluate(inner: &InnerTissue<'_>, lattice: &Lattice, n: usize, control: &Control) -> Result<Vec<f64>, Cancelled> {
    let mut values = vec![0.0; n];
    values.par_chunks_mut(CHUNK).enumerate().try_for_each(|(chunk, out)| {
        control.check()?;
        for (i, value) in out.iter_mut().enumerate() {
            *value = inner.value_side(&lattice.position(chunk * CHUNK + i)).0;
        }
        Ok(())
    })?;
    Ok(values)
}

/// Cut points on lattice edges whose ends differ in sign, sorted by owner and step.
struct CutEdges {
    /// `7 * owner + step`, rising; the edge runs from the owner along one of the first seven [`STEPS`].
    keys: Vec<u64>,
    /// Share of the edge from the owner to the cut.
    shares: Vec<f64>,
}

impl CutEdges {
    fn find(inner: &InnerTissue<'_>, lattice: &Lattice, values: &[f64], control: &Control) -> Result<Self, Cancelled> {
        let chunks = values.len().div_ceil(CHUNK);
        let found: Result<Vec<Vec<(u64, f64)>>, Cancelled> = (0..chunks)
            .into_par_iter()
            .map(|chunk| {
                control.check()?;
                let mut out = Vec::new();
                for v in chunk * CHUNK..((chunk + 1) * CHUNK).min(values.len()) {
                    for step in 0..7 {
                        let Some(u) = lattice.neighbour(v, step) else { continue };
                        if values[v] * values[u] >= 0.0 {
                            continue;
                        }
                        let (from, to) = (lattice.position(v), lattice.position(u));
                        let share = crossing(0.0, 1.0, values[v], values[u], 1e-4, |s| {
                            inner.value_side(&(from + (to - from) * s)).0
                        });
                        out.push(((7 * v + step) as u64, share));
                    }
                }
                Ok(out)
            })
            .collect();
        let (keys, shares) = found?.into_iter().flatten().unzip();
        Ok(Self { keys, shares })
    }

    /// Place of the edge from `v` along `step` and whether `v` owns it.
    fn place(&self, v: usize, u: usize, step: usize) -> Option<(usize, bool)> {
        let (key, owns) = if step < 7 { (7 * v + step, true) } else { (7 * u + step - 7, false) };
        self.keys.binary_search(&(key as u64)).ok().map(|at| (at, owns))
    }
}

/// Pulls vertices onto near cuts: sets their values to 0 and returns where they went (vertex, position), rising.
fn snap(lattice: &Lattice, cuts: &CutEdges, values: &mut [f64]) -> Vec<(usize, Point)> {
    let mut moved = Vec::new();
    for v in 0..values.len() {
        if values[v] == 0.0 {
            continue;
        }
        let mut best: Option<(f64, Point)> = None;
        for step in 0..14 {
            let Some(u) = lattice.neighbour(v, step) else { continue };
            // A snapped neighbour has value 0: its edges are no longer cut.
            if values[v] * values[u] >= 0.0 {
                continue;
            }
            let Some((at, owns)) = cuts.place(v, u, step) else { continue };
            let share = if owns { cuts.shares[at] } else { 1.0 - cuts.shares[at] };
            let limit = if is_long(step) { SNAP_LONG } else { SNAP_SHORT };
            if share < limit {
                let (from, to) = (lattice.position(v), lattice.position(u));
                let distance = share * (to - from).norm();
                if best.is_none_or(|(d, _)| distance < d) {
                    best = Some((distance, from + (to - from) * share));
                }
            }
        }
        if let Some((_, position)) = best {
            values[v] = 0.0;
            moved.push((v, position));
        }
    }
    moved
}

/// Applies the stencils and numbers the nodes in order of first use.
fn fill(
    inner: &InnerTissue<'_>,
    lattice: &Lattice,
    values: &[f64],
    snapped: &[(usize, Point)],
    cuts: &CutEdges,
) -> TetMesh {
    let n = values.len();
    let position = |node: u32| {
        let node = node as usize;
        if node >= n {
            let key = cuts.keys[node - n] as usize;
            let (v, step) = (key / 7, key % 7);
            let from = lattice.position(v);
            let to = lattice.neighbour(v, step).map_or(from, |u| lattice.position(u));
            return from + (to - from) * cuts.shares[node - n];
        }
        match snapped.binary_search_by_key(&node, |s| s.0) {
            Ok(at) => snapped[at].1,
            Err(_) => lattice.position(node),
        }
    };
    // Cut nodes are numbered after the lattice's vertices.
    let cut = |a: u32, b: u32| {
        let (ca, cb) = (lattice.coordinates(a as usize), lattice.coordinates(b as usize));
        let step = STEPS.iter().position(|s| (0..3).all(|i| ca[i] + s[i] == cb[i])).unwrap_or(0);
        let at = cuts.place(a as usize, b as usize, step).map_or(0, |(at, _)| at);
        (n + at) as u32
    };
    let shorter = |[a, b, c, d]: [u32; 4]| {
        let first = (position(c) - position(a)).norm_squared();
        let second = (position(d) - position(b)).norm_squared();
        first < second || (first == second && a.min(c) < b.min(d))
    };
    let mut raw = Vec::new();
    for v in lattice.corner_indices() {
        for axis in 0..3 {
            for t in lattice.tetrahedra(v, axis) {
                let corners = t.map(|node| Corner { node, value: values[node as usize] });
                if corners.iter().all(|c| c.value == 0.0) {
                    // Wholly on the surface: inside or outside by its centre.
                    let centre = t.iter().fold(Point::origin(), |s, &i| s + position(i).coords * 0.25);
                    if inner.value_side(&centre).0 < 0.0 {
                        raw.push(t);
                    }
                    continue;
                }
                cut_tetrahedron(corners, cut, shorter, &mut raw);
            }
        }
    }
    let mut number = vec![u32::MAX; n + cuts.keys.len()];
    let mut mesh = TetMesh::default();
    for t in raw {
        let mut t = t.map(|node| {
            let slot = &mut number[node as usize];
            if *slot == u32::MAX {
                *slot = mesh.positions.len() as u32;
                mesh.positions.push(position(node));
            }
            *slot
        });
        let [a, b, c, d] = t.map(|i| mesh.positions[i as usize]);
        if (b - a).cross(&(c - a)).dot(&(d - a)) < 0.0 {
            t.swap(2, 3);
        }
        mesh.tetrahedra.push(t);
    }
    mesh
}
