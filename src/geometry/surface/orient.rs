//! Turns triangles so that the normals of a surface point outwards.

use std::f64::consts::PI;

use crate::connectivity::Edges;
use crate::trimesh::scaled_normal;
use crate::{Aabb, Point, Vector};

/// Largest area of a part's holes, as a share of the part's own, at which the sign of its volume shows where outside is.
///
/// The neck of a head has a tenth; a face, whose rim is as large as itself, says nothing.
const MAX_HOLES: f64 = 0.25;

/// Volumes below this share of area times diagonal are rounding.
const MIN_VOLUME: f64 = 1e-7;

/// Most triangles that are visited to find out which parts lie inside others; beyond, parts stay as they are.
const MAX_VISITS: usize = 20_000_000;

/// What was turned.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Turned {
    /// Triangles whose corners were put in the other order.
    pub(super) triangles: usize,
    /// Connected parts that have no two sides, such as a Möbius band.
    pub(super) one_sided_parts: usize,
}

/// Turns triangles that face against their neighbours, and parts that face inwards.
///
/// Triangles are connected through edges that have exactly two of them. Within a part the direction of the larger area counts.
/// A part that is closed or nearly so must then have a positive volume, except when it lies inside an odd number of others:
/// it is the wall of a cavity. When most of the surface is closed and the sum of the volumes is negative, everything is turned
/// first. Parts with large holes keep the direction of their larger area.
pub(super) fn turn_outwards(positions: &[Point], triangles: &mut [[u32; 3]], edges: &Edges) -> Turned {
    let (mut links, one_sided) = Links::of(triangles.len(), edges);
    let (parts, part_of) = Part::all(positions, triangles, edges, &mut links);
    let whole = turned_as_a_whole(&parts);
    let inverted = Nesting { positions, triangles, parts: &parts, part_of: &part_of }.inverted(whole);
    let mut turned = 0;
    for (t, corners) in triangles.iter_mut().enumerate() {
        let part = part_of[t] as usize;
        if parts[part].majority_is_odd ^ links.is_odd[t] ^ whole ^ inverted[part] {
            corners.swap(1, 2);
            turned += 1;
        }
    }
    let mut one_sided: Vec<u32> = one_sided.iter().map(|t| part_of[*t as usize]).collect();
    one_sided.sort_unstable();
    one_sided.dedup();
    Turned { triangles: turned, one_sided_parts: one_sided.len() }
}

/// Disjoint sets of triangles, with each triangle's direction relative to the first one of its set.
struct Links {
    /// The first triangle of the set of each triangle.
    root: Vec<u32>,
    /// Whether each triangle faces against the first one of its set.
    is_odd: Vec<bool>,
}

impl Links {
    /// Links triangles across edges with exactly two; also returns triangles at edges that contradict the rest.
    fn of(n: usize, edges: &Edges) -> (Self, Vec<u32>) {
        let mut links = Self { root: (0..n as u32).collect(), is_odd: vec![false; n] };
        let mut one_sided = Vec::new();
        for (_, sides) in edges.iter() {
            let [one, other] = sides else { continue };
            // Neighbours that face the same way run along their edge in opposite directions.
            let against = one.forward() == other.forward();
            let (a, a_odd) = links.find(one.triangle());
            let (b, b_odd) = links.find(other.triangle());
            if a == b {
                if (a_odd != b_odd) != against {
                    one_sided.push(one.triangle());
                }
            } else {
                let (low, high) = (a.min(b), a.max(b));
                links.root[high as usize] = low;
                links.is_odd[high as usize] = (a_odd != b_odd) != against;
            }
        }
        for t in 0..n as u32 {
            let (root, is_odd) = links.find(t);
            links.root[t as usize] = root;
            links.is_odd[t as usize] = is_odd;
        }
        (links, one_sided)
    }

