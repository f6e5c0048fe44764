use rayon::prelude::*;

use super::MeshError;
use super::adjacency::{Rows, sorted};
use super::domain::{InnerTissue, crossing};
use super::lattice::Lattice;
use super::refined_lattice::RefinedLattice;
use super::stencil::{Corner, cut_tetrahedron};
use super::tuning::{MAX_TETRAHEDRA, SNAP_LONG, SNAP_SHORT};
use prosopon_geometry::Point;
use prosopon_geometry::control::{Cancelled, Control};

/// Length of short edges relative to the edge of their cube.
const SHORT: f64 = 0.866_025_403_784_438_6;

/// Number of tetrahedra in a refined cube.
const IN_REFINED: u64 = 96;

/// Vertices evaluated between two checks for cancellation.
const CHUNK: usize = 4096;

/// Tetrahedra with shared nodes; all have positive volume.
#[derive(Debug, Clone, Default)]
pub(super) struct TetMesh {
    pub(super) positions: Vec<Point>,
    pub(super) tetrahedra: Vec<[u32; 4]>,
}

/// The lattice over the region, unless it would have too many tetrahedra.
pub(super) fn lattice_over(inner: &InnerTissue<'_>, edge: f64) -> Result<Lattice, MeshError> {
    refuse_too_many(inner, edge)?;
    Ok(Lattice::covering(&inner.domain.region.bounds, edge))
}

/// The lattice with the marked cubes refined, unless it would have too many tetrahedra.
pub(super) fn refine(lattice: Lattice, refined: Vec<bool>, edge: f64) -> Result<RefinedLattice, MeshError> {
    let found = IN_REFINED * refined.iter().filter(|h| **h).count() as u64;
    if found > MAX_TETRAHEDRA {
        return Err(MeshError::TooLarge { edge_mm: edge, found, allowed: MAX_TETRAHEDRA });
    }
    Ok(RefinedLattice::new(lattice, refined))
}

/// Fills the inner tissue with tetrahedra of a lattice.
///
/// # Source
/// Labelle and Shewchuk, Isosurface stuffing: fast tetrahedral meshes with good dihedral angles, SIGGRAPH 2007. Their bounds
/// hold where the lattice is uniform.
pub(super) fn stuff(
    inner: &InnerTissue<'_>,
    lattice: &RefinedLattice,
    control: &Control,
) -> Result<TetMesh, MeshError> {
    let n = lattice.vertex_count();
    let mut values = evaluate(inner, lattice, n, control)?;
    if !values.iter().any(|v| *v < 0.0) {
        return Err(MeshError::NoTissue);
    }
    control.report(0.4);
    let cuts = CutEdges::find(inner, lattice, &values, control)?;
    control.report(0.8);
    let snapped = snap(inner.edge, lattice, &cuts, &mut values);
    control.check()?;
    Ok(fill(inner, lattice, &values, &snapped, &cuts))
}

/// Estimates the number of tetrahedra by coarse sampling; a cube of the lattice holds twelve.
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
    // The lattice of the box must also fit into memory when the tissue is only a thin shell in it.
    let lattice = (2.0 * box_volume / edge.powi(3)) as u64;
    if found > MAX_TETRAHEDRA || lattice > 20 * MAX_TETRAHEDRA {
        return Err(MeshError::TooLarge { edge_mm: edge, found: found.max(lattice), allowed: MAX_TETRAHEDRA });
    }
    Ok(())
}

fn evaluate(
    inner: &InnerTissue<'_>,
    lattice: &RefinedLattice,
    n: usize,
    control: &Control,
) -> Result<Vec<f64>, Cancelled> {
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

const EDGES: [[usize; 2]; 6] = [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]];

/// Edges of the lattice whose ends differ in sign, ascending, with the positions of their cuts.
struct CutEdges {
    /// Lower vertex first.
    ends: Vec<[u32; 2]>,
    /// Share of the edge from its first end to the cut.
    shares: Vec<f64>,
}

