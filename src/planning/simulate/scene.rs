//! Solves on a ready mesh that is moved by bone.

use std::sync::Arc;

use super::PathCheckpoint;
use super::ready_mesh::{CellIndex, ReadyMesh};
use super::tuning::HELD_INSIDE_MM;
use crate::plan::Plan;
use prosopon_field::SignedField;
use prosopon_geometry::control::Control;
use prosopon_geometry::{DataArray, Implicit, Motion, Point, Vector, VolumeMesh, Warning};
use prosopon_tissue::fem::{CellState, ContactBody, SkinElement, SolveError, SolveSettings, Solver, StepReport};
use prosopon_tissue::mesh::Attachment;

/// Inputs of one solve on a ready mesh.
#[derive(Debug)]
pub struct Scene {
    /// The mesh with its boundary.
    pub ready: ReadyMesh,
    /// Rigid bones on which nodes slide, each with the number of its segment.
    pub bones: Vec<(u32, Arc<SignedField>)>,
    /// Paths of the segments.
    pub plan: Plan,
    /// Model, materials and tolerances.
    pub settings: SolveSettings,
    /// Number of load steps along the path, at least 1.
    pub steps: usize,
}

/// Result of [`Scene::solve`].
#[derive(Debug)]
pub struct SceneOutcome {
    /// Displacement of each node at the last step that was reached, mm.
    pub displacements_mm: Vec<Vector>,
    /// Stress and volume ratio of each tetrahedron at that step.
    pub tetrahedra: Vec<CellState>,
    /// Stress and volume ratio of each prism at that step.
    pub prisms: Vec<CellState>,
    /// Number of unknowns.
    pub unknowns: usize,
    /// Reports of the steps that this solve reached.
    pub steps: Vec<StepReport>,
    /// Warnings about the inputs and the result.
    pub warnings: Vec<Warning>,
    /// Why the path was not finished; `None` when it was.
    pub failure: Option<SolveError>,
}

/// Callback for each step: its number (from 1), the positions of the nodes (LPS mm), its report, and a function that makes a
/// checkpoint of it, or `None` where that is not possible.
pub type OnStep<'a> = dyn FnMut(usize, &[Point], &StepReport, &dyn Fn() -> Option<PathCheckpoint>) + 'a;

impl Scene {
    /// Moves the bones along their paths and raises the loads in proportion.
    ///
    /// # Errors
    /// [`SolveError`] when the problem cannot be set up; an error on the path is in [`SceneOutcome::failure`].
    pub fn solve(&self, control: &Control) -> Result<SceneOutcome, SolveError> {
        self.solve_with_steps(None, control, &mut |_, _, _, _| {})
    }

    /// As [`Scene::solve`], from a checkpoint of the same scene if given, with a callback for each step.
    ///
    /// # Errors
    /// As [`Scene::solve`].
    pub fn solve_with_steps(
        &self,
        resume: Option<&PathCheckpoint>,
        control: &Control,
        on_step: &mut OnStep<'_>,
    ) -> Result<SceneOutcome, SolveError> {
        let mut warnings = self.check()?;
        let mesh = &self.ready.mesh;
        let bodies = self
            .bones
            .iter()
            .map(|(segment, field)| ContactBody { segment: *segment, solid: field.as_ref() })
            .collect();
        let setup = control.stage(0.0, 0.05);
        let mut solver = Solver::with_boundary(mesh, bodies, &self.ready.boundary, self.settings.clone(), &setup)?;
        let path = control.stage(0.05, 1.0);
        let share = |k: usize| k as f64 / self.steps as f64;
        let mut steps = Vec::with_capacity(self.steps);
        let mut failure = None;
        let mut reached = 0;
        if let Some(checkpoint) = resume {
            solver.restore(&checkpoint.solver)?;
            reached = checkpoint.k;
            path.report(share(reached));
        }
        for k in reached + 1..=self.steps {
            let part = path.stage(share(k - 1), share(k));
            match solver.advance(share(k), &|t| self.plan.motions(t), &part) {
                Ok(report) => {
                    for warning in &report.warnings {
                        if !warnings.contains(warning) {
                            warnings.push(warning.clone());
                        }
                    }
                    let checkpoint = || Some(PathCheckpoint { k, begin: None, solver: solver.checkpoint()? });
                    on_step(k, &solver.positions(), &report, &checkpoint);
                    steps.push(report);
                    reached = k;
                }
                Err(error) => {
                    failure = Some(error);
                    break;
                }
            }
        }
        warnings.extend(steps.last().and_then(|s: &StepReport| s.bone_penetration?.warning()));
        warnings.extend(self.held_inside_bone(&solver.positions(), share(reached)));
        let (tetrahedra, prisms) = solver.cell_states();
        let displacements_mm = solver.positions().iter().zip(&mesh.positions).map(|(x, rest)| x - rest).collect();
        Ok(SceneOutcome {
            displacements_mm,
            unknowns: solver.n_unknowns(),
            tetrahedra,
            prisms,
            steps,
            warnings,
            failure,
        })
    }

