//! The Hessian of the contact energy.

use super::Contact;
use super::pair::{ContactPair, CurvatureTerm, Target};
use super::turning::Turning;
use crate::fem::axes::axes_in;
use crate::fem::compliance::{Compliance, RankOne};
use crate::fem::dofs::Dofs;
use crate::fem::tuning::{CONTACT_POINTS_PER_TASK, STIFFEST_EDGE};
use nalgebra::Matrix3;
use prosopon_geometry::{Motion, Vector};
use rayon::prelude::*;

/// State at which the curvature of the bodies is evaluated.
#[derive(Debug, Clone, Copy)]
pub(in crate::fem) struct Curved<'a> {
    /// Values of the generalised nodes.
    pub(in crate::fem) x: &'a [Vector],
    /// Motion of each body.
    pub(in crate::fem) motions: &'a [Motion],
    /// Share of the curvature that is included: 1 gives the exact Hessian.
    pub(in crate::fem) share: f64,
}

/// A block of a matrix at offsets into the forces of a [`Compliance`].
#[derive(Debug, Clone, Copy)]
pub(in crate::fem) struct PlacedBlock {
    pub(in crate::fem) row: usize,
    pub(in crate::fem) column: usize,
    pub(in crate::fem) block: Matrix3<f64>,
}

impl Contact<'_> {
    /// Passes the blocks of the energy's Hessian to `add`: row and column among the unknowns (`row >= column`), and the block.
    /// Gauss-Newton when `curved` is `None`; otherwise with the curvature of the bodies.
    pub(in crate::fem) fn hessian(
        &self,
        contacts: &[ContactPair],
        curved: Option<Curved<'_>>,
        dofs: &Dofs,
        mut add: impl FnMut(u32, u32, &Matrix3<f64>),
    ) {
        for t in contacts {
            let gauss_newton = t.gauss_newton();
            let curvature = curved.map(|curved| (self.curvature_term(t, curved.x, curved.motions), curved.share));
            let block = |a: (u32, f64), b: (u32, f64)| match &curvature {
                None => gauss_newton * (a.1 * b.1),
                Some((CurvatureTerm::OfPoint(of_point), share)) => (gauss_newton - of_point * *share) * (a.1 * b.1),
                Some((turning, share)) => gauss_newton * (a.1 * b.1) - turning.block(a, b) * *share,
            };
            for a in t.terms.iter() {
                for b in t.terms.iter() {
                    if let (Some(row), Some(column)) = (dofs.unknown(a.0), dofs.unknown(b.0))
                        && row >= column
                    {
                        add(row, column, &block(a, b));
                    }
                }
            }
        }
    }

    /// Curvature term of one contact, subtracted from its Hessian.
    fn curvature_term(&self, contact: &ContactPair, x: &[Vector], motions: &[Motion]) -> CurvatureTerm {
        let force = contact.linearised_pressure.max(0.0) * contact.area;
        match contact.target {
            Target::Body(body) => {
                let p = &self.points[contact.index.point];
                let motion = &motions[body];
                let shift = self.overlap[self.slot(contact.index)].shift;
                let curvature = self.bodies[body].solid.hessian(&(motion.inverse_transform_point(&p.at(x)) + shift));
                let r = motion.rotation.to_rotation_matrix();
                CurvatureTerm::OfPoint(r.matrix() * curvature * r.matrix().transpose() * force)
            }
            Target::Tissue { nodes, n_nodes } => {
                let gap = contact.gap - self.facing.rest_mm(contact.index.point - self.points.len());
                let stiffest = STIFFEST_EDGE * contact.stiffness / contact.linearised_pressure.max(f64::MIN_POSITIVE);
                let at = |node: u32| x[node as usize];
                CurvatureTerm::Turning(Turning::new((nodes, n_nodes), at, contact.normal, (gap, force), stiffest))
            }
        }
    }

    /// Curvature terms of the contacts at the nodes of `compliance`: row, column and the block to subtract from the Hessian.
    pub(in crate::fem) fn curvature_blocks(
        &self,
        contacts: &[ContactPair],
        Curved { x, motions, share }: Curved<'_>,
        dofs: &Dofs,
        compliance: &Compliance,
    ) -> Vec<PlacedBlock> {
        let of_contact = |t: &ContactPair| {
            let term = self.curvature_term(t, x, motions);
            let mut placed = Vec::with_capacity(9);
            for a in t.terms.iter() {
                for b in t.terms.iter() {
                    let place = |node: u32| compliance.place(dofs.unknown(node)?);
                    if let (Some(row), Some(column)) = (place(a.0), place(b.0)) {
                        let mut block = match &term {
                            CurvatureTerm::OfPoint(of_point) => (of_point * share) * (a.1 * b.1),
                            CurvatureTerm::Turning(turning) => turning.block(a, b) * share,
                        };
                        axes_in(dofs.axes_of(a.0 as usize)).for_each(|axis| block.row_mut(axis).fill(0.0));
                        axes_in(dofs.axes_of(b.0 as usize)).for_each(|axis| block.column_mut(axis).fill(0.0));
                        placed.push(PlacedBlock { row, column, block });
                    }
                }
            }
            placed
        };
        contacts.par_iter().with_min_len(CONTACT_POINTS_PER_TASK).flat_map_iter(of_contact).collect()
    }

    /// The Gauss-Newton part of the Hessian as rank-one terms, one for each contact.
    pub(in crate::fem) fn terms(&self, contacts: &[ContactPair], dofs: &Dofs) -> Vec<RankOne> {
        let term = |t: &ContactPair| {
            let nodes = t.terms.iter().filter_map(|(node, weight)| {
                let mut entry = t.normal * weight;
                axes_in(dofs.axes_of(node as usize)).for_each(|axis| entry[axis] = 0.0);
                dofs.unknown(node).map(|u| (u, entry))
            });
            RankOne { nodes: nodes.collect(), factor: t.stiffness * t.area }
        };
        contacts.iter().map(term).collect()
    }
}
