use super::FieldError;
use super::rim::{NetEdge, Rim};
use prosopon_geometry::{Point, TriMesh, Warning};
use rayon::prelude::*;

/// Above this share of its edges a rim is no small flaw but a missing part.
const MAX_OPEN_SHARE: f64 = 0.01;

/// Above this share a surface is more rim than surface. Exports of clinics, with cavities and self-intersections, have below 2 %; a ball
/// of which 30 % of the triangles are missing has 46 %.
const TOO_OPEN_SHARE: f64 = 0.4;
/// Rims of so few edges are measured in any case.
const FEW_OPEN: usize = 300;

/// Defects of a triangle soup as the boundary of a solid; vertices at the same position count as one.
#[derive(Debug, Clone)]
pub(super) struct Defects {
    /// The triangles with welded vertices: those at the same position share the smallest index.
    pub(super) triangles: Vec<[u32; 3]>,
    /// Whether each triangle counts for the winding number.
    ///
    /// Of identical triangles one counts, or none when as many face one way as the other.
    pub(super) counts: Vec<bool>,
    /// Whether each triangle has area and is the first at its position.
    pub(super) distinct: Vec<bool>,
    /// Edges at which the counted triangles do not cancel: the rim of holes and sheets.
    pub(super) rim: Rim,
    /// Number of edges of the counted triangles.
    pub(super) n_edges: usize,
    /// Number of triangles that do not count because another one at the same position faces the same way.
    pub(super) duplicates: usize,
    /// Number of triangles that do not count because another one at the same position faces the other way.
    pub(super) cancelled: usize,
    /// Number of triangles without area.
    pub(super) without_area: usize,
}

impl Defects {
    pub(super) fn of(mesh: &TriMesh) -> Self {
        let welded = weld(mesh.positions());
        let triangles: Vec<[u32; 3]> = mesh.triangles().iter().map(|t| t.map(|v| welded[v as usize])).collect();
        let is_flat = |t: usize| {
            triangles[t][0] == triangles[t][1]
                || triangles[t][1] == triangles[t][2]
                || triangles[t][2] == triangles[t][0]
        };
        let without_area =
            (0..triangles.len()).into_par_iter().filter(|&t| is_flat(t) || mesh.scaled_normal(t).norm() == 0.0).count();

        let mut counts: Vec<bool> = (0..triangles.len()).map(|t| !is_flat(t)).collect();
        let mut distinct = counts.clone();
        let mut keys: Vec<([u32; 3], bool, u32)> = (0..triangles.len())
            .into_par_iter()
            .filter(|&t| counts[t])
            .map(|t| {
                let (key, even) = sorted(triangles[t]);
                (key, even, t as u32)
            })
            .collect();
        keys.par_sort_unstable();
        let (mut duplicates, mut cancelled) = (0, 0);
        for same in keys.chunk_by(|a, b| a.0 == b.0).filter(|same| same.len() > 1) {
            let n_even = same.iter().filter(|k| k.1).count();
            let n_odd = same.len() - n_even;
            let kept = same.iter().find(|k| n_even != n_odd && k.1 == (n_even > n_odd)).map(|k| k.2);
            for (n, key) in same.iter().enumerate() {
                counts[key.2 as usize] = Some(key.2) == kept;
                distinct[key.2 as usize] = n == 0;
            }
            cancelled += 2 * n_even.min(n_odd);
            duplicates += n_even.abs_diff(n_odd).saturating_sub(1);
        }
        let edges = net_edges(&triangles, &counts);
        let n_edges = edges.len();
        let open: Vec<NetEdge> = edges.into_iter().filter(|edge| edge.times != 0).collect();
        let rim = Rim::new(&open, mesh.positions());
        Self { triangles, counts, distinct, rim, n_edges, duplicates, cancelled, without_area }
    }

    /// Refuses a surface that is more rim than surface: the sign would be arbitrary, and each sample would be measured to each rim.
    pub(super) fn check(&self) -> Result<(), FieldError> {
        let (open, edges) = (self.rim.len(), self.n_edges);
        if open > FEW_OPEN && open as f64 > TOO_OPEN_SHARE * edges as f64 {
            return Err(FieldError::TooOpen { open, edges });
        }
        Ok(())
    }