    /// Warnings about held and tied nodes inside the bone of another segment, which contact cannot push out.
    ///
    /// `x` holds the positions of the nodes at `t` of the path.
    fn held_inside_bone(&self, x: &[Point], t: f64) -> Vec<Warning> {
        let motions = self.plan.motions(t);
        let attachment = &self.ready.mesh.attachment;
        let held_axes = &self.ready.boundary.held_axes;
        let inside = |(segment, field): &(u32, Arc<SignedField>)| {
            let motion = motions.iter().find(|(s, _)| s == segment).map_or_else(Motion::identity, |(_, m)| *m);
            let depths = (0..x.len()).filter_map(|node| {
                let is_held = match attachment[node] {
                    Attachment::Tied(own) => own != *segment,
                    Attachment::Fixed => true,
                    Attachment::Free | Attachment::Sliding | Attachment::Gliding(_) => {
                        held_axes.get(node).is_some_and(|axes| *axes == 7)
                    }
                };
                let depth = -field.value(&motion.inverse_transform_point(&x[node]));
                (is_held && depth > HELD_INSIDE_MM).then_some(depth)
            });
            let (count, deepest) = depths.fold((0, 0.0f64), |(count, deepest), depth| (count + 1, deepest.max(depth)));
            (count > 0).then(|| {
                let message = format!(
                    "{count} held points lie up to {deepest:.2} mm inside bone {segment}: contact cannot push them out and \
                     pushes the points beside them away"
                );
                Warning::check("held-inside-bone", message).act("Hold fewer points there, or move the bone.")
            })
        };
        self.bones.iter().filter_map(inside).collect()
    }

    /// Checks that the inputs fit together; returns warnings.
    fn check(&self) -> Result<Vec<Warning>, SolveError> {
        let problem = |detail: String| Err(SolveError::Problem { detail });
        if self.steps == 0 {
            return problem("steps is 0, at least 1 is needed".to_owned());
        }
        let buried = self.ready.buried_prisms();
        if self.settings.skin_element == SkinElement::C1Prism && buried > 0 {
            return problem(format!(
                "{buried} wedges have an outer corner that is an inner corner of another wedge, but C1 prisms must form one \
                 layer at the surface; use another `skin_element`"
            ));
        }
        let mut warnings = self.ready.warnings.clone();
        let attachment = &self.ready.mesh.attachment;
        let slides = attachment.iter().any(|a| matches!(a, Attachment::Sliding | Attachment::Gliding(_)));
        if slides && self.bones.is_empty() {
            let message = "points slide (attachment -2), but there is no bone to slide on";
            warnings.push(Warning::check("no-bone-to-slide-on", message).act("Give `bones`."));
        }
        if !slides && !self.bones.is_empty() {
            let message = "bones are given, but no point slides (attachment -2) or glides (-3 and below): there is no contact with bone";
            warnings.push(Warning::check("no-point-slides", message).act("Let points slide, or leave out `bones`."));
        }
        for path in &self.plan.paths {
            let segment = path.segment();
            let on = |a: &Attachment| matches!(a, Attachment::Tied(s) | Attachment::Gliding(s) if *s == segment);
            let used = attachment.iter().any(on) || self.bones.iter().any(|(s, _)| *s == segment);
            if !used {
                let message = format!("segment {segment} moves nothing: no point is tied to it and it has no bone");
                warnings
                    .push(Warning::check("segment-moves-nothing", message).act("Tie points to it or give its bone."));
            }
        }
        let mut still: Vec<u32> = (attachment.iter())
            .filter_map(|a| match a {
                Attachment::Tied(s) if *s > 0 && !self.plan.paths.iter().any(|p| p.segment() == *s) => Some(*s),
                Attachment::Tied(_)
                | Attachment::Gliding(_)
                | Attachment::Free
                | Attachment::Sliding
                | Attachment::Fixed => None,
            })
            .collect();
        still.sort_unstable();
        still.dedup();
        if !still.is_empty() {
            let message =
                format!("points are tied to segments {still:?}, which have no path: these points stay at rest");
            warnings
                .push(Warning::check("tied-to-still-segment", message).act("Give these segments a path, or tie to 0."));
        }
        Ok(warnings)
    }

