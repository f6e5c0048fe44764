//! Where a surface leaves it open what is inside.

use std::collections::BTreeMap;

use super::exact::{ExactDistance, is_inside};
use prosopon_geometry::control::{Cancelled, Control};
use prosopon_geometry::{Aabb, Point, TriMesh};
use rayon::prelude::*;

/// A winding number is clear when its magnitude is at least this far from one half.
const CLEAR: f64 = 0.2;
/// How far beside a triangle the winding number is asked, as a share of the box's diagonal.
const BESIDE: f64 = 1e-7;
/// Most places that are listed of a kind.
const MOST_PLACES: usize = 50;

/// What is doubtful about a part of a surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Doubt {
    /// A rim along which the triangles of the two sides do not cancel: a hole, or the end of a sheet.
    Open,
    /// Triangles that look the other way than their surroundings, or whose normals point into the solid.
    Inverted,
    /// Next to these triangles the winding number's magnitude is within 0.2 of one half.
    Ambiguous,
    /// Inside on both sides: within another part of the surface.
    Buried,
    /// Outside on both sides: a sheet that bounds nothing.
    Sheet,
    /// At the same place as another triangle.
    Copy,
    /// Triangles without area.
    NoArea,
}

/// A connected part of a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Region {
    /// Triangles of the part, or for a rim its edges.
    pub elements: usize,
    /// Area, for a rim that of a fan over it, mm².
    pub area_mm2: f64,
    /// Box around it, LPS mm.
    pub bounds: Aabb,
}

/// All regions with one kind of doubt.
#[derive(Debug, Clone, PartialEq)]
pub struct DoubtfulRegions {
    /// The kind.
    pub doubt: Doubt,
    /// Number of regions.
    pub count: usize,
    /// Triangles of all of them, or for rims edges.
    pub elements: usize,
    /// Their area, mm².
    pub area_mm2: f64,
    /// The largest of them by area, at most 50.
    pub largest: Vec<Region>,
}

/// The doubtful parts of `surface`, for which `exact` was made; nothing for a closed, consistently oriented surface that does
/// not cross itself.
///
/// On both sides of every triangle the winding number is asked (at its middle). A triangle has one doubt, the first
/// that applies of: no area, a copy, inverted, ambiguous, buried, a sheet.
///
/// # Errors
/// [`Cancelled`].
pub fn doubtful_regions(
    surface: &TriMesh,
    exact: &ExactDistance,
    control: &Control,
) -> Result<Vec<DoubtfulRegions>, Cancelled> {
    let defects = exact.defects();
    let beside = BESIDE * surface.bounds().diagonal();
    let turned = turned(surface, &defects.triangles, &defects.counts);
    let doubts = (0..surface.triangles().len())
        .into_par_iter()
        .map(|t| {
            if t % 256 == 0 {
                control.check()?;
            }
            let Some(normal) = surface.scaled_normal(t).try_normalize(0.0) else { return Ok(Some(Doubt::NoArea)) };
            if !defects.counts[t] {
                return Ok(Some(Doubt::Copy));
            }
            let [a, b, c] = surface.corners(t);
            let middle = a + ((b - a) + (c - a)) / 3.0;
            let [front, back] = [beside, -beside].map(|s| exact.winding_number(&(middle + normal * s)));
            Ok(if turned[t] { Some(Doubt::Inverted) } else { doubt(front, back) })
        })
        .collect::<Result<Vec<_>, Cancelled>>()?;
    let mut found = rims(exact);
    for (kind, parts) in connected(surface, &defects.triangles, &doubts) {
        let regions = parts.iter().map(|part| region(surface, part)).collect();
        found.push(summed(kind, regions));
    }
    Ok(found)
}

/// What the winding numbers on a triangle's two sides say.
fn doubt(front: f64, back: f64) -> Option<Doubt> {
    if [front, back].iter().any(|w| (w.abs() - 0.5).abs() < CLEAR) {
        return Some(Doubt::Ambiguous);
    }
    match (is_inside(front), is_inside(back)) {
        (false, true) => None,
        (true, false) => Some(Doubt::Inverted),
        (true, true) => Some(Doubt::Buried),
        (false, false) => Some(Doubt::Sheet),
    }
}