    /// One warning for each kind of defect that is present.
    pub(super) fn warnings(&self) -> Vec<Warning> {
        let mut warnings = Vec::new();
        if !self.rim.is_empty() {
            let (open, all) = (self.rim.len(), self.n_edges);
            let found = format!(
                "the surface is open or inconsistently oriented along {open} of {all} edges; inside is where the winding \
                 number is above 0.5"
            );
            warnings.push(if open as f64 > MAX_OPEN_SHARE * all as f64 {
                Warning::check("open-surface", found).act("Check that no part of the surface is missing.")
            } else {
                Warning::info("open-surface", found)
            });
        }
        if self.duplicates > 0 {
            let found = format!("{} triangles duplicate others; they do not affect the sign", self.duplicates);
            warnings.push(Warning::info("duplicate-triangles", found));
        }
        if self.cancelled > 0 {
            let found = format!(
                "{} triangles lie in pairs that face opposite ways; they affect the distance but not the sign",
                self.cancelled
            );
            warnings.push(Warning::check("opposed-triangles", found).act("Remove sheets without thickness."));
        }
        warnings.extend(self.no_area_warning());
        warnings
    }

    /// Warning about triangles without area, if there are any.
    pub(super) fn no_area_warning(&self) -> Option<Warning> {
        let found = format!("{} triangles have no area; the distance uses their edges or points", self.without_area);
        (self.without_area > 0).then(|| Warning::info("triangles-without-area", found))
    }
}

/// For every vertex the smallest index of a vertex at the same position.
pub(super) fn weld(positions: &[Point]) -> Vec<u32> {
    let mut order: Vec<u32> = (0..positions.len() as u32).collect();
    let compare = |i: u32, j: u32| {
        let (p, q) = (&positions[i as usize], &positions[j as usize]);
        // Adding zero makes -0 equal to 0.
        (0..3).fold(std::cmp::Ordering::Equal, |o, a| o.then((p[a] + 0.0).total_cmp(&(q[a] + 0.0))))
    };
    order.par_sort_unstable_by(|&i, &j| compare(i, j).then(i.cmp(&j)));
    let mut welded = vec![0; positions.len()];
    for same in order.chunk_by(|&i, &j| compare(i, j).is_eq()) {
        for &v in same {
            welded[v as usize] = same[0];
        }
    }
    welded
}

/// The three indices in increasing order, and whether the permutation is even.
fn sorted(t: [u32; 3]) -> ([u32; 3], bool) {
    let mut key = t;
    key.sort_unstable();
    let even = (0..3).any(|r| [t[r], t[(r + 1) % 3], t[(r + 2) % 3]] == key);
    (key, even)
}