impl CutEdges {
    fn find(
        inner: &InnerTissue<'_>,
        lattice: &RefinedLattice,
        values: &[f64],
        control: &Control,
    ) -> Result<Self, Cancelled> {
        let owners = lattice.owners();
        let found: Result<Vec<Vec<[u32; 2]>>, Cancelled> = (0..owners.len().div_ceil(CHUNK))
            .into_par_iter()
            .map(|chunk| {
                control.check()?;
                let mut tetrahedra = Vec::new();
                let mut cut = Vec::new();
                for owner in chunk * CHUNK..((chunk + 1) * CHUNK).min(owners.end) {
                    tetrahedra.clear();
                    lattice.tetrahedra(owner, &mut tetrahedra);
                    let pairs = tetrahedra.iter().flat_map(|t| EDGES.map(|[i, j]| [t[i], t[j]]));
                    cut.extend(pairs.filter(|[a, b]| values[*a as usize] * values[*b as usize] < 0.0).map(sorted));
                }
                cut.sort_unstable();
                cut.dedup();
                Ok(cut)
            })
            .collect();
        let mut ends: Vec<[u32; 2]> = found?.into_iter().flatten().collect();
        ends.par_sort_unstable();
        ends.dedup();
        let mut shares = vec![0.0; ends.len()];
        shares.par_chunks_mut(CHUNK).zip(ends.par_chunks(CHUNK)).try_for_each(|(shares, ends)| {
            control.check()?;
            for (share, [a, b]) in shares.iter_mut().zip(ends) {
                let (from, to) = (lattice.position(*a as usize), lattice.position(*b as usize));
                *share = crossing(0.0, 1.0, values[*a as usize], values[*b as usize], 1e-4, |s| {
                    inner.value_side(&(from + (to - from) * s)).0
                });
            }
            Ok(())
        })?;
        Ok(Self { ends, shares })
    }

    fn place(&self, a: u32, b: u32) -> Option<usize> {
        self.ends.binary_search(&sorted([a, b])).ok()
    }

    /// The cut on edge `at`.
    fn position(&self, lattice: &RefinedLattice, at: usize) -> Point {
        let [from, to] = self.ends[at].map(|v| lattice.position(v as usize));
        from + (to - from) * self.shares[at]
    }
}

/// Moves vertices onto near cuts.
/// Sets their values to 0 and returns their new positions as (vertex, position), ascending.
fn snap(edge: f64, lattice: &RefinedLattice, cuts: &CutEdges, values: &mut [f64]) -> Vec<(usize, Point)> {
    let pairs = cuts.ends.iter().enumerate().flat_map(|(at, ends)| ends.map(|v| (v, at as u32)));
    let at_vertex = Rows::of(values.len(), pairs);
    let mut moved = Vec::new();
    for v in 0..values.len() {
        if values[v] == 0.0 {
            continue;
        }
        // At most as far as in a lattice of the smallest cube at the vertex.
        let farthest = if lattice.is_fine(v) { 0.5 } else { 1.0 } * SNAP_SHORT * SHORT * edge;
        let mut best: Option<(f64, Point)> = None;
        for &at in at_vertex.row(v) {
            let at = at as usize;
            let [a, b] = cuts.ends[at].map(|i| i as usize);
            // A snapped neighbour has the value 0, so its edges are no longer cut.
            if values[a] * values[b] >= 0.0 {
                continue;
            }
            let length = (lattice.position(b) - lattice.position(a)).norm();
            let share = if v == a { cuts.shares[at] } else { 1.0 - cuts.shares[at] };
            let is_short = [1.0, 0.5].iter().any(|size| (length / (size * edge) - SHORT).abs() < 1e-6);
            let distance = share * length;
            if share < if is_short { SNAP_SHORT } else { SNAP_LONG }
                && distance <= farthest
                && best.is_none_or(|(d, _)| distance < d)
            {
                best = Some((distance, cuts.position(lattice, at)));
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
    lattice: &RefinedLattice,
    values: &[f64],
    snapped: &[(usize, Point)],
    cuts: &CutEdges,
) -> TetMesh {
    let n = values.len();
    // Cut nodes are numbered after the lattice's vertices.
    let position = |node: u32| {
        let node = node as usize;
        if node >= n {
            return cuts.position(lattice, node - n);
        }
        match snapped.binary_search_by_key(&node, |s| s.0) {
            Ok(at) => snapped[at].1,
            Err(_) => lattice.position(node),
        }
    };
    let cut = |a: u32, b: u32| (n + cuts.place(a, b).unwrap_or(0)) as u32;
    let shorter = |[a, b, c, d]: [u32; 4]| {
        let first = (position(c) - position(a)).norm_squared();
        let second = (position(d) - position(b)).norm_squared();
        first < second || (first == second && a.min(c) < b.min(d))
    };
    let mut raw = Vec::new();
    let mut tetrahedra = Vec::new();
    for owner in lattice.owners() {
        tetrahedra.clear();
        lattice.tetrahedra(owner, &mut tetrahedra);
        for &t in &tetrahedra {
            let corners = t.map(|node| Corner { node, value: values[node as usize] });
            if corners.iter().all(|c| c.value == 0.0) {
                // All four vertices lie on the surface: the value at the centre decides.
                let centre = t.iter().fold(Point::origin(), |s, &i| s + position(i).coords * 0.25);
                if inner.value_side(&centre).0 < 0.0 {
                    raw.push(t);
                }
                continue;
            }
            cut_tetrahedron(corners, cut, shorter, &mut raw);
        }
    }
    let mut number = vec![u32::MAX; n + cuts.ends.len()];
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