/// For every triangle whether it looks the other way than most of the area that it is connected to through edges with two
/// triangles.
fn turned(surface: &TriMesh, triangles: &[[u32; 3]], counts: &[bool]) -> Vec<bool> {
    let mut sides: Vec<(u32, u32, u32, bool)> = triangles
        .par_iter()
        .enumerate()
        .filter(|(t, _)| counts[*t])
        .flat_map_iter(|(t, v)| {
            [0, 1, 2].map(|i| {
                let (a, b) = (v[i], v[(i + 1) % 3]);
                (a.min(b), a.max(b), t as u32, a < b)
            })
        })
        .collect();
    sides.par_sort_unstable();
    let mut neighbours: Vec<[Option<(u32, bool)>; 3]> = vec![[None; 3]; triangles.len()];
    let mut join = |t: u32, other: u32, differs: bool| {
        let places = &mut neighbours[t as usize];
        if let Some(place) = places.iter_mut().find(|p| p.is_none()) {
            *place = Some((other, differs));
        }
    };
    for pair in sides.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)).filter(|same| same.len() == 2) {
        // Neighbours that look the same way run along their edge in opposite directions.
        let differs = pair[0].3 == pair[1].3;
        join(pair[0].2, pair[1].2, differs);
        join(pair[1].2, pair[0].2, differs);
    }
    let mut side: Vec<Option<bool>> = vec![None; triangles.len()];
    let mut turned = vec![false; triangles.len()];
    for seed in 0..triangles.len() {
        if side[seed].is_some() {
            continue;
        }
        side[seed] = Some(false);
        let mut part = vec![seed];
        let mut next = 0;
        while next < part.len() {
            let t = part[next];
            next += 1;
            for &(other, differs) in neighbours[t].iter().flatten() {
                if side[other as usize].is_none() {
                    side[other as usize] = side[t].map(|s| s != differs);
                    part.push(other as usize);
                }
            }
        }
        let area = |which: bool| -> f64 {
            part.iter().filter(|&&t| side[t] == Some(which)).map(|&t| surface.scaled_normal(t).norm()).sum()
        };
        let lesser = area(true) <= area(false);
        part.iter().for_each(|&t| turned[t] = side[t] == Some(lesser));
    }
    turned
}

/// Triangles with the same doubt that hang together by vertices, by kind and then by their first triangle.
fn connected(surface: &TriMesh, triangles: &[[u32; 3]], doubts: &[Option<Doubt>]) -> BTreeMap<Doubt, Vec<Vec<usize>>> {
    let mut at_vertex: BTreeMap<(Doubt, u32), usize> = BTreeMap::new();
    let mut parents: Vec<usize> = (0..surface.triangles().len()).collect();
    fn root(parents: &mut [usize], t: usize) -> usize {
        let mut top = t;
        while parents[top] != top {
            parents[top] = parents[parents[top]];
            top = parents[top];
        }
        top
    }
    for (t, doubt) in doubts.iter().enumerate() {
        let Some(doubt) = doubt else { continue };
        for &v in &triangles[t] {
            let other = *at_vertex.entry((*doubt, v)).or_insert(t);
            let (a, b) = (root(&mut parents, t), root(&mut parents, other));
            parents[a.max(b)] = a.min(b);
        }
    }
    let mut parts: BTreeMap<Doubt, BTreeMap<usize, Vec<usize>>> = BTreeMap::new();
    for (t, doubt) in doubts.iter().enumerate() {
        if let Some(doubt) = doubt {
            let root = root(&mut parents, t);
            parts.entry(*doubt).or_default().entry(root).or_default().push(t);
        }
    }
    parts.into_iter().map(|(doubt, parts)| (doubt, parts.into_values().collect())).collect()
}

fn region(surface: &TriMesh, part: &[usize]) -> Region {
    let area_mm2 = part.iter().map(|&t| 0.5 * surface.scaled_normal(t).norm()).sum();
    let points: Vec<Point> = part.iter().flat_map(|&t| surface.corners(t)).collect();
    // A part has at least one triangle.
    let bounds = Aabb::of(&points).unwrap_or_else(|| surface.bounds());
    Region { elements: part.len(), area_mm2, bounds }
}

fn rims(exact: &ExactDistance) -> Vec<DoubtfulRegions> {
    let regions = exact.defects().rim.regions();
    if regions.is_empty() { Vec::new() } else { vec![summed(Doubt::Open, regions)] }
}

fn summed(doubt: Doubt, mut regions: Vec<Region>) -> DoubtfulRegions {
    let count = regions.len();
    let elements = regions.iter().map(|r| r.elements).sum();
    let area_mm2 = regions.iter().map(|r| r.area_mm2).sum();
    regions.sort_by(|a, b| b.area_mm2.total_cmp(&a.area_mm2));
    regions.truncate(MOST_PLACES);
    DoubtfulRegions { doubt, count, elements, area_mm2, largest: regions }
}