/// All edges of the counted triangles with their net counts.
fn net_edges(triangles: &[[u32; 3]], counts: &[bool]) -> Vec<NetEdge> {
    let mut edges: Vec<(u32, u32, bool)> = triangles
        .par_iter()
        .zip(counts)
        .filter(|(_, counts)| **counts)
        .flat_map_iter(|(t, _)| {
            (0..3).map(move |i| {
                let (a, b) = (t[i], t[(i + 1) % 3]);
                (a.min(b), a.max(b), a < b)
            })
        })
        .collect();
    edges.par_sort_unstable();
    let net = |same: &[(u32, u32, bool)]| NetEdge {
        ends: [same[0].0, same[0].1],
        times: same.iter().map(|e| if e.2 { 1 } else { -1 }).sum(),
    };
    edges.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)).map(net).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use prosopon_geometry::Severity;

    fn tetrahedron() -> (Vec<Point>, Vec<[u32; 3]>) {
        let p = vec![Point::origin(), Point::new(1.0, 0.0, 0.0), Point::new(0.0, 1.0, 0.0), Point::new(0.0, 0.0, 1.0)];
        (p, vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    }

    /// A ball of which many single triangles are missing is refused, one with a single large hole is not.
    #[test]
    fn surfaces_of_more_rim_than_surface_are_refused() {
        let (rings, sectors) = (20u32, 40u32);
        let point = |i: u32, j: u32| {
            let (a, b) = (f64::from(i) / f64::from(rings), f64::from(j) / f64::from(sectors));
            let (a, b) = (std::f64::consts::PI * a, std::f64::consts::TAU * b);
            Point::new(80.0 * a.sin() * b.cos(), 80.0 * a.sin() * b.sin(), 80.0 * a.cos())
        };
        let points: Vec<Point> = (0..=rings).flat_map(|i| (0..sectors).map(move |j| point(i, j))).collect();
        let at = |i: u32, j: u32| i * sectors + j % sectors;
        let quads = (1..rings - 1).flat_map(|i| (0..sectors).map(move |j| (i, j)));
        let all: Vec<[u32; 3]> = quads
            .flat_map(|(i, j)| [[at(i, j), at(i + 1, j), at(i + 1, j + 1)], [at(i, j), at(i + 1, j + 1), at(i, j + 1)]])
            .collect();
        let check = |triangles: Vec<[u32; 3]>| {
            let mesh = TriMesh::new(points.clone(), triangles).unwrap();
            Defects::of(&mesh).check()
        };
        assert!(check(all.clone()).is_ok());
        assert!(check(all[..all.len() / 2].to_vec()).is_ok(), "half a ball");
        let holey = all.iter().enumerate().filter(|(t, _)| t % 3 != 0).map(|(_, t)| *t).collect();
        assert!(check(holey).is_err());
    }

    #[test]
    fn a_closed_surface_has_no_rim_even_when_no_vertex_is_shared() {
        let (p, t) = tetrahedron();
        let soup: Vec<Point> = t.iter().flatten().map(|&v| p[v as usize]).collect();
        let triangles = (0..4).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        assert!(Defects::of(&TriMesh::new(soup, triangles).unwrap()).rim.is_empty());
    }

    #[test]
    fn a_missing_a_doubled_and_a_flipped_triangle_are_told_apart() {
        let (p, t) = tetrahedron();
        let open = Defects::of(&TriMesh::new(p.clone(), t[..3].to_vec()).unwrap());
        assert_eq!((open.rim.len(), open.n_edges), (3, 6));
        let mut doubled = t.clone();
        doubled.push([2, 3, 1]);
        let doubled = Defects::of(&TriMesh::new(p.clone(), doubled).unwrap());
        assert_eq!((doubled.duplicates, doubled.cancelled, doubled.rim.len()), (1, 0, 0));
        let mut paired = t.clone();
        paired.push([1, 3, 2]);
        let paired = Defects::of(&TriMesh::new(p.clone(), paired).unwrap());
        assert_eq!((paired.duplicates, paired.cancelled, paired.rim.len()), (0, 2, 3));
        let mut flat = t;
        flat.push([0, 1, 1]);
        let flat = Defects::of(&TriMesh::new(p, flat).unwrap());
        assert_eq!((flat.without_area, flat.rim.len()), (1, 0));
    }

    #[test]
    fn a_small_hole_is_a_fact_and_a_large_one_needs_a_look() {
        // A double cone over 400 points: 1200 edges.
        let n = 400u32;
        let mut positions: Vec<Point> =
            (0..n).map(|i| Point::new(f64::from(i).cos(), f64::from(i).sin(), 0.0)).collect();
        positions.extend([Point::new(0.0, 0.0, 1.0), Point::new(0.0, 0.0, -1.0)]);
        let mut cone: Vec<[u32; 3]> = (0..n).flat_map(|i| [[i, (i + 1) % n, n], [(i + 1) % n, i, n + 1]]).collect();
        let severity = |triangles: Vec<[u32; 3]>| {
            let warnings = Defects::of(&TriMesh::new(positions.clone(), triangles).unwrap()).warnings();
            warnings.iter().find(|w| w.code == "open-surface").map(|w| w.severity)
        };
        assert_eq!(severity(cone.clone()), None);
        cone.pop();
        assert_eq!(severity(cone.clone()), Some(Severity::Info));
        // The upper half alone.
        assert_eq!(severity(cone.into_iter().step_by(2).collect()), Some(Severity::Check));
    }
}
