//! Springs between single nodes and bone or rest: tissue that glides on bone, and tissue beyond the mesh.
//!
//! A *gliding* node is held at its distance from one body in both directions, as mucosa is held to teeth and gum by saliva and
//! suction, and moves freely along its surface. With the change of distance `g`, multiplier `p` and stiffness `k` its energy per
//! area is `((p - k g)² - p²) / (2 k)`, that of [`contact`](super::contact) without its one-sidedness. A node that has been
//! pulled off keeps the one-sided energy.
//! A *hold* draws a node towards the place where it would be if it were tied, by a spring that is equally stiff in all
//! directions. A share of hold blends gliding into being tied; on a node that no bone moves it is an elastic foundation.

mod points;
mod smooth;

use points::HeldNormal;
pub(super) use points::{SpringPoint, points};
use smooth::Smooth;

use super::assembly::{Curvature, Pattern};
use super::dofs::Dofs;
use super::error::SolveError;
use super::flags::flags;
use super::settings::ContactBody;
use super::tuning::{BEND_SHARE, RETRACTIONS, SPRINGS_PER_TASK};
use nalgebra::Matrix3;
use prosopon_geometry::{Implicit, Motion, Point, Vector};
use rayon::prelude::*;
use std::sync::Arc;

/// All springs of one tissue.
pub(super) struct Springs<'a> {
    points: Arc<Vec<SpringPoint>>,
    bodies: Vec<ContactBody<'a>>,
    /// Stiffness of the normal part, MPa/mm.
    stiffness: f64,
    memory: SpringMemory,
}

/// What the springs remember along a path.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct SpringMemory {
    /// Multiplier of each point, MPa.
    pub(super) multipliers: Vec<f64>,
    /// Whether each point has been pulled off.
    pub(super) released: Vec<bool>,
}

/// Normal part of one spring at one state.
#[derive(Debug, Clone, Copy)]
struct Normal {
    /// Change of the distance since rest, mm.
    gap: f64,
    /// Gradient of the distance.
    normal: Vector,
    /// MPa; negative where the body pulls.
    pressure: f64,
}

/// Second derivatives of one spring's energy, N/mm.
#[derive(Debug, Clone, Copy)]
pub(super) struct SpringStiffness {
    /// Part without the body's curvature, positive semi-definite.
    stiff: Matrix3<f64>,
    /// Part from the body's curvature.
    bend: Matrix3<f64>,
}

/// The springs' share of a stiffness matrix: a block on the diagonal for each point, N/mm.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct SpringBlocks(pub(super) Vec<Matrix3<f64>>);

impl std::fmt::Debug for Springs<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Springs").field("points", &self.points.len()).finish_non_exhaustive()
    }
}

impl<'a> Springs<'a> {
    /// Springs at rest; `stiffness` in MPa/mm.
    pub(super) fn new(
        points: Arc<Vec<SpringPoint>>,
        bodies: Vec<ContactBody<'a>>,
        stiffness: f64,
    ) -> Result<Self, SolveError> {
        let missing = points.iter().find(|p| p.body.is_some_and(|body| bodies.get(body).is_none()));
        if missing.is_some() {
            return Err(SolveError::Problem { detail: "the bodies differ from those of the preparation".to_owned() });
        }
        let memory = SpringMemory { multipliers: vec![0.0; points.len()], released: vec![false; points.len()] };
        Ok(Self { points, bodies, stiffness, memory })
    }

    pub(super) fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// Stiffness of the normal part, MPa/mm.
    pub(super) fn stiffness(&self) -> f64 {
        self.stiffness
    }

    /// Multiplies the stiffness of the normal part by `factor`.
    pub(super) fn stiffen(&mut self, factor: f64) {
        self.stiffness *= factor;
    }

    /// Restores stiffness (MPa/mm) and memory; `None` when they are of other springs.
    pub(super) fn restore(&mut self, stiffness: f64, memory: SpringMemory) -> Option<()> {
        self.set_memory(memory)?;
        self.stiffness = stiffness;
        Some(())
    }

    pub(super) fn memory(&self) -> &SpringMemory {
        &self.memory
    }

    /// Restores a memory of these springs; `None` when it is of others.
    pub(super) fn set_memory(&mut self, memory: SpringMemory) -> Option<()> {
        let n = self.points.len();
        let fits = memory.multipliers.len() == n && memory.released.len() == n;
        fits.then(|| self.memory = memory)
    }

    fn motion(&self, point: &SpringPoint, motions: &[Motion]) -> Motion {
        point.body.and_then(|body| motions.get(body)).copied().unwrap_or_else(Motion::identity)
    }

