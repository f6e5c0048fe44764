//! Rims of holes and sheets, closed by caps.

use super::ray::winding_before;
use super::region::Region;
use super::tree::Tree;
use super::triangle::{closest_point, solid_angle};
use super::winding::Winding;
use prosopon_geometry::{Aabb, Point, Vector};

/// An edge whose triangles do not cancel, by the indices of its ends.
#[derive(Debug, Clone, Copy)]
pub(super) struct NetEdge {
    pub(super) ends: [u32; 2],
    /// Number of triangles that run from the first end to the second, less those that run back.
    pub(super) times: i32,
}

/// A triangle that closes a hole.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cap {
    pub(super) corners: [Point; 3],
    /// Number of times that it counts; negative when it counts with the opposite orientation.
    pub(super) times: i32,
}

/// An edge of the rim; `times` is as in [`NetEdge`].
#[derive(Debug, Clone, Copy)]
struct RimEdge {
    start: Point,
    end: Point,
    times: i32,
}

/// One loop of the rim, or several loops that touch.
#[derive(Debug, Clone)]
struct Hole {
    center: Point,
    radius: f64,
    edges: Vec<RimEdge>,
    /// Area of its caps, mm².
    area: f64,
}

/// The rim of a triangle soup: the edges whose triangles do not cancel.
///
/// Each connected part is closed by a cap, a fan of triangles to its middle. The winding number of the soup is that of the
/// closed surface, an integer, minus the caps' solid angle over 4π.
#[derive(Debug, Clone, Default)]
pub(super) struct Rim {
    holes: Vec<Hole>,
    /// The caps as a tree of dipoles; only when there are many.
    tree: Option<(Tree, Winding)>,
}

/// From this many edges on the caps' winding number comes from a tree of dipoles, within about 0.01.
const MIN_TREE_EDGES: usize = 3000;

/// Margin below one half that the caps' share of a winding number needs to be harmless.
const CLEAR_MARGIN: f64 = 1e-9;

impl Rim {
    /// Joins `edges` into holes.
    pub(super) fn new(edges: &[NetEdge], positions: &[Point]) -> Self {
        let mut parents: std::collections::BTreeMap<u32, u32> = std::collections::BTreeMap::new();
        fn root(parents: &mut std::collections::BTreeMap<u32, u32>, v: u32) -> u32 {
            let mut top = v;
            while let Some(&next) = parents.get(&top).filter(|next| **next != top) {
                top = next;
            }
            parents.insert(v, top);
            top
        }
        for NetEdge { ends: [a, b], .. } in edges {
            let (a, b) = (root(&mut parents, *a), root(&mut parents, *b));
            parents.insert(a.max(b), a.min(b));
            parents.entry(a.min(b)).or_insert(a.min(b));
        }
        let mut holes: std::collections::BTreeMap<u32, Vec<RimEdge>> = std::collections::BTreeMap::new();
        for &NetEdge { ends: [a, b], times } in edges {
            let hole = holes.entry(root(&mut parents, a)).or_default();
            hole.push(RimEdge { start: positions[a as usize], end: positions[b as usize], times });
        }
        let rim = Self { holes: holes.into_values().map(Hole::new).collect(), tree: None };
        if edges.len() < MIN_TREE_EDGES { rim } else { rim.with_tree() }
    }

    fn with_tree(mut self) -> Self {
        let mut corners = Vec::new();
        for Cap { corners: cap, times } in self.caps() {
            let cap = if times > 0 { cap } else { [cap[0], cap[2], cap[1]] };
            corners.extend(std::iter::repeat_n(cap, times.unsigned_abs() as usize));
        }
        let tree = Tree::of(corners);
        let winding = Winding::new(&tree, &vec![true; tree.original.len()]);
        self.tree = Some((tree, winding));
        self
    }

    /// The caps' contribution to the winding number of `p`, counted along the ray from `p` along -x.
    pub(super) fn before(&self, p: &Point) -> i32 {
        let mut count = 0;
        match &self.tree {
            Some((tree, _)) => tree.for_each_before(p, |_, corners| count += winding_before(p, corners)),
            None => {
                for hole in &self.holes {
                    count += hole.caps().map(|cap| cap.times * winding_before(p, &cap.corners)).sum::<i32>();
                }
            }
        }
        count
    }

