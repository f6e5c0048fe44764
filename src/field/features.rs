//! Faces, edges and vertices of a surface, each with the region of space where it can be the nearest feature.

use prosopon_geometry::{Aabb, Point, TriMesh, Vector};
use rayon::prelude::*;

/// Width by which regions are enlarged so that rounding leaves no gap between neighbours, mm.
const SLACK: f32 = 1e-4;
/// Edges and vertices flatter than this (radian) have no region; the slack of the faces covers it.
const FLAT: f64 = 1e-5;
/// The region of a vertex with more edges than this is a whole ball.
const MOST_SPOKES: usize = 12;

/// Half-space `normal · v <= limit` of offsets `v` from a feature's anchor, mm.
#[derive(Debug, Clone, Copy)]
pub(super) struct HalfSpace {
    pub(super) normal: [f32; 3],
    pub(super) limit: f32,
}

/// Set from which the distance of a feature is measured.
#[derive(Debug, Clone, Copy)]
pub(super) enum Shape {
    /// Plane through the anchor with this unit normal.
    Plane([f32; 3]),
    /// Line through the anchor with this unit direction.
    Line([f32; 3]),
    /// The anchor.
    Point,
}

/// Region of a feature within a reach.
#[derive(Debug, Clone)]
pub(super) struct Region {
    pub(super) anchor: Point,
    pub(super) shape: Shape,
    /// Axis along which the region is longest.
    pub(super) axis: usize,
    pub(super) half_spaces: [HalfSpace; MOST_SPOKES],
    pub(super) n_half_spaces: usize,
    /// Box of offsets from the anchor, mm.
    pub(super) min: [f32; 3],
    pub(super) max: [f32; 3],
}

impl Region {
    fn new(anchor: Point, shape: Shape) -> Self {
        let nothing = HalfSpace { normal: [0.0; 3], limit: 0.0 };
        Self {
            anchor,
            shape,
            axis: 0,
            half_spaces: [nothing; MOST_SPOKES],
            n_half_spaces: 0,
            min: [0.0; 3],
            max: [0.0; 3],
        }
    }

    fn cut(&mut self, normal: [f32; 3], limit: f32) {
        if let Some(slot) = self.half_spaces.get_mut(self.n_half_spaces) {
            *slot = HalfSpace { normal, limit: limit + SLACK };
            self.n_half_spaces += 1;
        }
    }

    fn hold(&mut self, offset: &Vector) {
        for a in 0..3 {
            self.min[a] = self.min[a].min(offset[a] as f32 - SLACK);
            self.max[a] = self.max[a].max(offset[a] as f32 + SLACK);
        }
    }

    /// Enlarges the box by `reach` (mm) times each of the directions, or to all sides when there are none.
    fn spread(&mut self, directions: Option<&[Vector]>, reach: f64) {
        let (min, max) = (self.min, self.max);
        for a in 0..3 {
            let (mut low, mut high) = (0.0f64, 0.0f64);
            match directions {
                Some(directions) => {
                    for d in directions {
                        low = low.min(d[a]);
                        high = high.max(d[a]);
                    }
                }
                None => (low, high) = (-1.0, 1.0),
            }
            self.min[a] = min[a] + (reach * low) as f32;
            self.max[a] = max[a] + (reach * high) as f32;
        }
        let length = |a: usize| self.max[a] - self.min[a];
        self.axis = (1..3).fold(0, |best, a| if length(a) > length(best) { a } else { best });
    }
}

/// An edge whose region is where the faces on both sides lie behind.
#[derive(Debug, Clone)]
struct Edge {
    ends: [u32; 2],
    /// Up to two directions in the faces, away from the edge, that bound the region.
    inward: [[f32; 3]; 2],
    n_inward: u8,
    /// Middle direction of the region, and the sine of the region's half-angle.
    axis: [f32; 3],
    sine: f32,
}

/// A vertex whose region is where all its edges point away.
#[derive(Debug, Clone)]
struct Corner {
    at: u32,
    first: u32,
    last: u32,
    /// Range in `rays` of directions whose hull (times the reach) contains the region; `None` for a ball.
    rays: Option<(u32, u32)>,
}

/// Features of a surface; vertices at the same position count as one.
///
/// A point always lies in the region of its nearest feature. The smallest distance over the regions that contain a point is
/// therefore its distance, exact up to 1e-4 mm.
///
/// # Source
/// Scan conversion of Voronoi regions: S. Mauch, *Efficient Algorithms for Solving Static Hamilton-Jacobi Equations*, 2003;
/// C. Sigg, R. Peikert, M. Gross, *Signed Distance Transform Using Graphics Hardware*, 2003.
#[derive(Debug, Clone)]
pub(super) struct Features {
    points: Vec<Point>,
    faces: Vec<[u32; 3]>,
    edges: Vec<Edge>,
    corners: Vec<Corner>,
    spokes: Vec<[f32; 3]>,
    rays: Vec<Vector>,
}