    /// Normal part of a point at `at`; `None` for a point without one, or pulled off and not touching.
    fn normal(&self, index: usize, at: &Point, motion: &Motion) -> Option<Normal> {
        let p = &self.points[index];
        let held = p.normal?;
        let body = &self.bodies[p.body?];
        let solid = Smooth { solid: body.solid, radius_mm: held.smooth_mm };
        let (value, gradient) = solid.value_gradient(&(motion.inverse_transform_point(at) + held.shift));
        let gap = value - held.rest_mm;
        let pressure = self.memory.multipliers[index] - self.stiffness * gap;
        let acts = pressure > 0.0 || !self.memory.released[index];
        acts.then(|| Normal { gap, normal: motion.rotation * gradient, pressure })
    }

    /// Evaluates `f` at every point, in the order of points.
    fn each<T: Send>(
        &self,
        x: &[Vector],
        motions: &[Motion],
        f: impl Fn(usize, &SpringPoint, Point, Motion) -> T + Sync,
    ) -> Vec<T> {
        let of =
            |(index, p): (usize, &SpringPoint)| f(index, p, Point::from(x[p.node as usize]), self.motion(p, motions));
        self.points.par_iter().enumerate().with_min_len(SPRINGS_PER_TASK).map(of).collect()
    }

    /// Energy, mJ.
    pub(super) fn energy(&self, x: &[Vector], motions: &[Motion]) -> f64 {
        let energies = self.each(x, motions, |index, p, at, motion| {
            let multiplier = self.memory.multipliers[index];
            let squared = self.normal(index, &at, &motion).map_or(0.0, |n| n.pressure * n.pressure);
            let area = p.normal.map_or(0.0, |held| held.area_mm2);
            let off = at - motion * p.rest;
            area * (squared - multiplier * multiplier) / (2.0 * self.stiffness) + 0.5 * p.hold * off.norm_squared()
        });
        energies.into_iter().sum()
    }

    /// Gradient of the energy by the node of each point, N.
    pub(super) fn gradients(&self, x: &[Vector], motions: &[Motion]) -> Vec<Vector> {
        self.each(x, motions, |index, p, at, motion| {
            let area = p.normal.map_or(0.0, |held| held.area_mm2);
            let pushed =
                self.normal(index, &at, &motion).map_or_else(Vector::zeros, |n| n.normal * (n.pressure * area));
            (at - motion * p.rest) * p.hold - pushed
        })
    }

    /// Adds [`Springs::gradients`] to those by all nodes.
    pub(super) fn add(&self, gradients: &[Vector], forces: &mut [Vector]) {
        for (p, gradient) in self.points.iter().zip(gradients) {
            forces[p.node as usize] += gradient;
        }
    }

    /// Second derivatives of the energy.
    pub(super) fn stiffness_at(&self, x: &[Vector], motions: &[Motion]) -> Vec<SpringStiffness> {
        self.each(x, motions, |index, p, at, motion| {
            let hold = Matrix3::identity() * p.hold;
            let (Some(found), Some(held)) = (self.normal(index, &at, &motion), p.normal) else {
                return SpringStiffness { stiff: hold, bend: Matrix3::zeros() };
            };
            let stiff = found.normal * found.normal.transpose() * (self.stiffness * held.area_mm2);
            let bend = self.curvature(index, &held, &at, &motion) * (-found.pressure * held.area_mm2);
            SpringStiffness { stiff: hold + stiff, bend }
        })
    }

    /// Second derivatives of a point's distance, 1/mm.
    fn curvature(&self, index: usize, held: &HeldNormal, at: &Point, motion: &Motion) -> Matrix3<f64> {
        let Some(body) = self.points[index].body else { return Matrix3::zeros() };
        let solid = Smooth { solid: self.bodies[body].solid, radius_mm: held.smooth_mm };
        let local = solid.hessian(&(motion.inverse_transform_point(at) + held.shift));
        let r = motion.rotation.to_rotation_matrix();
        r.matrix() * local * r.matrix().transpose()
    }

    /// Moves gliding nodes with their bodies between two sets of motions, as the start of a prediction.
    pub(super) fn carry(&self, from: &[Motion], to: &[Motion], dofs: &Dofs, x: &mut [Vector]) {
        for p in self.points.iter().filter(|p| dofs.axes_of(p.node as usize) == 0) {
            if dofs.unknown(p.node).is_some() {
                let local = self.motion(p, from).inverse_transform_point(&Point::from(x[p.node as usize]));
                x[p.node as usize] = (self.motion(p, to) * local).coords;
            }
        }
    }