    /// The first triangle of the set of `t`, and whether `t` faces against it; shortens the way there.
    fn find(&mut self, mut t: u32) -> (u32, bool) {
        let mut odd = false;
        while self.root[t as usize] != t {
            let above = self.root[t as usize];
            let above_odd = self.is_odd[above as usize];
            // From here on `t` hangs on what is above its parent.
            if self.root[above as usize] != above {
                self.is_odd[t as usize] ^= above_odd;
                self.root[t as usize] = self.root[above as usize];
            }
            odd ^= self.is_odd[t as usize];
            t = self.root[t as usize];
        }
        (t, odd)
    }
}

/// Triangles that are connected through edges with exactly two of them.
struct Part {
    area: f64,
    /// Whether the triangles that face against the first one have the larger area.
    majority_is_odd: bool,
    /// Volume with all triangles in the direction of the majority; `None` when it does not show where outside is.
    volume: Option<f64>,
    bounds: Aabb,
    /// A corner of the part.
    corner: Point,
}

/// Sums over the triangles and open edges of a part.
struct Sums {
    areas: [f64; 2],
    volume: f64,
    bounds: Aabb,
    corner: Point,
    rim: Vector,
    rim_length: f64,
    holes: f64,
}

impl Part {
    /// All parts in the order of their first triangles, and the part of each triangle.
    fn all(positions: &[Point], triangles: &[[u32; 3]], edges: &Edges, links: &mut Links) -> (Vec<Self>, Vec<u32>) {
        let mut part_of = vec![0u32; triangles.len()];
        let mut sums: Vec<Sums> = Vec::new();
        for (t, corners) in triangles.iter().enumerate() {
            let root = links.root[t] as usize;
            if root == t {
                let corner = positions[corners[0] as usize];
                let bounds = Aabb { min: corner, max: corner };
                part_of[t] = sums.len() as u32;
                sums.push(Sums {
                    areas: [0.0; 2],
                    volume: 0.0,
                    bounds,
                    corner,
                    rim: Vector::zeros(),
                    rim_length: 0.0,
                    holes: 0.0,
                });
            } else {
                // A root comes before the triangles of its set.
                part_of[t] = part_of[root];
            }
        }
        // Open edges: those with an odd number of triangles.
        let open = || edges.iter().filter(|(_, sides)| sides.len() % 2 == 1);
        let ends = |edge: [u32; 2]| edge.map(|v| positions[v as usize]);
        for (edge, sides) in open() {
            let [a, b] = ends(edge);
            let length = (b - a).norm();
            for side in sides {
                let sum = &mut sums[part_of[side.triangle() as usize] as usize];
                sum.rim += (nalgebra::center(&a, &b) - sum.corner) * length;
                sum.rim_length += length;
            }
        }
        // Volumes are measured from the middle of the rim, so that a hole adds the volume of a flat lid.
        let origin = |sum: &Sums| if sum.rim_length > 0.0 { sum.corner + sum.rim / sum.rim_length } else { sum.corner };
        let origins: Vec<Point> = sums.iter().map(origin).collect();
        for (edge, sides) in open() {
            for side in sides {
                let part = part_of[side.triangle() as usize] as usize;
                let [a, b] = ends(edge).map(|p| p - origins[part]);
                sums[part].holes += 0.5 * a.cross(&b).norm();
            }
        }
        for (t, corners) in triangles.iter().enumerate() {
            let part = part_of[t] as usize;
            let sum = &mut sums[part];
            let corners = corners.map(|v| positions[v as usize]);
            let is_odd = links.is_odd[t];
            sum.areas[usize::from(is_odd)] += 0.5 * scaled_normal(&corners).norm();
            let [a, b, c] = corners.map(|p| p - origins[part]);
            sum.volume += a.dot(&b.cross(&c)) / if is_odd { -6.0 } else { 6.0 };
            for p in &corners {
                sum.bounds = Aabb { min: sum.bounds.min.inf(p), max: sum.bounds.max.sup(p) };
            }
        }
        (sums.into_iter().map(Self::from).collect(), part_of)
    }
}

