//! Lattice in which some cubes are refined.

use super::lattice::Lattice;
use prosopon_geometry::Point;

/// Body-centred cubic lattice in which marked cubes are split into eight cubes of half the edge.
///
/// Where refined cubes meet whole ones, half pyramids on quarters of the faces join both. Tetrahedra along a whole edge with a
/// vertex in its middle are split, so there are no hanging vertices. A vertex has quadrupled coordinates, in units of a quarter
/// of an edge.
///
/// # Source
/// Labelle and Shewchuk, Isosurface stuffing, SIGGRAPH 2007, section 3.2, with one level.
#[derive(Debug, Clone)]
pub(super) struct RefinedLattice {
    whole: Lattice,
    /// Whether each cube is refined; cubes are numbered like their centres.
    refined: Vec<bool>,
    /// Quadrupled coordinates of the vertices that refinement adds, ascending.
    /// Corners and centres of whole cubes are numbered before them.
    added: Vec<[i32; 3]>,
}

/// Corners of a cube.
const CORNERS: [[i32; 3]; 8] = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [0, 0, 1], [1, 0, 1], [0, 1, 1], [1, 1, 1]];

impl RefinedLattice {
    pub(super) fn new(whole: Lattice, refined: Vec<bool>) -> Self {
        let mut added: Vec<[i32; 3]> = Vec::new();
        for (cube, _) in refined.iter().enumerate().filter(|(_, h)| **h) {
            let low = whole.low_corner(cube).map(|c| 2 * c);
            for k in 0..3 {
                for j in 0..3 {
                    for i in 0..3 {
                        added.push([low[0] + 2 * i, low[1] + 2 * j, low[2] + 2 * k]);
                    }
                }
            }
            added.extend(CORNERS.map(|o| [0, 1, 2].map(|a| low[a] + 2 * o[a] + 1)));
        }
        added.retain(|c| whole_coordinates(*c).is_none());
        added.sort_unstable();
        added.dedup();
        Self { whole, refined, added }
    }

    pub(super) fn vertex_count(&self) -> usize {
        self.whole.vertex_count() + self.added.len()
    }

    pub(super) fn position(&self, index: usize) -> Point {
        match self.added.get(index.wrapping_sub(self.whole.vertex_count())) {
            Some(c) => self.whole.at_quarters(*c),
            None => self.whole.position(index),
        }
    }

    fn vertex(&self, quarters: [i32; 3]) -> Option<u32> {
        let index = match whole_coordinates(quarters) {
            Some(c) => self.whole.index(c)?,
            None => self.whole.vertex_count() + self.added.binary_search(&quarters).ok()?,
        };
        Some(index as u32)
    }

    fn is_refined(&self, cube: Option<usize>) -> bool {
        cube.is_some_and(|c| self.refined.get(c) == Some(&true))
    }

    /// Whether one of the cubes at the vertex is refined.
    pub(super) fn is_fine(&self, index: usize) -> bool {
        if index >= self.whole.vertex_count() {
            return true;
        }
        self.whole.cubes_at(index).any(|cube| self.is_refined(Some(cube)))
    }

    /// Vertices accepted by [`Self::tetrahedra`]: each tetrahedron belongs to one of them.
    pub(super) fn owners(&self) -> std::ops::Range<usize> {
        self.whole.corner_indices()
    }

    /// Appends the tetrahedra that belong to the corner `owner`, in either orientation.
    pub(super) fn tetrahedra(&self, owner: usize, out: &mut Vec<[u32; 4]>) {
        for axis in 0..3 {
            for t in self.whole.tetrahedra(owner, axis) {
                let [a, p, r, b] = t;
                if [p, r].iter().any(|&centre| self.is_refined(self.whole.cube_of_centre(centre as usize))) {
                    continue;
                }
                let middle = if self.added.is_empty() { None } else { self.middle(owner, axis) };
                match middle {
                    Some(m) => out.extend([[a, p, r, m], [m, p, r, b]]),
                    None => out.push(t),
                }
            }
        }
        let low = self.whole.coordinates(owner);
        if self.is_refined(self.whole.cube_at(low)) {
            for o in CORNERS {
                self.small_cube([0, 1, 2].map(|a| 2 * low[a] + 2 * o[a] + 1), out);
            }
        }
    }

    /// The vertex at the midpoint of the whole edge from the corner `owner` along `axis`.
    fn middle(&self, owner: usize, axis: usize) -> Option<u32> {
        let mut c = self.whole.coordinates(owner).map(|c| 2 * c);
        c[axis] += 2;
        self.vertex(c)
    }