fn single(v: &Vector) -> [f32; 3] {
    [v.x as f32, v.y as f32, v.z as f32]
}

fn double(v: [f32; 3]) -> Vector {
    Vector::new(f64::from(v[0]), f64::from(v[1]), f64::from(v[2]))
}

impl Features {
    /// Features of `mesh`; `triangles` are its triangles with welded vertices.
    pub(super) fn new(mesh: &TriMesh, triangles: &[[u32; 3]]) -> Self {
        let (points, triangles) = along_a_curve(mesh, triangles);
        let triangles = &triangles[..];
        let at = |v: u32| points[v as usize];
        let mut faces: Vec<[u32; 3]> =
            triangles.par_iter().copied().filter(|t| face_normal(t.map(at)).is_some()).collect();
        faces.par_sort_unstable_by_key(|t| (t[0].min(t[1]).min(t[2]), *t));
        // Each edge of a triangle with the opposite corner; a triangle without area bounds no region.
        let mut sides: Vec<(u64, u32)> = triangles
            .par_iter()
            .flat_map_iter(|t| {
                let solid = face_normal(t.map(at)).is_some();
                (0..3).filter_map(move |i| {
                    let (a, b) = (t[i], t[(i + 1) % 3]);
                    let key = u64::from(a.min(b)) << 32 | u64::from(a.max(b));
                    (a != b).then_some((key, if solid { t[(i + 2) % 3] } else { u32::MAX }))
                })
            })
            .collect();
        sides.par_sort_unstable();
        let groups: Vec<&[(u64, u32)]> = sides.chunk_by(|a, b| a.0 == b.0).collect();
        let edges: Vec<Edge> = groups.par_iter().filter_map(|group| edge(group, &points)).collect();
        let mut features = Self { points, faces, edges, corners: Vec::new(), spokes: Vec::new(), rays: Vec::new() };
        features.add_corners(&groups, triangles);
        features
    }

    fn add_corners(&mut self, groups: &[&[(u64, u32)]], triangles: &[[u32; 3]]) {
        let ends = |group: &[(u64, u32)]| [(group[0].0 >> 32) as usize, (group[0].0 & 0xffff_ffff) as usize];
        let mut first = vec![0u32; self.points.len() + 1];
        for group in groups {
            for v in ends(group) {
                first[v + 1] += 1;
            }
        }
        for v in 0..self.points.len() {
            first[v + 1] += first[v];
        }
        let mut next = first.clone();
        self.spokes = vec![[0.0; 3]; 2 * groups.len()];
        for group in groups {
            let [a, b] = ends(group);
            let direction = (self.points[b] - self.points[a]).normalize();
            for (v, direction) in [(a, direction), (b, -direction)] {
                self.spokes[next[v] as usize] = single(&direction);
                next[v] += 1;
            }
        }
        let spokes = &self.spokes;
        let mut used = vec![false; self.points.len()];
        for &v in triangles.iter().flatten() {
            used[v as usize] = true;
        }
        let found: Vec<(u32, Option<Vec<Vector>>)> = (0..self.points.len() as u32)
            .into_par_iter()
            .filter(|&v| used[v as usize])
            .filter_map(|v| {
                let own = &spokes[first[v as usize] as usize..first[v as usize + 1] as usize];
                match extreme_rays(own) {
                    Cone::Empty => None,
                    Cone::Rays(rays) => Some((v, Some(rays))),
                    Cone::Wide => Some((v, None)),
                }
            })
            .collect();
        for (v, rays) in found {
            let rays = rays.map(|r| {
                let start = self.rays.len() as u32;
                self.rays.extend(r);
                (start, self.rays.len() as u32)
            });
            self.corners.push(Corner { at: v, first: first[v as usize], last: first[v as usize + 1], rays });
        }
    }

    /// Number of features.
    pub(super) fn len(&self) -> usize {
        self.faces.len() + self.edges.len() + self.corners.len()
    }

    /// Region of feature `index` within `reach`, mm.
    #[inline(always)]
    pub(super) fn region(&self, index: usize, reach: f64) -> Region {
        self.region_with::<true>(index, reach)
    }

    /// Region of feature `index`; its half-spaces are computed only when `CUT` is true.
    #[inline(always)]
    fn region_with<const CUT: bool>(&self, index: usize, reach: f64) -> Region {
        if let Some(&face) = self.faces.get(index) {
            return self.face_region::<CUT>(face, reach);
        }
        let index = index - self.faces.len();
        match self.edges.get(index) {
            Some(edge) => self.edge_region::<CUT>(edge, reach),
            None => self.corner_region::<CUT>(&self.corners[index - self.edges.len()], reach),
        }
    }

