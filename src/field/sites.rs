//! Points spread over a surface, by brick, at which the field should be 0.

use super::bricks::NO_BRICK;
use super::distance_field::{DistanceField, Level};
use super::lanes::with_vectors;
use super::lattice::EDGE;
use prosopon_geometry::{Point, TriMesh, Vector};
use rayon::prelude::*;

/// Largest distance between neighbouring sites, in spacings, approximately.
const APART: f64 = 1.5;
/// Most parts that a triangle's edge is divided into.
const MOST_PARTS: f64 = 200.0;
/// Approximate largest number of sites; a surface that needs more gets a larger distance between them.
const MOST_SITES: f64 = 4e6;
/// Rows of at most this many points are tested point by point.
pub(super) const SHORT: usize = 8;

/// The triangles and vertices of a surface, listed by brick of a field.
pub(super) struct Spread<'a> {
    mesh: &'a TriMesh,
    origin: Point,
    per_mm: f64,
    /// Largest distance between neighbouring sites, in nodes.
    apart: f64,
    triangles: ByBrick,
    vertices: ByBrick,
}

/// Numbers listed by brick: those of brick n are `all[first[n]..first[n + 1]]`.
struct ByBrick {
    first: Vec<u32>,
    all: Vec<u32>,
}

impl ByBrick {
    /// Lists the pairs (brick, number) that `each` passes to its argument; `each` is called twice.
    fn new(n_bricks: usize, each: impl Fn(&mut dyn FnMut(u32, u32))) -> Self {
        let mut first = vec![0u32; n_bricks + 1];
        each(&mut |brick, _| first[brick as usize + 1] += 1);
        for n in 0..n_bricks {
            first[n + 1] += first[n];
        }
        let mut next = first.clone();
        let mut all = vec![0u32; first[n_bricks] as usize];
        each(&mut |brick, number| {
            all[next[brick as usize] as usize] = number;
            next[brick as usize] += 1;
        });
        Self { first, all }
    }

    fn of(&self, brick: usize) -> &[u32] {
        &self.all[self.first[brick] as usize..self.first[brick + 1] as usize]
    }
}

/// Kind of point visited on a triangle that is divided into equal parts.
#[derive(Clone, Copy, PartialEq)]
enum Kind {
    /// Middles of the parts.
    Middles,
    /// Corners of the parts except the triangle's own: the points farthest from middles and vertices.
    Joints,
}

impl<'a> Spread<'a> {
    /// Lists the `distinct` triangles of `mesh` and their vertices by the bricks of `field`.
    pub(super) fn new(field: &DistanceField, mesh: &'a TriMesh, distinct: &[bool]) -> Self {
        let lattice = &field.lattice;
        let n_bricks = field.bricks.len();
        let mut spread = Self {
            mesh,
            origin: lattice.origin,
            per_mm: lattice.per_mm,
            apart: APART,
            triangles: ByBrick { first: Vec::new(), all: Vec::new() },
            vertices: ByBrick { first: Vec::new(), all: Vec::new() },
        };
        let used = || (0..distinct.len()).filter(|&t| distinct[t]);
        let wanted: f64 = used().map(|t| spread.parts(t).powi(2)).sum();
        spread.apart *= (wanted / MOST_SITES).sqrt().max(1.0);
        spread.triangles = ByBrick::new(n_bricks, |add| {
            for t in used() {
                let [a, b, c] = spread.corners(t);
                let (low, high) = (brick_of(&a.inf(&b).inf(&c)), brick_of(&a.sup(&b).sup(&c)));
                for k in low[2]..=high[2] {
                    for j in low[1]..=high[1] {
                        for i in low[0]..=high[0] {
                            let slot = field.slot(Level::Brick, [i, j, k]);
                            if slot != NO_BRICK {
                                add(slot, t as u32);
                            }
                        }
                    }
                }
            }
        });
        let mut is_used = vec![false; mesh.positions().len()];
        for v in used().flat_map(|t| mesh.triangles()[t]) {
            is_used[v as usize] = true;
        }
        spread.vertices = ByBrick::new(n_bricks, |add| {
            for v in (0..is_used.len()).filter(|&v| is_used[v]) {
                let slot = field.slot(Level::Brick, brick_of(&spread.local(&mesh.positions()[v])));
                if slot != NO_BRICK {
                    add(slot, v as u32);
                }
            }
        });
        spread
    }

