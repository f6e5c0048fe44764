//! The skin's line in a sagittal plane, from forehead to neck.

use std::collections::BTreeMap;

use super::super::tuning::{
    MAX_BREAK_MM, MOUTH_BELOW_MM, PROFILE_ABOVE_MM, PROFILE_BEHIND_MM, PROFILE_BELOW_MM, PROFILE_REACH_MM,
    PROFILE_SHIFTS_MM,
};
use prosopon_geometry::{Point, TriMesh};

/// A point of a surface by its place in a triangle; it stays the same point of skin when the surface deforms.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct SurfacePoint {
    corners: [u32; 3],
    weights: [f64; 3],
}

impl SurfacePoint {
    /// The point of triangle `corners` of `mesh` that is closest to `p` in the triangle's plane.
    pub(super) fn in_triangle(mesh: &TriMesh, triangle: usize, p: &Point) -> Self {
        let ([a, b, c], corners) = (mesh.corners(triangle), mesh.triangles()[triangle]);
        let (u, v, w) = (b - a, c - a, p - a);
        let (uu, uv, vv, wu, wv) = (u.dot(&u), u.dot(&v), v.dot(&v), w.dot(&u), w.dot(&v));
        let determinant = uu * vv - uv * uv;
        let (s, t) = if determinant > 0.0 {
            ((vv * wu - uv * wv) / determinant, (uu * wv - uv * wu) / determinant)
        } else {
            (0.0, 0.0)
        };
        Self { corners, weights: [1.0 - s - t, s, t] }
    }

    fn on_edge([a, b]: [u32; 2], share: f64) -> Self {
        Self { corners: [a, b, b], weights: [1.0 - share, share, 0.0] }
    }

    /// Position on `mesh`, which has the triangles of the surface.
    pub(super) fn on(&self, mesh: &TriMesh) -> Point {
        let at = |i: usize| mesh.positions()[self.corners[i] as usize].coords * self.weights[i];
        Point::from(at(0) + at(1) + at(2))
    }
}

/// The front of the skin in the plane x = midline, from above downwards.
///
/// One piece, or two where the lips are parted in the mesh.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Section {
    pub(super) points: Vec<SurfacePoint>,
    /// Positions at rest.
    pub(super) rest: Vec<Point>,
    /// Indices of the points with which a piece after the first begins.
    pub(super) breaks: Vec<usize>,
}

impl Section {
    /// Cuts `skin` near the midline, where the line runs from the nose over the chin; empty when the planes miss the skin.
    pub(super) fn near(skin: &TriMesh, midline_x_mm: f64) -> Self {
        let sections = || PROFILE_SHIFTS_MM.iter().map(|shift| Self::new(skin, midline_x_mm + shift));
        let reaches_chin = |section: &Self| {
            let tip = section.rest.iter().min_by(|a, b| a.y.total_cmp(&b.y)).map_or(0.0, |p| p.z);
            section.rest.last().is_some_and(|end| end.z < tip - PROFILE_REACH_MM)
        };
        sections().find(reaches_chin).unwrap_or_else(|| Self::new(skin, midline_x_mm))
    }

    /// Cuts `skin` with the plane; empty when the plane misses it.
    fn new(skin: &TriMesh, midline_x_mm: f64) -> Self {
        let mut chains = chains(skin, midline_x_mm);
        let position = |p: &SurfacePoint| p.on(skin);
        // The foremost point of all is the nose; its chain is the outer line.
        let foremost = |chain: &Vec<SurfacePoint>| chain.iter().map(|p| position(p).y).fold(f64::INFINITY, f64::min);
        let Some(first) = (0..chains.len()).min_by(|a, b| foremost(&chains[*a]).total_cmp(&foremost(&chains[*b])))
        else {
            return Self::default();
        };
        let mut outer = chains.swap_remove(first);
        let is_loop = outer.len() > 3 && outer.first() == outer.last();
        let hindmost = (0..outer.len()).max_by(|a, b| position(&outer[*a]).y.total_cmp(&position(&outer[*b]).y));
        let hindmost = hindmost.unwrap_or(0);
        if is_loop {
            // Begin at the hindmost point, so that no profile runs over the loop's end.
            outer.pop();
            outer.rotate_left(hindmost);
        } else if outer.get(hindmost).is_some_and(|p| position(p).y > foremost(&outer) + PROFILE_BEHIND_MM) {
            // Parted lips cut the loop round a head open: the line runs from one lip over the back of the head to the other.
            let mut rest = outer.split_off(hindmost);
            if rest.iter().map(|p| position(p).y).fold(f64::INFINITY, f64::min) < foremost(&outer) {
                std::mem::swap(&mut outer, &mut rest);
            }
            chains.push(rest);
        }
        let nose = (0..outer.len()).min_by(|a, b| position(&outer[*a]).y.total_cmp(&position(&outer[*b]).y));
        let Some(mut nose) = nose else { return Self::default() };
        if is_upward(&outer, nose, &position) {
            outer.reverse();
            nose = outer.len() - 1 - nose;
        }
        let tip = position(&outer[nose]);
        let is_front = |p: &SurfacePoint| {
            let p = position(p);
            p.y < tip.y + PROFILE_BEHIND_MM && (tip.z - PROFILE_BELOW_MM..tip.z + PROFILE_ABOVE_MM).contains(&p.z)
        };
        let above = outer[..nose].iter().rev().take_while(|p| is_front(p)).count();
        let below = outer[nose..].iter().take_while(|p| is_front(p)).count();
        let mut points: Vec<SurfacePoint> = outer[nose - above..nose + below].to_vec();
        let mut breaks = Vec::new();
        let ends_at_mouth = points.last().is_some_and(|end| position(end).z > tip.z - MOUTH_BELOW_MM);
        if nose + below == outer.len() && !is_loop && ends_at_mouth {
            join(&mut points, &mut breaks, &mut chains, &position, &is_front);
        }
        let rest = points.iter().map(position).collect();
        Self { points, rest, breaks }
    }

