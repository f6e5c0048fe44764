use super::tuning::{CONVERGED_MM, MAX_OFF_PRISMS_SHARE, MAX_SWEEPS};
use prosopon_geometry::{Aabb, TriMesh, Vector, Warning};
use prosopon_tissue::fem::Solver;
use prosopon_tissue::mesh::Embedding;

/// Moves the user's skin with the prisms.
///
/// Vertices without a prism, at folds that could not be meshed and beyond the region, take the mean displacement of their
/// neighbours. Far from the region that is zero, because the prisms at its edge are fixed.
pub(super) struct SkinMover<'a> {
    embedding: &'a Embedding,
    /// Vertices without a prism, ascending, with their neighbours.
    loose: Vec<(usize, Vec<u32>)>,
}

impl<'a> SkinMover<'a> {
    pub(super) fn new(skin: &TriMesh, embedding: &'a Embedding) -> Self {
        let mut neighbours = vec![Vec::new(); skin.positions().len()];
        for t in skin.triangles() {
            for i in 0..3 {
                let (a, b) = (t[i], t[(i + 1) % 3]);
                for (from, to) in [(a, b), (b, a)] {
                    if embedding.anchors[from as usize].is_none() {
                        neighbours[from as usize].push(to);
                    }
                }
            }
        }
        let loose = neighbours.into_iter().enumerate().filter(|(_, n)| !n.is_empty()).map(|(vertex, mut near)| {
            near.sort_unstable();
            near.dedup();
            (vertex, near)
        });
        Self { embedding, loose: loose.collect() }
    }

    /// Warning with the number of skin vertices inside `region` that have no prism.
    pub(super) fn warning(&self, skin: &TriMesh, region: &Aabb) -> Option<Warning> {
        let loose = self.loose.iter().filter(|(v, _)| region.contains(&skin.positions()[*v])).count();
        let all = skin.positions().iter().filter(|p| region.contains(p)).count();
        let message = format!(
            "{loose} of {all} vertices of the skin in the region lie on no prism (folds, nostrils, the back); neighbours move \
             them"
        );
        if loose == 0 {
            None
        } else if (loose as f64) < MAX_OFF_PRISMS_SHARE * all as f64 {
            Some(Warning::info("skin-off-prisms", message))
        } else {
            Some(Warning::check("skin-off-prisms", message).act("Use a finer mesh, or a larger region."))
        }
    }

    /// Displacement of every vertex of the skin, mm.
    pub(super) fn displacements(&self, solver: &Solver<'_>) -> Vec<Vector> {
        let anchors = self.embedding.anchors.iter();
        let mut u: Vec<Vector> =
            anchors.map(|a| a.map_or_else(Vector::zeros, |(prism, l)| solver.outer_displacement(prism, l))).collect();
        self.fill(&mut u);
        u
    }

    /// Gives the vertices without a prism the mean of their neighbours.
    fn fill(&self, u: &mut [Vector]) {
        for sweep in 0..MAX_SWEEPS {
            let mut largest = 0.0f64;
            for i in 0..self.loose.len() {
                let (vertex, near) = &self.loose[if sweep % 2 == 0 { i } else { self.loose.len() - 1 - i }];
                let mean = near.iter().map(|n| u[*n as usize]).sum::<Vector>() / near.len() as f64;
                largest = largest.max((mean - u[*vertex]).norm());
                u[*vertex] = mean;
            }
            if largest < CONVERGED_MM {
                break;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use prosopon_geometry::{Point, Severity};

    const SIDE: usize = 12;

    /// A square of equal triangles; vertices for which `loose` holds have no prism.
    fn square(loose: impl Fn(usize, usize) -> bool) -> (TriMesh, Embedding) {
        let node = |i: usize, j: usize| (i + SIDE * j) as u32;
        let places = (0..SIDE * SIDE).map(|n| (n % SIDE, n / SIDE));
        let positions = places.clone().map(|(i, j)| Point::new(i as f64, j as f64, 0.0)).collect();
        let cells = (0..SIDE - 1).flat_map(|j| (0..SIDE - 1).map(move |i| (i, j)));
        let triangles = cells.flat_map(|(i, j)| {
            let [a, b, c, d] = [node(i, j), node(i + 1, j), node(i + 1, j + 1), node(i, j + 1)];
            [[a, b, c], [a, c, d]]
        });
        let anchors = places.map(|(i, j)| (!loose(i, j)).then_some((0, [1.0, 0.0, 0.0]))).collect();
        (TriMesh::new(positions, triangles.collect()).unwrap(), Embedding { anchors })
    }

    /// On this lattice the mean of the neighbours is exact for linear fields; sweeps end with changes of 1e-4 mm, whose sum
    /// over the remaining ones stays below 1e-2 mm in a hole of this size.
    #[test]
    fn a_hole_takes_a_linear_displacement_from_around_it() {
        let hole = |i: usize, j: usize| (3..9).contains(&i) && (3..9).contains(&j);
        let (skin, embedding) = square(hole);
        let skin_mover = SkinMover::new(&skin, &embedding);
        let exact = |p: &Point| Vector::new(1.0 + 0.2 * p.x, -0.1 * p.y, 0.3 * p.x - 0.2 * p.y);
        let mut u: Vec<Vector> = (skin.positions().iter().zip(&embedding.anchors))
            .map(|(p, a)| if a.is_some() { exact(p) } else { Vector::zeros() })
            .collect();
        skin_mover.fill(&mut u);
        for (p, u) in skin.positions().iter().zip(&u) {
            assert!((u - exact(p)).norm() < 1e-2, "{p}: {u}");
        }
        assert!(skin_mover.warning(&skin, &skin.bounds()).is_some_and(|w| {
            (w.code, w.severity) == ("skin-off-prisms", Severity::Check) && w.message.starts_with("36 of 144 ")
        }));
        let (skin, embedding) = square(|i, j| (i, j) == (5, 5));
        let few = SkinMover::new(&skin, &embedding).warning(&skin, &skin.bounds());
        assert!(few.is_some_and(|w| w.severity == Severity::Info));
    }

    #[test]
    fn skin_beyond_an_edge_that_stays_does_not_move() {
        let (skin, embedding) = square(|i, _| i > 5);
        let skin_mover = SkinMover::new(&skin, &embedding);
        let mut u: Vec<Vector> = skin.positions().iter().map(|p| Vector::x() * (5.0 - p.x).max(0.0)).collect();
        skin_mover.fill(&mut u);
        assert!(skin.positions().iter().zip(&u).all(|(p, u)| p.x < 5.0 || u.norm() == 0.0));
    }
}
