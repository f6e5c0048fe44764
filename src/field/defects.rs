use super::rim::Rim;
use prosopon_geometry::{Point, TriMesh};
use rayon::prelude::*;

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
        let rim = Rim::new(&rim(&triangles, &counts), mesh.positions());
        Self { triangles, counts, distinct, rim, duplicates, cancelled, without_area }
    }

    /// One sentence for each kind of defect that is present.
    pub(super) fn warnings(&self) -> Vec<String> {
        let mut warnings = Vec::new();
        if !self.rim.is_empty() {
            warnings.push(format!(
                "the surface is open or inconsistently oriented along {} edges; inside is where the winding number is above 0.5",
                self.rim.len()
            ));
        }
        if self.duplicates > 0 {
            warnings.push(format!("{} triangles duplicate others; they do not affect the sign", self.duplicates));
        }
        if self.cancelled > 0 {
            warnings.push(format!(
                "{} triangles lie in pairs that face opposite ways; they affect the distance but not the sign",
                self.cancelled
            ));
        }
        if self.without_area > 0 {
            warnings
                .push(format!("{} triangles have no area; the distance uses their edges or points", self.without_area));
        }
        warnings
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

/// Edges run through more often in one direction, with the net count from first to second end.
fn rim(triangles: &[[u32; 3]], counts: &[bool]) -> Vec<([u32; 2], i32)> {
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
    edges
        .chunk_by(|a, b| (a.0, a.1) == (b.0, b.1))
        .map(|same| ([same[0].0, same[0].1], same.iter().map(|e| if e.2 { 1 } else { -1 }).sum()))
        .filter(|(_, times)| *times != 0)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tetrahedron() -> (Vec<Point>, Vec<[u32; 3]>) {
        let p = vec![Point::origin(), Point::new(1.0, 0.0, 0.0), Point::new(0.0, 1.0, 0.0), Point::new(0.0, 0.0, 1.0)];
        (p, vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
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
        assert_eq!(open.rim.len(), 3);
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
}
