use super::exact::{ExactDistance, is_inside};
use crate::geometry::Point;

/// How far the winding number must be from one half to be carried on to neighbours: several times its own error.
const CLEAR: f64 = 0.05;

/// A box of nodes with their unsigned distances, x fastest.
pub(super) struct Nodes<'a> {
    pub(super) dims: [usize; 3],
    pub(super) origin: Point,
    pub(super) spacing: f64,
    /// Unsigned distances, mm.
    pub(super) distances: &'a [f64],
}

impl Nodes<'_> {
    fn position(&self, index: usize) -> Point {
        let [nx, ny, _] = self.dims;
        let (i, j, k) = (index % nx, index / nx % ny, index / (nx * ny));
        self.origin + crate::geometry::Vector::new(i as f64, j as f64, k as f64) * self.spacing
    }
}

/// Signs of [`Nodes`].
#[derive(Debug, Clone)]
pub(super) struct Signs {
    pub(super) inside: Vec<bool>,
    pub(super) n_inside: usize,
    /// Nodes inside with a negative winding number: the normals there point inwards.
    pub(super) n_inverted: usize,
}

/// Finds which nodes are inside with few winding numbers.
///
/// Between neighbours whose unsigned distances add up to more than their spacing there is no surface, and off the surface
/// the winding number changes only by the field of its rim: by at most `slope` a mm, 0 for a closed surface. So one winding
/// number serves all nodes reached from its own through such pairs, as far as the path's length times `slope` leaves it clear.
pub(super) fn signs(nodes: &Nodes, exact: &ExactDistance, slope: f64) -> Signs {
    let n = nodes.distances.len();
    let [nx, ny, nz] = nodes.dims;
    let mut order: Vec<u32> = (0..n as u32).collect();
    // From far to near: far nodes reach most.
    order
        .sort_unstable_by(|&i, &j| nodes.distances[j as usize].total_cmp(&nodes.distances[i as usize]).then(i.cmp(&j)));
    let mut result = Signs { inside: vec![false; n], n_inside: 0, n_inverted: 0 };
    let mut done = vec![false; n];
    let mut front: Vec<u32> = Vec::new();
    let mut next: Vec<u32> = Vec::new();
    for seed in order {
        if done[seed as usize] {
            continue;
        }
        let winding = exact.winding_number(&nodes.position(seed as usize));
        let inside = is_inside(winding);
        let clearance = (winding.abs() - 0.5).abs() - CLEAR;
        done[seed as usize] = true;
        front.clear();
        front.push(seed);
        let mut reached = 0;
        let mut path = 0.0;
        while !front.is_empty() {
            path += nodes.spacing;
            let goes_on = clearance >= slope * path;
            next.clear();
            for &at in &front {
                let at = at as usize;
                result.inside[at] = inside;
                reached += 1;
                if !goes_on {
                    continue;
                }
                let mut visit = |to: usize| {
                    if !done[to] && nodes.distances[at] + nodes.distances[to] > nodes.spacing * (1.0 + 1e-9) {
                        done[to] = true;
                        next.push(to as u32);
                    }
                };
                let (i, j, k) = (at % nx, at / nx % ny, at / (nx * ny));
                if i > 0 {
                    visit(at - 1);
                }
                if i + 1 < nx {
                    visit(at + 1);
                }
                if j > 0 {
                    visit(at - nx);
                }
                if j + 1 < ny {
                    visit(at + nx);
                }
                if k > 0 {
                    visit(at - nx * ny);
                }
                if k + 1 < nz {
                    visit(at + nx * ny);
                }
            }
            std::mem::swap(&mut front, &mut next);
        }
        if inside {
            result.n_inside += reached;
            if winding < 0.0 {
                result.n_inverted += reached;
            }
        }
    }
    result
}

/// Bound on the change of the winding number a mm within `radius` of `center`, away from the surface.
///
/// The winding number is the potential of a current around the rim (Biot and Savart): its gradient is at most
/// 1/4π Σ length / distance². Infinite when the rim comes within `radius`.
pub(super) fn slope(rim: &[(Point, Point)], center: &Point, radius: f64) -> f64 {
    // Beyond this no neighbour could take over a sign, so the rest of the sum does not matter.
    const HOPELESS: f64 = 1e3;
    let mut sum = 0.0;
    for (a, b) in rim {
        let length = (b - a).norm();
        let middle = nalgebra::center(a, b);
        let distance = (middle - center).norm() - 0.5 * length - radius;
        if distance <= 0.0 {
            return f64::INFINITY;
        }
        sum += length / (distance * distance);
        if sum > HOPELESS {
            return f64::INFINITY;
        }
    }
    sum / (4.0 * std::f64::consts::PI)
}

/// Counts over all nodes whose sign was found.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Tally {
    n_inside: usize,
    n_inverted: usize,
}

impl Tally {
    pub(super) fn add(&mut self, signs: &Signs) {
        self.n_inside += signs.n_inside;
        self.n_inverted += signs.n_inverted;
    }

    pub(super) fn with(self, other: &Self) -> Self {
        Self { n_inside: self.n_inside + other.n_inside, n_inverted: self.n_inverted + other.n_inverted }
    }

    pub(super) fn warnings(&self) -> Option<String> {
        if self.n_inside == 0 {
            return Some(
                "the surface encloses nothing at this spacing: the field is the distance without sign".to_owned(),
            );
        }
        let share = self.n_inverted as f64 / self.n_inside as f64;
        if share > 0.99 {
            Some(
                "the surface is inside out (its normals point inwards): taken as the boundary of the same solid"
                    .to_owned(),
            )
        } else if self.n_inverted > 0 {
            Some(format!("normals point inwards around {:.2} % of the inside: taken as inside", 100.0 * share))
        } else {
            None
        }
    }
}
