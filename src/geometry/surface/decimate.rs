use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::prelude::*;

use super::blocks::{Block, blocks};
use super::bucket_queue::BucketQueue;
use super::live_mesh::LiveMesh;
use super::quadric::Quadric;
use super::topology::irregular_vertices;
use crate::control::{Cancelled, Control};
use crate::{Point, TriMesh};

/// Weight of the anchors relative to the planes. It is small: anchors matter only where the planes have no unique minimum.
const ANCHOR: f64 = 1e-3;

/// Most triangles of a block; a block of this size fits into the cache of a core.
const BLOCK: usize = 1 << 16;

/// Simplifies a mesh by edge collapses; returns it with the error reached, mm.
///
/// The error is the largest distance of an input vertex from the result. It is measured and never exceeds `max_error_mm`.
/// The result has no fewer than `min_triangles` triangles, unless the input has.
///
/// Edges collapse in the order of their quadric error. A collapse is refused when it would change the topology (link
/// condition), turn a triangle by more than about 75°, make a needle, or leave an input vertex farther than `max_error_mm`
/// from the triangles that replace its neighbourhood. A closed two-manifold therefore stays one. Vertices on open borders
/// and non-manifold vertices keep their position.
///
/// A mesh of more than 65 536 triangles is simplified in blocks, in parallel, and then along the borders of the blocks. The
/// result does not depend on the number of threads.
///
/// ```
/// use prosopon_geometry::{Aabb, Point, ScalarGrid, TopologyFaults, decimate, isosurface};
///
/// // A ball of 10 mm radius, sampled every 1 mm.
/// let bounds = Aabb { min: Point::origin(), max: Point::origin() }.grown(12.0);
/// let mut grid = ScalarGrid::covering(&bounds, 1.0, 0.0);
/// let [nx, ny, nz] = grid.dims;
/// for k in 0..nz {
///     for j in 0..ny {
///         for i in 0..nx {
///             let at = grid.index(i, j, k);
///             grid.values[at] = (grid.position(i, j, k).coords.norm() - 10.0) as f32;
///         }
///     }
/// }
/// let ball = isosurface(&grid, 0.0).expect("some samples are negative");
/// let (coarse, error_mm) = decimate(&ball, 0.2, 4);
/// assert!(error_mm <= 0.2);
/// assert!(coarse.triangles().len() < ball.triangles().len() / 2);
/// assert!(TopologyFaults::of(&coarse).is_closed_manifold());
/// ```
///
/// # Source
/// Garland & Heckbert, SIGGRAPH 1997; link condition: Dey et al., TopologyFaults preserving edge contraction, 1999; error
/// measured at the removed vertices: Ciampalini et al., Multiresolution decimation based on global error, 1997.
#[must_use]
pub fn decimate(mesh: &TriMesh, max_error_mm: f64, min_triangles: usize) -> (TriMesh, f64) {
    // Nobody can cancel this control.
    decimate_with(mesh, max_error_mm, min_triangles, &Control::new(), |_| {})
        .unwrap_or_else(|Cancelled| (mesh.clone(), 0.0))
}

/// [`decimate`] that can be cancelled and reports the completed share, 0 to 1, to `progress`.
///
/// # Errors
/// [`Cancelled`] when `control` was cancelled or its deadline has passed.
pub fn decimate_with(
    mesh: &TriMesh,
    max_error_mm: f64,
    min_triangles: usize,
    control: &Control,
    progress: impl Fn(f64) + Sync,
) -> Result<(TriMesh, f64), Cancelled> {
    decimate_in_blocks(mesh, max_error_mm, min_triangles, BLOCK, control, progress)
}

fn decimate_in_blocks(
    mesh: &TriMesh,
    max_error: f64,
    min_triangles: usize,
    block_size: usize,
    control: &Control,
    progress: impl Fn(f64) + Sync,
) -> Result<(TriMesh, f64), Cancelled> {
    let all = mesh.triangles().len();
    let removed = AtomicUsize::new(0);
    let share = all.saturating_sub(min_triangles).max(1) as f64;
    let add_removed = |n: usize| progress((removed.fetch_add(n, Ordering::Relaxed) + n) as f64 / share);
    let mut fixed = vec![false; mesh.positions().len()];
    for v in irregular_vertices(mesh) {
        fixed[v as usize] = true;
    }
    let blocks = if all > block_size { blocks(mesh, block_size) } else { None };
    let mut work = match blocks {
        None => Decimation::new(mesh, fixed, max_error),
        Some(blocks) => {
            let borders = borders(&blocks, fixed.len());
            let parts = blocks.into_par_iter().map(|block| {
                let fixed = block.vertices.iter().map(|&v| fixed[v as usize] || borders[v as usize]).collect();
                let mut part = Decimation::new(&block.mesh, fixed, max_error);
                let least = (min_triangles as f64 * block.mesh.triangles().len() as f64 / all as f64).ceil() as usize;
                part.run(least, control, &add_removed)?;
                Ok((block.vertices, part))
            });
            let parts: Vec<(Vec<u32>, Decimation)> = parts.collect::<Result<_, Cancelled>>()?;
            Decimation::joined(mesh.positions(), fixed, &borders, parts, max_error)
        }
    };
    work.run(min_triangles, control, &add_removed)?;
    Ok(work.live.finish().unwrap_or_else(|| (mesh.clone(), 0.0)))
}