    /// A position in nodes.
    fn local(&self, p: &Point) -> Vector {
        (p - self.origin) * self.per_mm
    }

    fn corners(&self, t: usize) -> [Vector; 3] {
        self.mesh.corners(t).map(|p| self.local(&p))
    }

    /// Number of parts that each edge of a triangle is divided into.
    pub(super) fn parts(&self, t: usize) -> f64 {
        let [a, b, c] = self.mesh.corners(t);
        let longest_sq = (b - a).norm_squared().max((c - b).norm_squared()).max((a - c).norm_squared());
        (longest_sq.sqrt() * self.per_mm / self.apart).ceil().clamp(1.0, MOST_PARTS)
    }

    /// Sites in the brick `slot`: the middles of equal parts of triangles, and the vertices.
    ///
    /// Vertices are tips and ridges, where a spline is farthest off. `at` is the brick's position (in bricks); `sites` is a
    /// reused buffer.
    #[inline(always)]
    pub(super) fn sites(&self, slot: usize, at: [i32; 3], sites: &mut Vec<Site>) -> Sites {
        let corner = corner_of(at);
        sites.clear();
        self.for_points(slot, &corner, Kind::Middles, &mut |p| sites.push(Site::new(p, 0.0)));
        for &v in self.vertices.of(slot) {
            sites.push(Site::new(&(self.local(&self.mesh.positions()[v as usize]) - corner), 0.0));
        }
        Sites::new(sites, EDGE)
    }

    /// Visits the surface points in a brick farthest from sites, relative to the brick's first node.
    #[inline(always)]
    pub(super) fn for_joints(&self, slot: usize, at: [i32; 3], mut visit: impl FnMut(&Vector)) {
        self.for_points(slot, &corner_of(at), Kind::Joints, &mut visit);
    }

    #[inline(always)]
    fn for_points(&self, slot: usize, corner: &Vector, kind: Kind, visit: &mut impl FnMut(&Vector)) {
        for &t in self.triangles.of(slot) {
            let [a, b, c] = self.corners(t as usize);
            let parts = self.parts(t as usize);
            let (start, u, v) = (a - corner, (b - a) / parts, (c - a) / parts);
            let n = parts as usize;
            for i in 0..n {
                let row = start + u * i as f64;
                if kind == Kind::Middles {
                    row_in_brick(&(row + (u + v) / 3.0), &v, 0..n - i, visit);
                    row_in_brick(&(row + (u + v) * (2.0 / 3.0)), &v, 0..n - i - 1, visit);
                } else {
                    row_in_brick(&row, &v, usize::from(i == 0)..(n - i + 1).min(n), visit);
                }
            }
        }
    }
}

/// Visits the points `start` + n `step` that lie in the cells of the brick at 0.
#[inline(always)]
fn row_in_brick(start: &Vector, step: &Vector, range: std::ops::Range<usize>, visit: &mut impl FnMut(&Vector)) {
    let (low, high) = (-0.5, EDGE as f64 - 0.5);
    let (mut from, mut to) = (range.start as f64, range.end as f64 - 1.0);
    // In short rows the divisions cost more than they save.
    for a in (0..3).filter(|_| range.len() > SHORT) {
        let (first, last) = ((low - start[a]) / step[a], (high - start[a]) / step[a]);
        if first.is_finite() && last.is_finite() {
            // One more point on both sides allows for rounding.
            from = from.max((first.min(last) - 1.0).floor());
            to = to.min((first.max(last) + 1.0).ceil());
        }
    }
    if from > to {
        return;
    }
    for n in from as usize..=to as usize {
        let p = start + step * n as f64;
        if (0..3).all(|a| low <= p[a] && p[a] < high) {
            visit(&p);
        }
    }
}

/// The brick that holds a position in nodes.
fn brick_of(p: &Vector) -> [isize; 3] {
    [0, 1, 2].map(|a| ((p[a] + 0.5) / EDGE as f64).floor() as isize)
}

fn corner_of(at: [i32; 3]) -> Vector {
    Vector::from(at.map(|n| f64::from(n) * EDGE as f64))
}

/// Resolution of a site's position, in steps per node spacing: 16 bits span a brick.
const STEPS_PER_NODE: f64 = 8192.0;