    /// Moves gliding nodes of the state `x`, which was reached from `start` on straight lines, along their normals until each
    /// distance is the one that a flat surface would have given.
    ///
    /// On straight lines a node leaves a curved surface by the square of its way, and the stiff normal part would shorten every
    /// step of the line search.
    pub(super) fn retract(&self, start: &[Vector], motions: &[Motion], dofs: &Dofs, x: &mut [Vector]) {
        let places = self.each(x, motions, |index, p, at, motion| {
            let held = dofs.unknown(p.node).is_some() && dofs.axes_of(p.node as usize) == 0;
            if !held || self.memory.released[index] {
                return None;
            }
            let begin = Point::from(start[p.node as usize]);
            let before = self.normal(index, &begin, &motion)?;
            let goal = before.gap + before.normal.dot(&(at - begin));
            let mut place = at;
            for _ in 0..RETRACTIONS {
                let now = self.normal(index, &place, &motion)?;
                let steep = now.normal.norm_squared();
                if steep < 0.25 {
                    return None;
                }
                place -= now.normal * ((now.gap - goal) / steep);
            }
            // Beyond a rim the distance may have no such place nearby.
            ((place - at).norm() <= (at - begin).norm()).then_some(place)
        });
        for (p, place) in self.points.iter().zip(places) {
            if let Some(place) = place {
                x[p.node as usize] = place.coords;
            }
        }
    }

    /// Largest change of distance of a gliding node that has not been pulled off, mm.
    pub(super) fn largest_gap_mm(&self, x: &[Vector], motions: &[Motion]) -> f64 {
        let gaps = self.each(x, motions, |index, _, at, motion| {
            let gap = self.normal(index, &at, &motion).map_or(0.0, |n| n.gap);
            if self.memory.released[index] { -gap } else { gap.abs() }
        });
        gaps.into_iter().fold(0.0, f64::max)
    }

    /// Augmented Lagrangian update: the current pressures become the multipliers.
    pub(super) fn augment(&mut self, x: &[Vector], motions: &[Motion]) {
        let pressures =
            self.each(x, motions, |index, _, at, motion| self.normal(index, &at, &motion).map_or(0.0, |n| n.pressure));
        self.memory.multipliers = pressures;
    }

    /// Lets go of gliding nodes on which bone pulls by more than `limit_mpa`. Returns their number.
    pub(super) fn pull_off(&mut self, x: &[Vector], motions: &[Motion], limit_mpa: f64) -> usize {
        let pulled = self.each(x, motions, |index, _, at, motion| {
            let pressure = self.normal(index, &at, &motion).map_or(0.0, |n| n.pressure);
            !self.memory.released[index] && pressure < -limit_mpa
        });
        for (index, _) in pulled.iter().enumerate().filter(|(_, pulled)| **pulled) {
            self.memory.released[index] = true;
            self.memory.multipliers[index] = 0.0;
        }
        pulled.into_iter().filter(|pulled| *pulled).count()
    }

    /// Marks the springs of another solver over the same mesh as pulled off; with other springs none is marked.
    pub(super) fn set_pulled_off(&mut self, springs: &[u64]) {
        if let Some(released) = flags(springs, self.points.len()) {
            self.memory.released = released;
        }
    }

    /// Number of gliding nodes that have been pulled off.
    pub(super) fn pulled_off(&self) -> usize {
        self.memory.released.iter().filter(|released| **released).count()
    }

    /// Force of each segment on the tissue, N; springs to rest are not included.
    pub(super) fn forces_by_segment(&self, x: &[Vector], motions: &[Motion]) -> Vec<(u32, Vector)> {
        let mut forces: Vec<(u32, Vector)> = self.bodies.iter().map(|b| (b.segment, Vector::zeros())).collect();
        for (p, gradient) in self.points.iter().zip(self.gradients(x, motions)) {
            if let Some((_, force)) = p.body.and_then(|body| forces.get_mut(body)) {
                *force -= gradient;
            }
        }
        forces
    }
}

impl SpringBlocks {
    /// As plain numbers, row-major.
    pub(super) fn numbers(&self) -> Vec<[f64; 9]> {
        self.0.iter().map(|m| m.transpose().as_slice().try_into().unwrap_or_default()).collect()
    }

    /// The blocks of [`SpringBlocks::numbers`].
    pub(super) fn of_numbers(rows: &[[f64; 9]]) -> Self {
        Self(rows.iter().map(|rows| Matrix3::from_row_slice(rows)).collect())
    }
}

/// Stiffness of springs, and how much of the bodies' curvature it includes.
pub(super) enum Bend {
    /// All of it: the exact second derivatives.
    #[cfg(test)]
    Whole(Vec<SpringStiffness>),
    /// All that stiffens a node, and as much of what softens it as leaves most of the elements' stiffness: the matrix then mostly
    /// stays positive definite. Without a part that stiffens, nodes would swing about their place.
    Limited(Vec<SpringStiffness>),
    /// What stiffens a node only: with projected elements the matrix is positive definite.
    Stiffening(Vec<SpringStiffness>),
    /// Blocks that were computed before.
    Known(SpringBlocks),
}