    /// Index of the point closest to `p` in the plane.
    pub(super) fn index_near(&self, p: &Point) -> Option<usize> {
        let off = |i: &usize| (self.rest[*i].y - p.y).hypot(self.rest[*i].z - p.z);
        (0..self.rest.len()).min_by(|a, b| off(a).total_cmp(&off(b)))
    }
}

/// Appends the pieces of the line below a gap: the next open chain that begins near the last one's end.
fn join(
    points: &mut Vec<SurfacePoint>,
    breaks: &mut Vec<usize>,
    chains: &mut Vec<Vec<SurfacePoint>>,
    position: &dyn Fn(&SurfacePoint) -> Point,
    is_front: &dyn Fn(&SurfacePoint) -> bool,
) {
    while let Some(end) = points.last().map(position) {
        let ends = |i: usize| {
            let chain = &chains[i];
            let off = |p: Option<&SurfacePoint>| p.map_or(f64::INFINITY, |p| (position(p) - end).norm());
            if chain.first() == chain.last() { [f64::INFINITY; 2] } else { [off(chain.first()), off(chain.last())] }
        };
        let near = |i: &usize| ends(*i)[0].min(ends(*i)[1]);
        let Some(next) = (0..chains.len()).min_by(|a, b| near(a).total_cmp(&near(b))) else { return };
        let [begin, finish] = ends(next);
        if begin.min(finish) > MAX_BREAK_MM {
            return;
        }
        let mut chain = chains.swap_remove(next);
        if finish < begin {
            chain.reverse();
        }
        breaks.push(points.len());
        let whole = chain.len();
        points.extend(chain.into_iter().take_while(|p| is_front(p)));
        if points.len() < breaks.last().copied().unwrap_or(0) + whole {
            return;
        }
    }
}

/// Whether the line runs upward through the nose: over 20 mm to both sides of it, because the tip itself is round.
fn is_upward(outer: &[SurfacePoint], nose: usize, position: &dyn Fn(&SurfacePoint) -> Point) -> bool {
    const AROUND_MM: f64 = 20.0;
    let tip = position(&outer[nose]);
    let beside = |mut side: Box<dyn Iterator<Item = &SurfacePoint> + '_>| {
        side.find(|p| (position(p) - tip).norm() > AROUND_MM).map(position)
    };
    let before = beside(Box::new(outer[..nose].iter().rev())).unwrap_or(tip);
    let after = beside(Box::new(outer[nose..].iter())).unwrap_or(tip);
    after.z > before.z
}