impl From<Sums> for Part {
    fn from(sums: Sums) -> Self {
        let Sums { areas: [even, odd], volume, bounds, corner, holes, .. } = sums;
        let area = even + odd;
        // Equal areas: the volume decides, so that the order of triangles does not.
        let majority_is_odd = odd > even || odd == even && volume < 0.0;
        let is_clear = holes <= MAX_HOLES * area && volume.abs() > MIN_VOLUME * area * bounds.diagonal();
        let volume = if majority_is_odd { -volume } else { volume };
        Self { area, majority_is_odd, volume: is_clear.then_some(volume), bounds, corner }
    }
}

/// Whether most of the surface is closed, and turned inside out.
fn turned_as_a_whole(parts: &[Part]) -> bool {
    let area: f64 = parts.iter().map(|p| p.area).sum();
    let clear: f64 = parts.iter().filter(|p| p.volume.is_some()).map(|p| p.area).sum();
    2.0 * clear > area && parts.iter().filter_map(|p| p.volume).sum::<f64>() < 0.0
}

/// Finds which parts with a negative volume are not walls of cavities.
struct Nesting<'a> {
    positions: &'a [Point],
    triangles: &'a [[u32; 3]],
    parts: &'a [Part],
    part_of: &'a [u32],
}

impl Nesting<'_> {
    /// Whether each part must be turned, after all were turned if `whole`.
    fn inverted(&self, whole: bool) -> Vec<bool> {
        let is_inverted = |part: &Part| part.volume.is_some_and(|v| (v < 0.0) != whole);
        let mut turned = vec![false; self.parts.len()];
        let mut inverted: Vec<usize> = (0..self.parts.len()).filter(|n| is_inverted(&self.parts[*n])).collect();
        if inverted.is_empty() {
            return turned;
        }
        inverted.sort_by(|a, b| self.parts[*b].area.total_cmp(&self.parts[*a].area));
        let triangles_of = self.triangles_of_parts();
        let mut visits = MAX_VISITS;
        for part in inverted {
            let Some(depth) = self.depth(part, &triangles_of, &mut visits) else { break };
            turned[part] = depth % 2 == 0;
        }
        turned
    }

    /// In how many other parts one lies; `None` when `visits` are used up.
    fn depth(&self, part: usize, triangles_of: &[Vec<u32>], visits: &mut usize) -> Option<usize> {
        let Part { bounds: inner, corner, .. } = &self.parts[part];
        let mut depth = 0;
        *visits = visits.checked_sub(self.parts.len())?;
        for (other, Part { bounds, .. }) in self.parts.iter().enumerate() {
            if other == part || !bounds.contains(&inner.min) || !bounds.contains(&inner.max) {
                continue;
            }
            *visits = visits.checked_sub(triangles_of[other].len())?;
            let around: f64 = triangles_of[other].iter().map(|t| self.solid_angle(*t, corner)).sum();
            depth += usize::from(around.abs() > 2.0 * PI);
        }
        Some(depth)
    }

    /// Solid angle under which a triangle is seen (van Oosterom and Strackee, 1983, eq. 8), in its part's direction.
    fn solid_angle(&self, triangle: u32, from: &Point) -> f64 {
        let [a, b, c] = self.triangles[triangle as usize].map(|v| self.positions[v as usize] - from);
        let (la, lb, lc) = (a.norm(), b.norm(), c.norm());
        let below = la * lb * lc + a.dot(&b) * lc + b.dot(&c) * la + c.dot(&a) * lb;
        2.0 * a.dot(&b.cross(&c)).atan2(below)
    }

    fn triangles_of_parts(&self) -> Vec<Vec<u32>> {
        let mut triangles_of = vec![Vec::new(); self.parts.len()];
        for (t, part) in self.part_of.iter().enumerate() {
            triangles_of[*part as usize].push(t as u32);
        }
        triangles_of
    }
}
