//! Compliance of nodes under forces at nodes, computed from a factor: it adds contact to a factor without a new factorisation.

use super::dot::vector_dot;
use super::node_core::NodeCore;
use super::tuning::{COMPLIANCE_GROUP, POINT_NODES, TERMS_PER_NODE};
use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, Par};
use nalgebra::{Cholesky, DMatrix, DVector, Dyn, Matrix3};
use prosopon_geometry::Vector;
use prosopon_geometry::control::Control;
use std::ops::Range;

const NONE: u32 = u32::MAX;

/// Compliance of some nodes in the corner of a factor `L Lᵀ` (the unknowns eliminated last): `S = Gᵀ G` with `G = L⁻¹ E`, where
/// the columns of `E` are unit forces along the axes at the nodes.
#[derive(Debug)]
pub(super) struct Compliance {
    corner: Range<usize>,
    /// Index of each unknown node of the corner in the order of addition, from the corner's first node on.
    place: Vec<u32>,
    n_nodes: usize,
    /// Nodes that were added together.
    groups: Vec<Vec<u32>>,
    /// `G`: rows of the corner, three columns for each node.
    columns: Mat<f64>,
    /// `S`.
    gram: Mat<f64>,
}

impl Compliance {
    /// A compliance without nodes. `corner` is a range of unknowns.
    pub(super) fn new(corner: Range<usize>) -> Self {
        let nodes = corner.end / 3 - corner.start / 3;
        Self { corner, place: vec![NONE; nodes], n_nodes: 0, groups: Vec::new(), columns: Mat::new(), gram: Mat::new() }
    }

    /// Adds nodes. `solve(first, b)` applies `L⁻¹` to columns that are zero above row `first` of the corner and start at that
    /// row. `None` when a node lies outside the corner, or when `control` cancels.
    pub(super) fn add(
        &mut self,
        nodes: impl Iterator<Item = u32>,
        control: &Control,
        mut solve: impl FnMut(usize, Mat<f64>) -> Mat<f64>,
    ) -> Option<()> {
        let mut new: Vec<u32> = nodes.filter(|&node| self.place(node).is_none()).collect();
        new.sort_unstable();
        new.dedup();
        if new.iter().any(|&n| (3 * n as usize) < self.corner.start || 3 * n as usize + 2 >= self.corner.end) {
            return None;
        }
        let rows = self.corner.len();
        let old = 3 * self.n_nodes;
        let all = old + 3 * new.len();
        self.columns.resize_with(rows, all, |_, _| 0.0);
        self.gram.resize_with(all, all, |_, _| 0.0);
        for chunk in new.chunks(COMPLIANCE_GROUP) {
            if control.is_cancelled() {
                // Nodes of this call that were added stay unknown: their group is not complete.
                self.forget_after(old / 3);
                return None;
            }
            let first = 3 * chunk[0] as usize - self.corner.start;
            let row = |c: usize| 3 * chunk[c / 3] as usize + c % 3 - self.corner.start - first;
            let units = Mat::from_fn(rows - first, 3 * chunk.len(), |r, c| f64::from(u8::from(row(c) == r)));
            let solved = solve(first, units);
            let (from, to) = (3 * self.n_nodes, 3 * (self.n_nodes + chunk.len()));
            self.columns.subrows_mut(first, rows - first).subcols_mut(from, to - from).copy_from(&solved);
            let known = self.columns.subrows(first, rows - first).subcols(0, to);
            let mut cross = Mat::<f64>::zeros(to, to - from);
            matmul(cross.as_mut(), Accum::Replace, known.transpose(), solved.as_ref(), 1.0, Par::rayon(2));
            for c in from..to {
                for r in 0..to {
                    self.gram[(r, c)] = cross[(r, c - from)];
                    self.gram[(c, r)] = cross[(r, c - from)];
                }
            }
            for &node in chunk {
                self.place[node as usize - self.corner.start / 3] = self.n_nodes as u32;
                self.n_nodes += 1;
            }
        }
        if !new.is_empty() {
            self.groups.push(new);
        }
        Some(())
    }

    /// Forgets the nodes that were added after the first `n_nodes`.
    fn forget_after(&mut self, n_nodes: usize) {
        for place in &mut self.place {
            if *place != NONE && *place as usize >= n_nodes {
                *place = NONE;
            }
        }
        self.n_nodes = n_nodes;
        self.columns.resize_with(self.corner.len(), 3 * n_nodes, |_, _| 0.0);
        self.gram.resize_with(3 * n_nodes, 3 * n_nodes, |_, _| 0.0);
    }

    /// The nodes in the groups in which they were added: adding them again in these groups gives the same bits.
    pub(super) fn groups(&self) -> &[Vec<u32>] {
        &self.groups
    }

    /// Length of a vector of forces or displacements: three entries for each node.
    pub(super) fn len(&self) -> usize {
        3 * self.n_nodes
    }

