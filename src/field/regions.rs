//! Parts of a surface where inside and outside are not clear.

use std::collections::BTreeMap;

use super::exact::{ExactDistance, is_inside};
use super::region::{Region, RegionKind, RegionsOfKind};
use prosopon_geometry::control::{Cancelled, Control};
use prosopon_geometry::{Aabb, Point, TriMesh};
use rayon::prelude::*;

/// A winding number is clear when its magnitude differs from one half by at least this.
const CLEAR_MARGIN: f64 = 0.2;
/// Distance from a triangle at which the winding number is evaluated, as a share of the box's diagonal.
const BESIDE: f64 = 1e-7;

/// Finds the parts of `surface` where inside and outside are not clear; `exact` was made from it.
///
/// The result is empty for a closed, consistently oriented surface that does not cross itself. The winding number is evaluated
/// on both sides of every triangle, at its middle. A triangle has one kind, the first that applies in the order: no
/// area, copy, inverted, ambiguous, buried, sheet.
///
/// ```
/// use prosopon_field::{RegionKind, ExactDistance, unclear_regions};
/// use prosopon_geometry::control::Control;
/// use prosopon_geometry::{Point, TriMesh};
///
/// // A tetrahedron without its slanted face: the hole has three edges.
/// let corners = [[0.0, 0.0, 0.0], [9.0, 0.0, 0.0], [0.0, 9.0, 0.0], [0.0, 0.0, 9.0]];
/// let open = TriMesh::new(corners.map(Point::from).to_vec(), vec![[0, 2, 1], [0, 1, 3], [0, 3, 2]])?;
/// let found = unclear_regions(&open, &ExactDistance::new(&open), &Control::new())?;
/// assert_eq!((found[0].kind, found[0].count, found[0].elements), (RegionKind::Open, 1, 3));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// [`Cancelled`].
pub fn unclear_regions(
    surface: &TriMesh,
    exact: &ExactDistance,
    control: &Control,
) -> Result<Vec<RegionsOfKind>, Cancelled> {
    let defects = exact.defects();
    let beside = BESIDE * surface.bounds().diagonal();
    let inverted = inverted(surface, &defects.triangles, &defects.counts);
    let kinds = (0..surface.triangles().len())
        .into_par_iter()
        .map(|t| {
            if t % 256 == 0 {
                control.check()?;
            }
            let Some(normal) = surface.scaled_normal(t).try_normalize(0.0) else { return Ok(Some(RegionKind::NoArea)) };
            if !defects.counts[t] {
                return Ok(Some(RegionKind::Copy));
            }
            let [a, b, c] = surface.corners(t);
            let middle = a + ((b - a) + (c - a)) / 3.0;
            let [front, back] = [beside, -beside].map(|s| exact.winding_number(&(middle + normal * s)));
            Ok(if inverted[t] { Some(RegionKind::Inverted) } else { kind_of(front, back) })
        })
        .collect::<Result<Vec<_>, Cancelled>>()?;
    let mut found = rims(exact);
    for (kind, parts) in connected(surface, &defects.triangles, &kinds) {
        let regions = parts.iter().map(|part| region(surface, part)).collect();
        found.push(RegionsOfKind::new(kind, regions));
    }
    Ok(found)
}

/// The kind that follows from the winding numbers in front of a triangle and behind it.
fn kind_of(front: f64, back: f64) -> Option<RegionKind> {
    if [front, back].iter().any(|w| (w.abs() - 0.5).abs() < CLEAR_MARGIN) {
        return Some(RegionKind::Ambiguous);
    }
    match (is_inside(front), is_inside(back)) {
        (false, true) => None,
        (true, false) => Some(RegionKind::Inverted),
        (true, true) => Some(RegionKind::Buried),
        (false, false) => Some(RegionKind::Sheet),
    }
}

/// For every triangle, whether it faces opposite to most of the area that it is connected to.
///
/// Triangles are connected through edges with exactly two triangles.
fn inverted(surface: &TriMesh, triangles: &[[u32; 3]], counts: &[bool]) -> Vec<bool> {
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
        // Neighbours of the same orientation run along their common edge in opposite directions.
        let differs = pair[0].3 == pair[1].3;
        join(pair[0].2, pair[1].2, differs);
        join(pair[1].2, pair[0].2, differs);
    }
    let mut side: Vec<Option<bool>> = vec![None; triangles.len()];
    let mut inverted = vec![false; triangles.len()];
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
        part.iter().for_each(|&t| inverted[t] = side[t] == Some(lesser));
    }
    inverted
}

/// Triangles of the same kind connected by vertices; sorted by kind, then by first triangle.
fn connected(
    surface: &TriMesh,
    triangles: &[[u32; 3]],
    kinds: &[Option<RegionKind>],
) -> BTreeMap<RegionKind, Vec<Vec<usize>>> {
    let mut at_vertex: BTreeMap<(RegionKind, u32), usize> = BTreeMap::new();
    let mut parents: Vec<usize> = (0..surface.triangles().len()).collect();
    fn root(parents: &mut [usize], t: usize) -> usize {
        let mut top = t;
        while parents[top] != top {
            parents[top] = parents[parents[top]];
            top = parents[top];
        }
        top
    }
    for (t, kind) in kinds.iter().enumerate() {
        let Some(kind) = kind else { continue };
        for &v in &triangles[t] {
            let other = *at_vertex.entry((*kind, v)).or_insert(t);
            let (a, b) = (root(&mut parents, t), root(&mut parents, other));
            parents[a.max(b)] = a.min(b);
        }
    }
    let mut parts: BTreeMap<RegionKind, BTreeMap<usize, Vec<usize>>> = BTreeMap::new();
    for (t, kind) in kinds.iter().enumerate() {
        if let Some(kind) = kind {
            let root = root(&mut parents, t);
            parts.entry(*kind).or_default().entry(root).or_default().push(t);
        }
    }
    parts.into_iter().map(|(kind, parts)| (kind, parts.into_values().collect())).collect()
}

fn region(surface: &TriMesh, part: &[usize]) -> Region {
    let area_mm2 = part.iter().map(|&t| 0.5 * surface.scaled_normal(t).norm()).sum();
    let points: Vec<Point> = part.iter().flat_map(|&t| surface.corners(t)).collect();
    // The fallback is never used: a part has at least one triangle.
    let bounds = Aabb::of(&points).unwrap_or_else(|| surface.bounds());
    Region { elements: part.len(), area_mm2, bounds }
}

fn rims(exact: &ExactDistance) -> Vec<RegionsOfKind> {
    let regions = exact.defects().rim.regions();
    if regions.is_empty() { Vec::new() } else { vec![RegionsOfKind::new(RegionKind::Open, regions)] }
}