    /// The rims of holes and sheets.
    ///
    /// Rims of parts that are only inverted are left out; their edges count twice.
    pub(super) fn regions(&self) -> Vec<Region> {
        let is_open = |hole: &&Hole| hole.edges.iter().any(|edge| edge.times % 2 != 0);
        let region = |hole: &Hole| {
            let ends: Vec<Point> = hole.edges.iter().flat_map(|edge| [edge.start, edge.end]).collect();
            let bounds = Aabb::of(&ends)?;
            Some(Region { elements: hole.edges.len(), area_mm2: hole.area, bounds })
        };
        self.holes.iter().filter(is_open).filter_map(region).collect()
    }

    /// Number of edges.
    pub(super) fn len(&self) -> usize {
        self.holes.iter().map(|h| h.edges.len()).sum()
    }

    pub(super) fn is_empty(&self) -> bool {
        self.holes.is_empty()
    }

    /// The triangles of all caps; with the soup they form a closed surface.
    pub(super) fn caps(&self) -> Vec<Cap> {
        self.holes.iter().flat_map(Hole::caps).collect()
    }

    /// Whether the caps certainly cannot change the sign of any point within `radius` of `center`.
    ///
    /// They cannot when they contribute less than one half to the winding number there.
    pub(super) fn is_far(&self, center: &Point, radius: f64) -> bool {
        if self.tree.is_some() {
            return false;
        }
        let mut share = 0.0;
        for hole in &self.holes {
            let distance = (hole.center - center).norm() - hole.radius - radius;
            if distance <= 0.0 {
                return false;
            }
            share += hole.area / (4.0 * std::f64::consts::PI * distance * distance);
        }
        share < 0.5 - CLEAR_MARGIN
    }

    /// The caps' winding number at `p`.
    pub(super) fn share(&self, p: &Point) -> f64 {
        if let Some((tree, winding)) = &self.tree {
            return winding.at(tree, p);
        }
        let angle: f64 = self
            .holes
            .iter()
            .flat_map(|hole| {
                hole.edges.iter().map(|e| f64::from(e.times) * solid_angle(p, &[e.end, e.start, hole.center]))
            })
            .sum();
        angle / (4.0 * std::f64::consts::PI)
    }

    /// Bound on the gradient of the soup's winding number within `radius` of `center`, 1/mm.
    ///
    /// It holds off the surface. The winding number is the potential of a current around the rim (Biot and Savart), so its
    /// gradient is at most 1/4π Σ length / distance².
    pub(super) fn slope(&self, center: &Point, radius: f64) -> f64 {
        if self.tree.is_some() {
            return f64::INFINITY;
        }
        let mut sum = 0.0;
        for RimEdge { start: a, end: b, times } in self.holes.iter().flat_map(|hole| &hole.edges) {
            let length = (b - a).norm();
            let distance = (nalgebra::center(a, b) - center).norm() - 0.5 * length - radius;
            if distance <= 0.0 {
                return f64::INFINITY;
            }
            sum += f64::from(times.abs()) * length / (distance * distance);
        }
        sum / (4.0 * std::f64::consts::PI)
    }

    /// Whether any cap comes within `radius` (mm) of `center`.
    pub(super) fn has_cap_near(&self, center: &Point, radius: f64) -> bool {
        if let Some((tree, _)) = &self.tree {
            return tree.nearest(center, 0).distance_sq <= radius * radius;
        }
        self.holes.iter().filter(|h| (h.center - center).norm() <= h.radius + radius).any(|hole| {
            hole.edges.iter().any(|edge| {
                let q = closest_point(center, &[edge.end, edge.start, hole.center]);
                (q - center).norm() <= radius
            })
        })
    }
}

impl Hole {
    fn new(edges: Vec<RimEdge>) -> Self {
        let sum: Vector = edges.iter().map(|e| (e.start.coords + e.end.coords) * 0.5).sum();
        let center = Point::from(sum / edges.len().max(1) as f64);
        let radius = edges.iter().map(|e| (e.start - center).norm().max((e.end - center).norm())).fold(0.0, f64::max);
        let area = edges
            .iter()
            .map(|e| 0.5 * f64::from(e.times.abs()) * (e.start - center).cross(&(e.end - center)).norm())
            .sum();
        Self { center, radius, edges, area }
    }

    fn caps(&self) -> impl Iterator<Item = Cap> + '_ {
        self.edges.iter().map(|e| Cap { corners: [e.end, e.start, self.center], times: e.times })
    }
}