    /// First entry of an unknown node in such vectors.
    pub(super) fn place(&self, node: u32) -> Option<usize> {
        let index = (node as usize).checked_sub(self.corner.start / 3)?;
        let place = *self.place.get(index)?;
        (place != NONE).then_some(3 * place as usize)
    }

    /// `S f`.
    pub(super) fn displacements(&self, f: &[f64]) -> Vec<f64> {
        let mut u = vec![0.0; self.len()];
        for (c, f) in f.iter().enumerate().filter(|(_, f)| **f != 0.0) {
            u.iter_mut().zip(self.gram.col_as_slice(c)).for_each(|(u, s)| *u += s * f);
        }
        u
    }

    /// Adds `G f` to the corner's unknowns.
    pub(super) fn add_forces(&self, f: &[f64], y: &mut [f64]) {
        for (c, f) in f.iter().enumerate().filter(|(_, f)| **f != 0.0) {
            y.iter_mut().zip(self.columns.col_as_slice(c)).for_each(|(y, g)| *y += g * f);
        }
    }

    /// 3x3 block of `S` at two offsets.
    fn block(&self, a: usize, b: usize) -> Matrix3<f64> {
        Matrix3::from_fn(|i, j| self.gram[(a + i, b + j)])
    }
}

/// A term `factor v vᵀ` of a matrix.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct RankOne {
    /// Indices of unknown nodes and the three entries of `v` at each.
    pub(super) nodes: Vec<(u32, Vector)>,
    /// Positive.
    pub(super) factor: f64,
}

/// Inner matrix of the Woodbury identity.
#[derive(Debug)]
enum Core {
    /// `(D⁻¹ + Vᵀ S V)⁻¹` with the terms' vectors `V` and factors `D`.
    Terms(Cholesky<f64, Dyn>),
    /// The same by nodes.
    Nodes(NodeCore),
}

/// Rank-one terms that a factor does not include, on nodes of its [`Compliance`] `S`.
#[derive(Debug)]
pub(super) struct LowRank {
    /// Offsets and entries, by term.
    terms: Vec<Vec<(usize, Vector)>>,
    core: Core,
}

impl LowRank {
    /// `None` when there are no terms, when a term acts on a node missing in `compliance`, when the factor is too coarse for
    /// the terms, or when `control` cancels.
    pub(super) fn new(terms: &[RankOne], compliance: &Compliance, control: &Control) -> Option<Self> {
        if terms.is_empty() {
            return None;
        }
        let placed = |t: &RankOne| t.nodes.iter().map(|(n, v)| Some((compliance.place(*n)?, *v))).collect();
        let placed: Vec<Vec<(usize, Vector)>> = terms.iter().map(placed).collect::<Option<_>>()?;
        if terms.len() > TERMS_PER_NODE * compliance.n_nodes && terms.iter().any(|t| t.nodes.len() > POINT_NODES) {
            let factors: Vec<f64> = terms.iter().map(|t| t.factor).collect();
            let core = NodeCore::new((&placed, &factors), |a, b| compliance.block(a, b))?;
            return Some(Self { terms: placed, core: Core::Nodes(core) });
        }
        let mut core = DMatrix::zeros(terms.len(), terms.len());
        for (c, term) in placed.iter().enumerate() {
            control.check().ok()?;
            for (place, entry) in term {
                for (r, other) in placed.iter().enumerate().skip(c) {
                    core[(r, c)] +=
                        other.iter().map(|(p, e)| e.dot(&(compliance.block(*p, *place) * entry))).sum::<f64>();
                }
            }
            core[(c, c)] += 1.0 / terms[c].factor;
        }
        Some(Self { terms: placed, core: Core::Terms(core.cholesky()?) })
    }

    /// Reaction of the terms at the nodes, whose displacement without the terms would be `u`.
    pub(super) fn reaction(&self, u: &[f64]) -> Vec<f64> {
        let along = |t: &Vec<(usize, Vector)>| -> f64 {
            t.iter().map(|(p, e)| e.x * u[*p] + e.y * u[p + 1] + e.z * u[p + 2]).sum()
        };
        let mut f = vec![0.0; u.len()];
        let core = match &self.core {
            Core::Terms(core) => core,
            Core::Nodes(core) => {
                core.add_reaction(u, &mut f);
                return f;
            }
        };
        let mut loads = DVector::from_iterator(self.terms.len(), self.terms.iter().map(along));
        core.solve_mut(&mut loads);
        for (term, load) in self.terms.iter().zip(loads.iter()) {
            for (place, entry) in term {
                for i in 0..3 {
                    f[place + i] -= load * entry[i];
                }
            }
        }
        f
    }