    /// Box of the region of feature `index` within `reach`, mm.
    pub(super) fn bounds(&self, index: usize, reach: f64) -> Aabb {
        let region = self.region_with::<false>(index, reach);
        let corner = |offset: [f32; 3]| {
            // The offset has single precision.
            region.anchor + double(offset)
        };
        Aabb { min: corner(region.min), max: corner(region.max) }
    }

    /// Box around all points within `reach` (mm) of feature `index`.
    pub(super) fn box_within(&self, index: usize, reach: f64) -> Aabb {
        let at = |v: u32| self.points[v as usize];
        let (low, high) = if let Some(&[a, b, c]) = self.faces.get(index) {
            (at(a).inf(&at(b)).inf(&at(c)), at(a).sup(&at(b)).sup(&at(c)))
        } else if let Some(edge) = self.edges.get(index - self.faces.len()) {
            let [a, b] = edge.ends.map(at);
            (a.inf(&b), a.sup(&b))
        } else {
            let p = at(self.corners[index - self.faces.len() - self.edges.len()].at);
            (p, p)
        };
        let reach = Vector::repeat(reach + f64::from(SLACK));
        Aabb { min: low - reach, max: high + reach }
    }

    #[inline(always)]
    fn face_region<const CUT: bool>(&self, face: [u32; 3], reach: f64) -> Region {
        let [a, b, c] = face.map(|v| self.points[v as usize]);
        let normal = face_normal([a, b, c]).unwrap_or_else(Vector::x);
        let mut region = Region::new(a, Shape::Plane(single(&normal)));
        let corners = [Vector::zeros(), b - a, c - a];
        for i in 0..3 {
            region.hold(&corners[i]);
            if !CUT {
                continue;
            }
            let outward = (corners[(i + 1) % 3] - corners[i]).cross(&normal).normalize();
            region.cut(single(&outward), outward.dot(&corners[i]) as f32);
        }
        region.cut(single(&normal), reach as f32);
        region.cut(single(&-normal), reach as f32);
        region.spread(Some(&[normal, -normal]), reach);
        region
    }

    #[inline(always)]
    fn edge_region<const CUT: bool>(&self, edge: &Edge, reach: f64) -> Region {
        let [a, b] = edge.ends.map(|v| self.points[v as usize]);
        let along = b - a;
        let length = along.norm();
        let direction = along / length;
        let mut region = Region::new(a, Shape::Line(single(&direction)));
        region.hold(&Vector::zeros());
        region.hold(&along);
        region.cut(single(&direction), length as f32);
        region.cut(single(&-direction), 0.0);
        for inward in edge.inward[..usize::from(edge.n_inward)].iter().filter(|_| CUT) {
            region.cut(*inward, 0.0);
        }
        let sine = f64::from(edge.sine);
        // Beyond 60° the tip of the hull would lie outside the ball's box.
        if edge.n_inward == 0 || sine > 0.86 {
            region.spread(None, reach);
        } else {
            let axis = double(edge.axis);
            let cosine = (1.0 - sine * sine).sqrt();
            let across = direction.cross(&axis) * sine;
            let rays = [axis * cosine + across, axis * cosine - across, axis / cosine];
            region.spread(Some(&rays), reach);
        }
        region
    }

    #[inline(always)]
    fn corner_region<const CUT: bool>(&self, corner: &Corner, reach: f64) -> Region {
        let mut region = Region::new(self.points[corner.at as usize], Shape::Point);
        region.hold(&Vector::zeros());
        let spokes = &self.spokes[corner.first as usize..corner.last as usize];
        for spoke in spokes.iter().take(if CUT { MOST_SPOKES } else { 0 }) {
            region.cut(*spoke, 0.0);
        }
        region.spread(corner.rays.map(|(first, last)| &self.rays[first as usize..last as usize]), reach);
        region
    }
}

/// Renumbers vertices and triangles along a space-filling curve: neighbours get close in memory.
fn along_a_curve(mesh: &TriMesh, triangles: &[[u32; 3]]) -> (Vec<Point>, Vec<[u32; 3]>) {
    let bounds = mesh.bounds();
    let scale = 1023.0 / (bounds.max - bounds.min).max().max(f64::MIN_POSITIVE);
    let mut order: Vec<(u32, u32)> = mesh
        .positions()
        .par_iter()
        .enumerate()
        .map(|(v, p)| {
            let cell = (p - bounds.min) * scale;
            (morton([cell.x as u32, cell.y as u32, cell.z as u32]), v as u32)
        })
        .collect();
    order.par_sort_unstable();
    let mut rank = vec![0u32; order.len()];
    for (n, (_, v)) in order.iter().enumerate() {
        rank[*v as usize] = n as u32;
    }
    let points = order.iter().map(|(_, v)| mesh.positions()[*v as usize]).collect();
    (points, triangles.iter().map(|t| t.map(|v| rank[v as usize])).collect())
}