    /// Tetrahedra through the faces of the half cube around `centre`.
    /// Those shared with another half cube belong to the lower one.
    fn small_cube(&self, centre: [i32; 3], out: &mut Vec<[u32; 4]>) {
        let Some(own) = self.vertex(centre) else { return };
        for axis in 0..3 {
            for side in [-1, 1] {
                let moved = |by: i32| {
                    let mut c = centre;
                    c[axis] += side * by;
                    c
                };
                let beyond = moved(2);
                let low = beyond.map(|c| c.div_euclid(4) * 2);
                let Some(cube) = self.whole.cube_at(low) else { continue };
                let face = moved(1);
                let corner = |u: i32, v: i32| {
                    let mut c = face;
                    c[(axis + 1) % 3] += u;
                    c[(axis + 2) % 3] += v;
                    c
                };
                let ring = [corner(-1, -1), corner(1, -1), corner(1, 1), corner(-1, 1)];
                let vertices = ring.map(|c| self.vertex(c));
                let [Some(a), Some(b), Some(c), Some(d)] = vertices else { continue };
                if self.is_refined(Some(cube)) {
                    if side == 1
                        && let Some(other) = self.vertex(beyond)
                    {
                        out.extend([[a, b, own, other], [b, c, own, other], [c, d, own, other], [d, a, own, other]]);
                    }
                    continue;
                }
                // The diagonal from the middle of the whole face to its corner.
                let middle = ring.iter().position(|c| (0..3).filter(|x| *x != axis).all(|x| c[x].rem_euclid(4) == 2));
                let Some(other) = self.vertex(low.map(|c| 2 * c + 2)) else { continue };
                let [o, e, k, f] = match middle {
                    Some(0) => [a, b, c, d],
                    Some(1) => [b, c, d, a],
                    Some(2) => [c, d, a, b],
                    _ => [d, a, b, c],
                };
                out.extend([[o, e, k, own], [o, k, f, own], [o, e, k, other], [o, k, f, other]]);
            }
        }
    }
}

/// Doubled coordinates of a corner or centre of a whole cube; `None` for the vertices added by refinement.
fn whole_coordinates(quarters: [i32; 3]) -> Option<[i32; 3]> {
    let remainders = quarters.map(|c| c.rem_euclid(4));
    (remainders == [0; 3] || remainders == [2; 3]).then(|| quarters.map(|c| c / 2))
}

#[cfg(test)]
mod tests {
    use super::super::adjacency::{boundary, shared_faces};
    use super::super::quality::{dihedral_range, tetrahedron_volume};
    use super::*;
    use prosopon_geometry::Aabb;

    /// Some cubes refined: alone, in a row, across an edge and across a corner.
    /// There must be no hanging vertex, no overlap and no flat tetrahedron.
    #[test]
    fn refined_cubes_join_whole_ones() {
        let bounds = Aabb { min: Point::origin(), max: Point::new(6.0, 5.0, 4.0) };
        let whole = Lattice::covering(&bounds, 1.0);
        let mut refined = vec![false; whole.cube_count()];
        let cube = |at: [i32; 3]| whole.cube_at(at.map(|c| 2 * c)).unwrap();
        for at in [[2, 2, 2], [3, 2, 2], [4, 3, 2], [5, 5, 4], [6, 6, 5]] {
            refined[cube(at)] = true;
        }
        let count = |lattice: &RefinedLattice| {
            let mut all = Vec::new();
            lattice.owners().for_each(|v| lattice.tetrahedra(v, &mut all));
            for t in &mut all {
                if tetrahedron_volume(&t.map(|i| lattice.position(i as usize))) < 0.0 {
                    t.swap(2, 3);
                }
            }
            all
        };
        let plain = count(&RefinedLattice::new(whole.clone(), vec![false; refined.len()]));
        let lattice = RefinedLattice::new(whole, refined);
        let all = count(&lattice);
        let corners = |t: &[u32; 4]| t.map(|i| lattice.position(i as usize));
        let volume = |tets: &[[u32; 4]]| tets.iter().map(|t| tetrahedron_volume(&corners(t))).sum::<f64>();
        assert!((volume(&all) - volume(&plain)).abs() < 1e-9);
        assert!(all.iter().all(|t| dihedral_range(&corners(t)).0 > 29.9));
        assert_eq!(shared_faces(&all).1, 0);
        // Every face has two tetrahedra except on the border. The border is the same as without refinement, since no refined
        // cube is there.
        let border = |tets: &[[u32; 4]]| {
            let mut faces: Vec<[u32; 3]> =
                boundary(tets).iter().map(|f| super::super::adjacency::sorted(f.nodes)).collect();
            faces.sort_unstable();
            faces
        };
        assert_eq!(border(&all), border(&plain));
        assert!((0..lattice.vertex_count()).filter(|v| lattice.is_fine(*v)).count() > lattice.added.len());
    }
}