/// Whether each of `n` vertices belongs to more than one block.
fn borders(blocks: &[Block], n: usize) -> Vec<bool> {
    let mut blocks_of = vec![0u32; n];
    for &v in blocks.iter().flat_map(|block| &block.vertices) {
        blocks_of[v as usize] += 1;
    }
    blocks_of.iter().map(|&count| count > 1).collect()
}

/// An edge that may collapse, with the sum of its vertices' stamps at the time it was queued.
#[derive(Clone, Copy)]
struct Candidate {
    edge: [u32; 2],
    stamp: u32,
}

struct Decimation {
    live: LiveMesh,
    quadrics: Vec<Quadric>,
    /// Counts the changes around a vertex; candidates with an old stamp are stale.
    stamps: Vec<u32>,
    queue: BucketQueue<Candidate>,
    max_error: f64,
}

impl Decimation {
    /// Vertices that are `fixed` keep their position.
    fn new(mesh: &TriMesh, fixed: Vec<bool>, max_error: f64) -> Self {
        let n = mesh.positions().len();
        let mut quadrics = vec![Quadric::ZERO; n];
        for (t, corners) in mesh.triangles().iter().enumerate() {
            let scaled = mesh.scaled_normal(t);
            let Some(normal) = scaled.try_normalize(0.0) else { continue };
            let area = 0.5 * scaled.norm();
            for &v in corners {
                let p = &mesh.positions()[v as usize];
                let q = &mut quadrics[v as usize];
                *q = q.plus(&Quadric::plane(p, &normal, area)).plus(&Quadric::anchor(p, ANCHOR * area));
            }
        }
        let live = LiveMesh::new(mesh, fixed);
        let mut work = Self { live, quadrics, stamps: vec![0; n], queue: BucketQueue::new(), max_error };
        let edges = mesh.triangles().iter().flat_map(|t| [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]]);
        // A closed mesh holds every edge once in each direction: this keeps one of the two.
        for edge in edges.filter(|e| e[0] < e[1]) {
            work.enqueue(edge);
        }
        work
    }

    /// Joins blocks that were simplified; only edges at their `borders` are still to be tried.
    ///
    /// Each part has the vertex of the whole mesh for each of its vertices. Vertices of borders did not move.
    fn joined(
        positions: &[Point],
        fixed: Vec<bool>,
        borders: &[bool],
        parts: Vec<(Vec<u32>, Self)>,
        max_error: f64,
    ) -> Self {
        let n = positions.len();
        let mut quadrics = vec![Quadric::ZERO; n];
        for (vertices, part) in &parts {
            for (&v, quadric) in vertices.iter().zip(&part.quadrics) {
                // A block knows only its own triangles around a vertex of its border.
                quadrics[v as usize] = quadrics[v as usize].plus(quadric);
            }
        }
        let parts = parts.into_iter().map(|(vertices, part)| (vertices, part.live));
        let live = LiveMesh::joined(positions.to_vec(), fixed, parts);
        let mut work = Self { live, quadrics, stamps: vec![0; n], queue: BucketQueue::new(), max_error };
        let at_border = |e: &[u32; 2]| e[0] < e[1] && e.iter().any(|&v| borders[v as usize]);
        let edges: Vec<[u32; 2]> = work.live.edges().filter(at_border).collect();
        for edge in edges {
            work.enqueue(edge);
        }
        work
    }

    /// Collapses edges until none is left or `min_triangles` are reached.
    ///
    /// `add_removed` gets the number of triangles removed since its last call.
    fn run(&mut self, min_triangles: usize, control: &Control, add_removed: &impl Fn(usize)) -> Result<(), Cancelled> {
        let mut popped = 0usize;
        let mut reported = self.live.triangle_count();
        // A collapse removes two triangles.
        while self.live.triangle_count() >= min_triangles.saturating_add(2) {
            let Some(candidate) = self.queue.pop() else { break };
            self.try_collapse(&candidate);
            popped += 1;
            if popped % 4096 == 1 {
                control.check()?;
                add_removed(reported - self.live.triangle_count());
                reported = self.live.triangle_count();
            }
        }
        Ok(())
    }

    /// Position to which the edge would collapse, and the mean square distance there, mm².
    fn target(&self, edge: [u32; 2]) -> (Point, f64) {
        let [u, v] = edge.map(|w| w as usize);
        let quadric = self.quadrics[u].plus(&self.quadrics[v]);
        let (p, q) = (self.live.position(edge[0]), self.live.position(edge[1]));
        let middle = nalgebra::center(&p, &q);
        // Nearly parallel planes have their minimum far away: the middle of the edge is used instead.
        let reach_sq = (p - q).norm_squared();
        let target = quadric.minimum().filter(|m| (m - middle).norm_squared() <= reach_sq).unwrap_or(middle);
        (target, quadric.mean_square(&target))
    }

    fn enqueue(&mut self, edge: [u32; 2]) {
        if self.live.is_fixed(edge[0]) || self.live.is_fixed(edge[1]) {
            return;
        }
        let (_, cost) = self.target(edge);
        // The anchors add to the cost, so this limit is slightly stricter than `max_error`.
        if cost <= self.max_error * self.max_error {
            self.queue.push(cost, Candidate { edge, stamp: self.stamp(edge) });
        }
    }

    fn stamp(&self, edge: [u32; 2]) -> u32 {
        self.stamps[edge[0] as usize] + self.stamps[edge[1] as usize]
    }

    fn try_collapse(&mut self, candidate: &Candidate) {
        let [u, v] = candidate.edge;
        if candidate.stamp != self.stamp(candidate.edge) {
            return;
        }
        let (target, _) = self.target(candidate.edge);
        if !self.live.collapse(u, v, &target, self.max_error) {
            return;
        }
        self.quadrics[v as usize] = self.quadrics[u as usize].plus(&self.quadrics[v as usize]);
        self.stamps[u as usize] += 1;
        self.stamps[v as usize] += 1;
        for w in self.live.neighbours(v) {
            self.enqueue([v.min(w), v.max(w)]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::point_triangle::distance_sq;
    use super::super::{TopologyFaults, isosurface, parts, smooth};
    use super::*;
    use crate::ScalarGrid;

    fn surface(half_width: f64, f: impl Fn(&Point) -> f64) -> TriMesh {
        let n = (2.0 * half_width) as usize + 1;
        let origin = Point::new(-half_width, -half_width, -half_width);
        let mut grid = ScalarGrid { dims: [n; 3], origin, spacing: 1.0, values: vec![0.0; n * n * n] };
        for k in 0..n {
            for j in 0..n {
                for i in 0..n {
                    let at = grid.index(i, j, k);
                    grid.values[at] = f(&grid.position(i, j, k)) as f32;
                }
            }
        }
        isosurface(&grid, 0.0).unwrap()
    }

    fn distance(p: &Point, mesh: &TriMesh) -> f64 {
        let to = |t: usize| {
            let [a, b, c] = mesh.corners(t);
            distance_sq(p, &a, &b, &c)
        };
        (0..mesh.triangles().len()).map(to).fold(f64::MAX, f64::min).sqrt()
    }

    #[test]
    fn a_torus_keeps_its_topology_and_the_error_is_what_is_said() {
        let torus = |p: &Point| (p.x.hypot(p.y) - 12.0).hypot(p.z) - 5.0;
        // Smoothed first: slivers of marching cubes may face the wrong way.
        let mesh = smooth(&surface(19.0, torus), 3);
        for limit in [0.02, 0.1, 0.5] {
            let (coarse, error) = decimate(&mesh, limit, 4);
            assert!(TopologyFaults::of(&coarse).is_closed_manifold(), "{limit}");
            assert_eq!(coarse.positions().len(), coarse.triangles().len() / 2, "genus 1");
            let measured = mesh.positions().iter().map(|p| distance(p, &coarse)).fold(0.0, f64::max);
            assert!(measured <= error + 1e-9 && error <= limit, "{limit}: {measured} {error}");
            // In the other direction: new vertices stay near the analytic surface; sampling adds h²/8r = 0.025.
            let off = coarse.positions().iter().map(|p| torus(p).abs()).fold(0.0, f64::max);
            assert!(off < 1.5 * limit + 0.03, "{limit}: {off}");
            // No triangle faces inwards.
            for t in 0..coarse.triangles().len() {
                let [a, b, c] = coarse.corners(t);
                let center = Point::from((a.coords + b.coords + c.coords) / 3.0);
                let ring = center.coords.xy().normalize() * 12.0;
                let outward = center - Point::new(ring.x, ring.y, 0.0);
                assert!(coarse.scaled_normal(t).dot(&outward) > 0.0, "{limit}, triangle {t}");
            }
        }
        let (coarse, _) = decimate(&mesh, 0.1, 4);
        assert!(coarse.triangles().len() * 4 < mesh.triangles().len());
    }

    #[test]
    fn blocks_leave_no_seams() {
        let mesh = smooth(&surface(19.0, |p| (p.x.hypot(p.y) - 12.0).hypot(p.z) - 5.0), 3);
        let (whole, _) = decimate(&mesh, 0.1, 4);
        for block_size in [400, 3000] {
            let run = || decimate_in_blocks(&mesh, 0.1, 4, block_size, &Control::new(), |_| {});
            let (coarse, error) = run().unwrap();
            assert!(TopologyFaults::of(&coarse).is_closed_manifold(), "{block_size}");
            assert_eq!(coarse.positions().len(), coarse.triangles().len() / 2, "genus 1");
            let measured = mesh.positions().iter().map(|p| distance(p, &coarse)).fold(0.0, f64::max);
            assert!(measured <= error + 1e-9 && error <= 0.1, "{block_size}: {measured} {error}");
            // The order of collapses differs, so the number does too; fixed borders would leave far more.
            let ratio = coarse.triangles().len() as f64 / whole.triangles().len() as f64;
            assert!((0.9..1.1).contains(&ratio), "{block_size}: {ratio}");
            let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap().install(run).unwrap();
            assert!(alone == (coarse, error), "the number of threads changes nothing");
        }
        let (least, _) = decimate_in_blocks(&mesh, f64::INFINITY, 300, 400, &Control::new(), |_| {}).unwrap();
        assert!((300..302).contains(&least.triangles().len()), "{}", least.triangles().len());
    }

    #[test]
    fn a_box_becomes_few_triangles_and_keeps_its_edges() {
        let mesh = surface(10.0, |p| (p.x.abs() - 7.5).max(p.y.abs() - 6.5).max(p.z.abs() - 8.5));
        let (coarse, error) = decimate(&mesh, 0.05, 4);
        assert!(TopologyFaults::of(&coarse).is_closed_manifold());
        assert!(error <= 0.05);
        // Most remaining triangles lie on the narrow chamfers that marching cubes makes of edges; longer ones would be needles.
        assert!(coarse.triangles().len() < mesh.triangles().len() / 5);
        assert!((coarse.volume() / mesh.volume() - 1.0).abs() < 2e-3);
    }

    #[test]
    fn thin_and_branching_noise_stays_a_closed_manifold() {
        let mesh = surface(12.0, |p| (p.x * 0.9).sin() * (p.y * 0.8).cos() + (p.z * 1.1).sin() * (p.x * 0.5).cos());
        let before = parts(&mesh).len();
        for limit in [0.1, 1.0] {
            let (coarse, error) = decimate(&mesh, limit, 4);
            assert!(TopologyFaults::of(&coarse).is_closed_manifold() && error <= limit);
            assert_eq!(parts(&coarse).len(), before);
        }
    }

    #[test]
    fn it_stops_at_the_number_of_triangles_asked_for() {
        let mesh = surface(8.0, |p| p.coords.norm() - 6.0);
        let (coarse, _) = decimate(&mesh, 5.0, 200);
        assert!((200..=201).contains(&coarse.triangles().len()));
        let (same, error) = decimate(&mesh, 0.0, usize::MAX);
        assert_eq!((same.triangles().len(), error), (mesh.triangles().len(), 0.0));
    }

    #[test]
    fn an_open_border_stays() {
        let ball = surface(8.0, |p| p.coords.norm() - 6.0);
        let upper: Vec<u32> = (0..ball.triangles().len() as u32)
            .filter(|&t| ball.corners(t as usize).iter().all(|p| p.z > 0.5))
            .collect();
        let cup = super::super::submesh(&ball, &upper).unwrap();
        let (coarse, _) = decimate(&cup, 0.3, 4);
        let (before, after) = (TopologyFaults::of(&cup), TopologyFaults::of(&coarse));
        assert_eq!((after.boundary_edges, after.nonmanifold_edges), (before.boundary_edges, 0));
        assert!(coarse.triangles().len() < cup.triangles().len() / 2);
    }

    #[test]
    fn it_can_be_cancelled() {
        let control = Control::new();
        control.cancel();
        assert_eq!(decimate_with(&surface(12.0, |p| p.coords.norm() - 10.0), 0.1, 4, &control, |_| {}), Err(Cancelled));
    }
}