/// Interleaved bits of three numbers below 1024 (Morton code).
fn morton(cell: [u32; 3]) -> u32 {
    let spread = |n: u32| {
        let n = (n | n << 16) & 0x0300_00ff;
        let n = (n | n << 8) & 0x0300_f00f;
        let n = (n | n << 4) & 0x030c_30c3;
        (n | n << 2) & 0x0924_9249
    };
    spread(cell[0]) | spread(cell[1]) << 1 | spread(cell[2]) << 2
}

/// Unit normal; `None` for a triangle so thin that its edges represent it.
fn face_normal([a, b, c]: [Point; 3]) -> Option<Vector> {
    let (ab, ac) = (b - a, c - a);
    let normal = ab.cross(&ac);
    let area = normal.norm();
    // Below an angle of 1e-7 the direction of the normal is a rounding error.
    (area > 1e-7 * ab.norm() * ac.norm() && area > 0.0).then(|| normal / area)
}

/// The edge shared by `group` (opposite corners); `None` when no point is nearest to its interior.
fn edge(group: &[(u64, u32)], points: &[Point]) -> Option<Edge> {
    let ends = [(group[0].0 >> 32) as u32, (group[0].0 & 0xffff_ffff) as u32];
    let [a, b] = ends.map(|v| points[v as usize]);
    let along = (b - a).normalize();
    let mut found = Edge { ends, inward: [[0.0; 3]; 2], n_inward: 0, axis: [0.0; 3], sine: 1.0 };
    let mut inward = group.iter().filter(|side| side.1 != u32::MAX).filter_map(|side| {
        let to = points[side.1 as usize] - a;
        (to - along * along.dot(&to)).try_normalize(1e-12)
    });
    let Some(first) = inward.next() else { return Some(found) };
    let axis = -first;
    let across = along.cross(&axis);
    // The region's directions are an interval of angles from `axis`; each face restricts it to a half-turn.
    let quarter = std::f64::consts::FRAC_PI_2;
    let (mut low, mut high) = ((-quarter, first), (quarter, first));
    for m in inward {
        let angle = (-m).dot(&across).atan2((-m).dot(&axis));
        if angle - quarter > low.0 {
            low = (angle - quarter, m);
        }
        if angle + quarter < high.0 {
            high = (angle + quarter, m);
        }
    }
    if high.0 - low.0 < FLAT {
        return None;
    }
    let middle = 0.5 * (low.0 + high.0);
    found.inward = [single(&low.1), single(&high.1)];
    found.n_inward = 2;
    found.axis = single(&(axis * middle.cos() + across * middle.sin()));
    found.sine = (0.5 * (high.0 - low.0)).sin() as f32;
    Some(found)
}

/// Directions in which a vertex can be the nearest feature.
enum Cone {
    Empty,
    /// Directions whose hull with the vertex, scaled by the reach, contains the region.
    Rays(Vec<Vector>),
    Wide,
}

fn extreme_rays(spokes: &[[f32; 3]]) -> Cone {
    if spokes.len() < 3 || spokes.len() > MOST_SPOKES {
        return Cone::Wide;
    }
    let mut rays: Vec<Vector> = Vec::new();
    let mut spans = false;
    for i in 0..spokes.len() {
        for j in 0..i {
            let Some(ray) = double(spokes[i]).cross(&double(spokes[j])).try_normalize(1e-3) else { continue };
            let (mut low, mut high) = (0.0f64, 0.0f64);
            for (k, spoke) in spokes.iter().enumerate() {
                if k != i && k != j {
                    let side = ray.dot(&double(*spoke));
                    low = low.min(side);
                    high = high.max(side);
                }
            }
            spans |= low < -1e-5 || high > 1e-5;
            if high <= 1e-6 {
                rays.push(ray);
            }
            if low >= -1e-6 {
                rays.push(-ray);
            }
        }
    }
    if rays.is_empty() {
        // Pairs of nearly parallel spokes are skipped; without a pair that spans space the cone is unknown.
        return if spans { Cone::Empty } else { Cone::Wide };
    }
    let sum: Vector = rays.iter().sum();
    let Some(axis) = sum.try_normalize(1e-3) else { return Cone::Wide };
    let narrowest = rays.iter().map(|r| r.dot(&axis)).fold(1.0, f64::min);
    if narrowest < 0.5 {
        return Cone::Wide;
    }
    Cone::Rays(rays.iter().map(|r| r / r.dot(&axis)).collect())
}