    /// The mesh `file` of the scene with the point arrays `displacement_mm` and `attachment`.
    ///
    /// Points are at rest, in the file's order.
    #[must_use]
    pub fn moved_mesh(&self, file: &VolumeMesh, displacements_mm: &[Vector]) -> VolumeMesh {
        let displacement = displacements_mm.iter().flat_map(|u| <[f64; 3]>::from(*u));
        let attachment = self.ready.mesh.attachment.iter().map(|a| a.number()).collect();
        VolumeMesh {
            points: file.points.clone(),
            cells: file.cells.clone(),
            point_arrays: vec![
                DataArray { name: "displacement_mm".to_owned(), components: 3, values: displacement.collect() },
                DataArray { name: "attachment".to_owned(), components: 1, values: attachment },
            ],
            cell_arrays: Vec::new(),
        }
    }

    /// The mesh `file` of the scene with the outcome as point and cell arrays.
    ///
    /// Point arrays: `displacement_mm` and `attachment`. Cell arrays: `tissue`, `stress_mpa` (Cauchy: xx, yy, zz, xy, yz, xz),
    /// `von_mises_mpa` and `volume_ratio`. Points are at rest; points and cells are in the file's order.
    #[must_use]
    pub fn solved_mesh(&self, file: &VolumeMesh, outcome: &SceneOutcome) -> VolumeMesh {
        let mesh = &self.ready.mesh;
        let states: Vec<(&CellState, f64)> = (self.ready.cell_indices.iter())
            .map(|place| match *place {
                CellIndex::Tetrahedron(i) => {
                    (&outcome.tetrahedra[i as usize], f64::from(mesh.tetrahedron_tissue[i as usize] as u8))
                }
                CellIndex::Prism(i) => (&outcome.prisms[i as usize], f64::from(mesh.tissue_of_prism(i as usize) as u8)),
            })
            .collect();
        let tissue: Vec<f64> = states.iter().map(|(_, tissue)| *tissue).collect();
        let stress: Vec<f64> = states.iter().flat_map(|(s, _)| s.stress_mpa).collect();
        let von_mises: Vec<f64> = states.iter().map(|(s, _)| von_mises(&s.stress_mpa)).collect();
        let ratio: Vec<f64> = states.iter().map(|(s, _)| s.volume_ratio).collect();
        let array = |name: &str, components, values| DataArray { name: name.to_owned(), components, values };
        VolumeMesh {
            cell_arrays: vec![
                array("tissue", 1, tissue),
                array("stress_mpa", 6, stress),
                array("von_mises_mpa", 1, von_mises),
                array("volume_ratio", 1, ratio),
            ],
            ..self.moved_mesh(file, &outcome.displacements_mm)
        }
    }
}

fn von_mises(&[xx, yy, zz, xy, yz, xz]: &[f64; 6]) -> f64 {
    let normal = (xx - yy).powi(2) + (yy - zz).powi(2) + (zz - xx).powi(2);
    (0.5 * normal + 3.0 * (xy * xy + yz * yz + xz * xz)).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn von_mises_of_tension_and_shear() {
        assert!((von_mises(&[2.0, 0.0, 0.0, 0.0, 0.0, 0.0]) - 2.0).abs() < 1e-15);
        assert!((von_mises(&[5.0, 5.0, 5.0, 1.0, 0.0, 0.0]) - 3.0f64.sqrt()).abs() < 1e-15);
    }
}