/// Lines in which the plane cuts the surface, in no particular order; a closed one ends at its first point.
///
/// A vertex on the plane counts as beyond it, so that every cut triangle has exactly two crossed edges.
fn chains(skin: &TriMesh, midline_x_mm: f64) -> Vec<Vec<SurfacePoint>> {
    let beyond: Vec<bool> = skin.positions().iter().map(|p| p.x >= midline_x_mm).collect();
    let side = |v: u32| beyond[v as usize];
    let mut lines: Vec<[[u32; 2]; 2]> = Vec::new();
    for corners in skin.triangles() {
        let edges = [0, 1, 2].map(|i| {
            let (a, b) = (corners[i], corners[(i + 1) % 3]);
            [a.min(b), a.max(b)]
        });
        let crossed: Vec<[u32; 2]> = edges.into_iter().filter(|[a, b]| side(*a) != side(*b)).collect();
        if let [one, other] = crossed[..] {
            lines.push([one, other]);
        }
    }
    let mut at: BTreeMap<[u32; 2], Vec<usize>> = BTreeMap::new();
    for (line, ends) in lines.iter().enumerate() {
        ends.iter().for_each(|edge| at.entry(*edge).or_default().push(line));
    }
    let mut used = vec![false; lines.len()];
    let mut follow = |from: [u32; 2]| {
        let mut chain = vec![from];
        let mut edge = from;
        while let Some(line) = at.get(&edge).and_then(|lines| lines.iter().find(|l| !used[**l])) {
            used[*line] = true;
            let [a, b] = lines[*line];
            edge = if a == edge { b } else { a };
            chain.push(edge);
        }
        chain
    };
    // Open lines first, from their ends; what is left is closed.
    let ends = at.iter().filter(|(_, lines)| lines.len() % 2 == 1).map(|(edge, _)| *edge);
    let all: Vec<Vec<[u32; 2]>> = ends.chain(at.keys().copied()).map(&mut follow).collect();
    let point = |[a, b]: &[u32; 2]| {
        let [xa, xb] = [a, b].map(|v| skin.positions()[*v as usize].x);
        SurfacePoint::on_edge([*a, *b], ((midline_x_mm - xa) / (xb - xa)).clamp(0.0, 1.0))
    };
    all.into_iter().filter(|c| c.len() > 1).map(|chain| chain.iter().map(point).collect()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::phantom::{head, surface_of};
    use prosopon_geometry::TopologyFaults;
    use prosopon_tissue::mesh::{Slit, SlitKnot, part_skin};

    #[test]
    fn the_section_of_the_phantom_runs_from_brow_to_neck_along_its_skin() {
        let head = head();
        let skin = surface_of(head.skin.as_ref(), &head.bounds(), 2.0).unwrap();
        let section = Section::new(&skin, 0.3);
        assert!(section.breaks.is_empty() && section.rest.len() > 100);
        for p in &section.rest {
            // The surface's own distance from the analytic skin at a spacing of 2 mm.
            assert!((p.x - 0.3).abs() < 1e-9 && head.skin.value(p).abs() < 0.3, "{p}: {}", head.skin.value(p));
        }
        let (top, end) = (section.rest[0], section.rest[section.rest.len() - 1]);
        assert!(top.z > 90.0 && end.z < -40.0, "{top} {end}");
        let longest = section.rest.windows(2).map(|w| (w[1] - w[0]).norm()).fold(0.0, f64::max);
        assert!(longest < 4.0, "{longest}");
        // A point of skin moves with its triangle.
        let shifted = skin.moved(&prosopon_geometry::Motion::translation(1.0, -2.0, 3.0));
        let moved = section.points[40].on(&shifted) - section.rest[40];
        assert!((moved - prosopon_geometry::Vector::new(1.0, -2.0, 3.0)).norm() < 1e-12);
        assert!(Section::new(&skin, 500.0).rest.is_empty());
    }

    #[test]
    fn parting_the_lips_of_a_closed_skin_breaks_its_line_at_the_slit_and_moves_no_point() {
        let head = head();
        let skin = surface_of(head.skin.as_ref(), &head.bounds(), 2.0).unwrap();
        assert!(TopologyFaults::of(&skin).is_closed_manifold());
        let whole = Section::near(&skin, 0.3);
        let lips = whole.rest.iter().find(|p| p.z < 1.0).unwrap();
        let knot = |x: f64| SlitKnot { front: Point::new(x, lips.y, 1.0), back_y: lips.y + 25.0 };
        let slit = Slit::new([-22.0, -8.0, 0.3, 8.0, 22.0].map(knot).to_vec()).unwrap();
        let parted = part_skin(&skin, &slit).unwrap().skin;
        let section = Section::near(&parted, 0.3);
        let [begin] = section.breaks[..] else { panic!("{:?}", section.breaks) };
        // Both margins lie on the slit, and the line below it reaches the neck as on the whole skin.
        for margin in [section.rest[begin - 1], section.rest[begin]] {
            assert!((margin.z - 1.0).abs() < 1e-9, "{margin}");
        }
        let is_known = |p: &Point| section.rest.iter().any(|q| (p - q).norm() < 1e-9);
        assert!(whole.rest.iter().all(is_known));
        // New points, where the plane crosses edges along the slit, lie on the line too.
        let to_line = |p: &Point| {
            let segments = whole.rest.windows(2).map(|w| {
                let along = w[1] - w[0];
                let t = ((p - w[0]).dot(&along) / along.norm_squared()).clamp(0.0, 1.0);
                (p - (w[0] + along * t)).norm()
            });
            segments.fold(f64::INFINITY, f64::min)
        };
        assert!(section.rest.iter().all(|p| to_line(p) < 1e-6));
    }

    #[test]
    fn a_point_of_a_triangle_is_found_again() {
        let corners = [[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [0.0, 10.0, 0.0]].map(Point::from);
        let mesh = TriMesh::new(corners.to_vec(), vec![[0, 1, 2]]).unwrap();
        let p = Point::new(2.0, 3.0, 0.0);
        assert!((SurfacePoint::in_triangle(&mesh, 0, &p).on(&mesh) - p).norm() < 1e-12);
    }
}