/// A site in a brick, packed because a field has a million and more of them.
#[derive(Debug, Clone, Copy)]
pub(super) struct Site {
    /// Position relative to the lower end of the brick's first cell, in steps.
    steps: [u16; 3],
    /// Value of the coarser levels at the site, without that of the brick's level, mm.
    pub(super) below: f32,
    /// Value of the field at the site, mm.
    pub(super) value: f32,
}

impl Site {
    /// Site at `p`, in nodes from the brick's first; `below` is the value of the coarser levels there, mm.
    #[inline(always)]
    pub(super) fn new(p: &Vector, below: f32) -> Self {
        let steps = [0, 1, 2].map(|a| ((p[a] + 0.5) * STEPS_PER_NODE) as u16);
        Self { steps, below, value: 0.0 }
    }

    /// Node (in the brick) whose cell contains the site.
    #[inline(always)]
    pub(super) fn cell(&self) -> [usize; 3] {
        self.steps.map(|s| usize::from(s) / STEPS_PER_NODE as usize)
    }

    /// Position relative to that node, in nodes: the middle of the site's step.
    #[inline(always)]
    fn offset(&self) -> [f32; 3] {
        self.steps.map(|s| {
            let within = usize::from(s) % STEPS_PER_NODE as usize;
            (within as f32 + 0.5) * (1.0 / STEPS_PER_NODE) as f32 - 0.5
        })
    }

    /// Position relative to the brick's first node, in nodes.
    pub(super) fn local(&self) -> [f32; 3] {
        self.steps.map(|s| (f32::from(s) + 0.5) * (1.0 / STEPS_PER_NODE) as f32 - 0.5)
    }

    /// Weights of the three nodes around the site along each axis.
    #[inline(always)]
    pub(super) fn weights(&self) -> [[f32; 3]; 3] {
        self.offset().map(|t| {
            let (low, high) = (0.5 - t, 0.5 + t);
            [0.5 * low * low, 0.75 - t * t, 0.5 * high * high]
        })
    }
}

/// Number of classes of cells: first, inner or last along each of the three axes of the brick.
pub(super) const CLASSES: usize = 27;

/// Sites of a brick, sorted by class.
#[derive(Debug, Clone, Default)]
pub(super) struct Sites {
    pub(super) all: Vec<Site>,
    /// Start of each class in `all`, and the end; empty when there are no sites.
    first: Vec<u32>,
}

impl Sites {
    /// Sorts the sites of a brick with `edge` nodes along each axis.
    pub(super) fn new(all: &[Site], edge: usize) -> Self {
        if all.is_empty() {
            return Self::default();
        }
        let side = |n: usize| match n {
            0 => 0,
            n if n + 1 == edge => 2,
            _ => 1,
        };
        let class = |site: &Site| {
            let [i, j, k] = site.cell().map(side);
            i + 3 * j + 9 * k
        };
        let mut first = vec![0u32; CLASSES + 1];
        for site in all {
            first[class(site) + 1] += 1;
        }
        for n in 0..CLASSES {
            first[n + 1] += first[n];
        }
        // The sort is stable within a class.
        let mut next = first.clone();
        let mut sorted = vec![all[0]; all.len()];
        for site in all {
            let place = &mut next[class(site)];
            sorted[*place as usize] = *site;
            *place += 1;
        }
        Self { all: sorted, first }
    }

    /// Sites of one class.
    #[inline]
    pub(super) fn of_class(&self, class: usize) -> &[Site] {
        match self.first.get(class..class + 2) {
            Some([from, to]) => &self.all[*from as usize..*to as usize],
            _ => &[],
        }
    }

    /// Bit set of the classes with a site whose value is farther from 0 than `limit`, mm.
    pub(super) fn classes_beyond(&self, limit: f32) -> u32 {
        let is_beyond = |class: &usize| self.of_class(*class).iter().any(|s| s.value.abs() > limit);
        (0..CLASSES).filter(is_beyond).fold(0, |bits, class| bits | 1 << class)
    }
}

/// All sites of a field's bricks.
pub(super) fn of_bricks(spread: &Spread, places: &[[i32; 3]]) -> Vec<Sites> {
    places
        .par_iter()
        .enumerate()
        .map_init(Vec::new, |found, (slot, at)| {
            with_vectors(
                #[inline(always)]
                || spread.sites(slot, *at, found),
            )
        })
        .collect()
}