    /// Applies `(I + G V D Vᵀ Gᵀ)⁻¹` to the corner's unknowns: between the two triangular solves, it corrects the factor for the
    /// terms.
    pub(super) fn apply(&self, compliance: &Compliance, y: &mut [f64]) {
        let mut u = vec![0.0; compliance.len()];
        for place in self.terms.iter().flatten().map(|(p, _)| *p) {
            for c in place..place + 3 {
                if u[c] == 0.0 {
                    u[c] = vector_dot(compliance.columns.col_as_slice(c), y);
                }
            }
        }
        compliance.add_forces(&self.reaction(&u), y);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn by_nodes(placed: &[Vec<(usize, Vector)>], terms: &[RankOne], compliance: &Compliance) -> Core {
        let factors: Vec<f64> = terms.iter().map(|t| t.factor).collect();
        Core::Nodes(NodeCore::new((placed, &factors), |a, b| compliance.block(a, b)).unwrap())
    }

    /// With `L = 2 I` the matrix with the terms is `4 I + V D Vᵀ`.
    #[test]
    fn a_corrected_factor_is_the_inverse_of_the_matrix_with_the_terms() {
        let term = |nodes: Vec<(u32, Vector)>, factor| RankOne { nodes, factor };
        let terms = [
            term(vec![(1, Vector::new(1.0, 2.0, 0.0)), (2, Vector::new(0.0, -1.0, 0.5))], 7.0),
            term(vec![(2, Vector::new(0.3, 0.0, 1.0))], 100.0),
        ];
        let mut compliance = Compliance::new(3..9);
        let half = |_: usize, b: Mat<f64>| &b * faer::Scale(0.5);
        assert!(LowRank::new(&terms, &compliance, &Control::new()).is_none(), "no node is known yet");
        compliance.add([2].into_iter(), &Control::new(), half).unwrap();
        compliance.add([2, 1].into_iter(), &Control::new(), half).unwrap();
        let low_rank = LowRank::new(&terms, &compliance, &Control::new()).unwrap();
        let mut matrix = DMatrix::identity(6, 6) * 4.0;
        for t in &terms {
            let mut v = DVector::zeros(6);
            for (node, entry) in &t.nodes {
                v.fixed_rows_mut::<3>(3 * *node as usize - 3).copy_from(entry);
            }
            matrix += &v * v.transpose() * t.factor;
        }
        let as_nodes = LowRank { terms: low_rank.terms.clone(), core: by_nodes(&low_rank.terms, &terms, &compliance) };
        let moved = [0.3, -1.0, 2.0, 0.7, 0.1, -0.4];
        let reactions = low_rank.reaction(&moved).into_iter().zip(as_nodes.reaction(&moved));
        assert!(reactions.into_iter().all(|(a, b)| (a - b).abs() < 1e-12), "both cores give the same");
        let b = DVector::from_fn(6, |i, _| i as f64 - 2.2);
        let mut y: Vec<f64> = b.iter().map(|b| 0.5 * b).collect();
        low_rank.apply(&compliance, &mut y);
        let x = DVector::from_iterator(6, y.iter().map(|y| 0.5 * y));
        assert!((matrix * x - &b).norm() < 1e-12 * b.norm());
        assert!(compliance.add([0].into_iter(), &Control::new(), half).is_none(), "node 0 is outside of the corner");
        assert!(LowRank::new(&[], &compliance, &Control::new()).is_none());
    }

    /// A coupled corner, nodes added out of order: `S` is the inverse's part at the nodes.
    #[test]
    fn the_compliance_is_that_of_the_factor() {
        let lower = DMatrix::from_fn(9, 9, |r, c| if r < c { 0.0 } else { 1.0 / (1.0 + (r - c) as f64) });
        let mut compliance = Compliance::new(6..15);
        let mut solve = |first: usize, b: Mat<f64>| {
            let l = lower.view((first, first), (9 - first, 9 - first)).into_owned();
            let b = DMatrix::from_fn(b.nrows(), b.ncols(), |r, c| b[(r, c)]);
            let x = l.solve_lower_triangular(&b).unwrap();
            Mat::from_fn(x.nrows(), x.ncols(), |r, c| x[(r, c)])
        };
        compliance.add([4].into_iter(), &Control::new(), &mut solve).unwrap();
        let stopped = Control::new();
        stopped.cancel();
        assert!(compliance.add([2].into_iter(), &stopped, &mut solve).is_none());
        compliance.add([2].into_iter(), &Control::new(), &mut solve).unwrap();
        let inverse = (&lower * lower.transpose()).try_inverse().unwrap();
        let force = [1.0, -2.0, 0.5, 0.3, 0.0, 4.0];
        let found = compliance.displacements(&force);
        let full = DVector::from_fn(9, |i, _| match i {
            0..3 => force[3 + i],
            6.. => force[i - 6],
            _ => 0.0,
        });
        let expected = inverse * full;
        for i in 0..3 {
            assert!((found[i] - expected[6 + i]).abs() < 1e-12 && (found[3 + i] - expected[i]).abs() < 1e-12);
        }
    }
}