/// Kinds of tangent, from the most exact to the one that is always positive definite.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum TangentKind {
    /// Exact second derivatives of the elements; springs soften them only so far ([`Bend::Limited`]).
    Exact,
    /// Projected elements, springs as above.
    Projected,
    /// Projected elements and springs that only stiffen.
    PositiveDefinite,
}

impl TangentKind {
    /// The kind to try where this one is not positive definite; the last two differ only where there are springs.
    pub(super) fn safer(self, has_springs: bool) -> Option<Self> {
        match self {
            Self::Exact => Some(Self::Projected),
            Self::Projected => has_springs.then_some(Self::PositiveDefinite),
            Self::PositiveDefinite => None,
        }
    }

    pub(super) fn elements(self) -> Curvature {
        match self {
            Self::Exact => Curvature::Exact,
            Self::Projected | Self::PositiveDefinite => Curvature::Projected,
        }
    }

    pub(super) fn springs(self, stiffness: Vec<SpringStiffness>) -> Bend {
        match self {
            Self::Exact | Self::Projected => Bend::Limited(stiffness),
            Self::PositiveDefinite => Bend::Stiffening(stiffness),
        }
    }
}

/// A symmetric matrix without eigenvalues below `least`.
fn limited_below(matrix: Matrix3<f64>, least: f64) -> Matrix3<f64> {
    let mut parts = matrix.symmetric_eigen();
    parts.eigenvalues.apply(|e| *e = e.max(least));
    parts.recompose()
}

/// Adds springs to the diagonal of the elements' stiffness `values`; returns the blocks that were added.
pub(super) fn add_blocks(
    dofs: &Dofs,
    pattern: &Pattern,
    points: &[SpringPoint],
    springs: Bend,
    values: &mut [f64],
) -> SpringBlocks {
    let limited = |(p, s): (&SpringPoint, &SpringStiffness)| {
        let least = dofs
            .unknown(p.node)
            .map_or(0.0, |unknown| pattern.diagonal(unknown as usize, values).symmetric_eigenvalues().min().max(0.0));
        s.stiff + limited_below(s.bend, -BEND_SHARE * least)
    };
    let blocks = match springs {
        #[cfg(test)]
        Bend::Whole(springs) => SpringBlocks(springs.iter().map(|s| s.stiff + s.bend).collect()),
        Bend::Limited(springs) => SpringBlocks(points.iter().zip(&springs).map(limited).collect()),
        Bend::Stiffening(springs) => {
            SpringBlocks(springs.iter().map(|s| s.stiff + limited_below(s.bend, 0.0)).collect())
        }
        Bend::Known(blocks) => blocks,
    };
    if blocks.0.is_empty() {
        return blocks;
    }
    for (p, block) in points.iter().zip(&blocks.0) {
        if let Some(unknown) = dofs.unknown(p.node) {
            pattern.add(unknown, unknown, block, values);
        }
    }
    pattern.hold(dofs.partly_held(), values);
    blocks
}

#[cfg(test)]
mod tests {
    use super::*;

    /// On a saddle bone stiffens a pulled node in one direction and softens it in the other. Scaled as a whole, the matrix would
    /// lose the first with the second, and the node would swing about its place (`patient b, rami` of `bench operations`).
    #[test]
    fn a_limit_on_what_softens_a_node_keeps_what_stiffens_it() {
        let turn = nalgebra::Rotation3::from_euler_angles(0.3, -1.1, 2.0);
        let at = |values: [f64; 3]| {
            turn.matrix() * Matrix3::from_diagonal(&Vector::from(values)) * turn.matrix().transpose()
        };
        let found = limited_below(at([5.0, -100.0, -0.5]), -2.0);
        assert!((found - at([5.0, -2.0, -0.5])).norm() < 1e-12, "{found}");
    }

    /// Projected elements may have no stiffness left to give: Le Fort III of `bench operations` then had no factor.
    #[test]
    fn the_last_kind_of_tangent_softens_nothing() {
        let bend = Matrix3::from_diagonal(&Vector::new(3.0, -2.0, 0.5));
        let kinds: Vec<_> = std::iter::successors(Some(TangentKind::Exact), |kind| kind.safer(true)).collect();
        assert_eq!(kinds.len(), 3);
        assert_eq!(TangentKind::Projected.safer(false), None);
        let last = kinds[2];
        assert_eq!(last.elements(), Curvature::Projected);
        let springs = vec![SpringStiffness { stiff: Matrix3::zeros(), bend }];
        assert!(matches!(last.springs(springs), Bend::Stiffening(kept) if kept.len() == 1));
        assert!((limited_below(bend, 0.0) - Matrix3::from_diagonal(&Vector::new(3.0, 0.0, 0.5))).norm() < 1e-12);
    }
}
