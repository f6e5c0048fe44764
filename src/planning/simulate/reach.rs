//! Estimates which tissue a plan hardly moves.

use super::CutBone;
use super::tuning::{MAX_REACH_ITERATIONS, PATH_INSTANTS, PUSHED_MM, REACH_ERROR, SHEET_STIFFNESS};
use crate::plan::Plan;
use prosopon_geometry::control::{Cancelled, Control};
use prosopon_geometry::{Aabb, Point};
use prosopon_tissue::fem::material::Materials;
use prosopon_tissue::mesh::{Attachment, MixedMesh, Tissue};

/// Bound on how far `plan` displaces bone, rounded up to a power of two, mm; 0 when no bone moves.
///
/// The rounding lets plans of about the same size leave out the same tissue.
#[must_use]
pub fn displacement_class_mm(bone: &CutBone, plan: &Plan) -> f64 {
    let mut largest = 0.0f64;
    for k in 1..=PATH_INSTANTS {
        for (segment, motion) in plan.motions(k as f64 / PATH_INSTANTS as f64) {
            // The displacement by a rigid motion is convex in the point, so the corners of the box bound it.
            let surfaces = bone.osteotomy.segments.iter().filter(|s| s.id == segment);
            let corners = surfaces.flat_map(|s| corners(&s.surface.bounds()));
            largest = corners.map(|p| (motion.transform_point(&p) - p).norm()).fold(largest, f64::max);
        }
    }
    if largest > 0.0 { largest.log2().ceil().exp2() } else { 0.0 }
}

fn corners(b: &Aabb) -> [Point; 8] {
    std::array::from_fn(|i| {
        let axis = |k: usize| if i & (1 << k) == 0 { b.min[k] } else { b.max[k] };
        Point::new(axis(0), axis(1), axis(2))
    })
}

/// Segments that a plan moves, and a bound on how far.
#[derive(Debug, Clone, Copy)]
pub(super) struct BoneMotion<'a> {
    /// Numbers of the moving segments.
    pub(super) moving: &'a [u32],
    /// Class of the displacement, from [`displacement_class_mm`].
    pub(super) displacement_mm: f64,
}

/// Nodes not held by bone that move by less than `min_mm`, by estimate.
///
/// The length of the displacement is taken as harmonic between moving and fixed bone, with conductances `G V / l²` on the edges
/// of the cells. `G` is the shear modulus of the tissue, and four times that of skin: skin is pulled along as a sheet, and an
/// incompressible sheet resists a pull with `4 G`. Tissue that glides on resting bone moves along it, and so counts as free.
pub(super) fn beyond_reach(
    mesh: &MixedMesh,
    bone: &CutBone,
    BoneMotion { moving, displacement_mm }: BoneMotion<'_>,
    min_mm: f64,
    materials: &Materials,
    control: &Control,
) -> Result<Vec<u32>, Cancelled> {
    let solids = bone.solids();
    let pushed = |node: usize| {
        let chosen = solids.iter().filter(|(id, _)| moving.contains(id));
        chosen.map(|(_, solid)| solid.value(&mesh.positions[node])).fold(f64::INFINITY, f64::min) < PUSHED_MM
    };
    let held: Vec<Option<f64>> = (mesh.attachment.iter().enumerate())
        .map(|(node, attachment)| match attachment {
            Attachment::Tied(segment) | Attachment::Gliding(segment) if moving.contains(segment) => {
                Some(displacement_mm)
            }
            Attachment::Tied(_) | Attachment::Fixed => Some(0.0),
            Attachment::Sliding if pushed(node) => Some(displacement_mm),
            Attachment::Gliding(_) | Attachment::Sliding | Attachment::Free => None,
        })
        .collect();
    let conductances = Conductances::of(mesh, |tissue| {
        let modulus = materials.of(tissue).shear_modulus();
        if tissue == Tissue::Skin { SHEET_STIFFNESS * modulus } else { modulus }
    });
    let estimate = conductances.harmonic(&held, REACH_ERROR * displacement_mm, control)?;
    let beyond = (0..held.len()).filter(|&node| held[node].is_none() && estimate[node] < min_mm);
    Ok(beyond.map(|node| node as u32).collect())
}

/// Conductances between nodes, in compressed rows.
struct Conductances {
    first: Vec<u32>,
    entries: Vec<(u32, f64)>,
}

impl Conductances {
    /// On the edges of the cells, weighted with the modulus of their tissue.
    fn of(mesh: &MixedMesh, modulus: impl Fn(Tissue) -> f64) -> Self {
        let mut links: Vec<(u32, u32, f64)> = Vec::new();
        let prisms = mesh.prisms.iter().enumerate().flat_map(|(prism, nodes)| {
            let [a, b, c, d, e, f] = *nodes;
            [[a, b, c, d], [b, c, d, e], [c, d, e, f]].map(|cell| (cell, mesh.tissue_of_prism(prism)))
        });
        let tetrahedra = mesh.tetrahedra.iter().copied().zip(mesh.tetrahedron_tissue.iter().copied());
        for (cell, tissue) in tetrahedra.chain(prisms) {
            let [a, b, c, d] = cell.map(|n| mesh.positions[n as usize]);
            let weight = modulus(tissue) * (b - a).cross(&(c - a)).dot(&(d - a)).abs() / 6.0;
            for (i, j) in [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)] {
                let (i, j) = (cell[i], cell[j]);
                let length_sq = (mesh.positions[i as usize] - mesh.positions[j as usize]).norm_squared();
                if length_sq > 0.0 {
                    links.extend([(i, j, weight / length_sq), (j, i, weight / length_sq)]);
                }
            }
        }
        links.sort_by_key(|(i, j, _)| (*i, *j));
        links.dedup_by(|next, kept| {
            let same = (next.0, next.1) == (kept.0, kept.1);
            kept.2 += if same { next.2 } else { 0.0 };
            same
        });
        let mut first = vec![0u32; mesh.positions.len() + 1];
        links.iter().for_each(|(i, ..)| first[*i as usize + 1] += 1);
        (1..first.len()).for_each(|i| first[i] += first[i - 1]);
        Self { first, entries: links.into_iter().map(|(_, j, g)| (j, g)).collect() }
    }

    fn row(&self, node: usize) -> &[(u32, f64)] {
        &self.entries[self.first[node] as usize..self.first[node + 1] as usize]
    }

    /// `A x` at free nodes, 0 at held ones.
    fn apply(&self, free: &[bool], x: &[f64], out: &mut [f64]) {
        for node in (0..x.len()).filter(|&n| free[n]) {
            out[node] = self.row(node).iter().map(|(other, g)| g * (x[node] - x[*other as usize])).sum();
        }
    }

    /// Values with zero net flow at all free nodes, by conjugate gradients with the diagonal as preconditioner.
    ///
    /// Stops when no node's residual flow would change its value by more than `error`. Free nodes without a link keep 0.
    fn harmonic(&self, held: &[Option<f64>], error: f64, control: &Control) -> Result<Vec<f64>, Cancelled> {
        let n = held.len();
        let diagonal: Vec<f64> = (0..n).map(|node| self.row(node).iter().map(|(_, g)| g).sum()).collect();
        let free: Vec<bool> = (0..n).map(|node| held[node].is_none() && diagonal[node] > 0.0).collect();
        let mut x: Vec<f64> = held.iter().map(|h| h.unwrap_or(0.0)).collect();
        let mut residual = vec![0.0; n];
        self.apply(&free, &x, &mut residual);
        residual.iter_mut().for_each(|r| *r = -*r);
        let mut direction = vec![0.0; n];
        let mut applied = vec![0.0; n];
        let mut last = 0.0;
        for iteration in 0..MAX_REACH_ITERATIONS {
            control.check()?;
            let scaled = |node: usize| if free[node] { residual[node] / diagonal[node] } else { 0.0 };
            if (0..n).all(|node| scaled(node).abs() <= error) {
                break;
            }
            let now: f64 = (0..n).map(|node| residual[node] * scaled(node)).sum();
            let turn = if iteration == 0 { 0.0 } else { now / last };
            last = now;
            (0..n).for_each(|node| direction[node] = scaled(node) + turn * direction[node]);
            self.apply(&free, &direction, &mut applied);
            let curvature: f64 = direction.iter().zip(&applied).map(|(d, a)| d * a).sum();
            if curvature <= 0.0 {
                break;
            }
            let step = now / curvature;
            (0..n).for_each(|node| x[node] += step * direction[node]);
            (0..n).for_each(|node| residual[node] -= step * applied[node]);
        }
        Ok(x)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::phantom;
    use crate::plan::{Path, le_fort_1};
    use crate::simulate::{
        Anatomy, FieldsSettings, LEAVE_OUT_BELOW_MM, LeftOut, RunSettings, TissueSettings, build_fields, build_tissue,
        cut_bone, solve,
    };
    use prosopon_geometry::{Motion, Severity};
    use prosopon_tissue::fem::{Model, Preset, SolveSettings};
    use prosopon_tissue::mesh::MeshSettings;

    /// A bar of `n` by 3 by 3 unit cubes, each cut into six tetrahedra around one diagonal.
    fn bar(n: usize) -> MixedMesh {
        let at = |i: usize, j: usize, k: usize| ((i * 4 + j) * 4 + k) as u32;
        let mut mesh = MixedMesh {
            positions: Vec::new(),
            tetrahedra: Vec::new(),
            tetrahedron_tissue: Vec::new(),
            prisms: Vec::new(),
            prism_tissue: Vec::new(),
            bone_faces: Vec::new(),
            attachment: Vec::new(),
            depth_cut_nodes: Vec::new(),
            facing: Vec::new(),
        };
        for i in 0..=n {
            for (j, k) in (0..4).flat_map(|j| (0..4).map(move |k| (j, k))) {
                mesh.positions.push(Point::new(i as f64, j as f64, k as f64));
                mesh.attachment.push(Attachment::Free);
            }
        }
        for (i, j, k) in (0..n).flat_map(|i| (0..3).flat_map(move |j| (0..3).map(move |k| (i, j, k)))) {
            for order in [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]] {
                let mut corner = [i, j, k];
                let mut cell = [at(i, j, k); 4];
                for (slot, axis) in order.into_iter().enumerate() {
                    corner[axis] += 1;
                    cell[slot + 1] = at(corner[0], corner[1], corner[2]);
                }
                mesh.tetrahedra.push(cell);
                mesh.tetrahedron_tissue.push(Tissue::Fat);
            }
        }
        mesh
    }

    /// Between ends that are held at 8 and 0 the harmonic length falls linearly. Edges at the bar's sides have fewer cells on
    /// one side, which shifts it by less than what it falls by over a cell.
    #[test]
    fn it_falls_linearly_along_a_bar() {
        let n = 16;
        let mesh = bar(n);
        let held: Vec<Option<f64>> = mesh
            .positions
            .iter()
            .map(|p| if p.x == 0.0 { Some(8.0) } else { (p.x == n as f64).then_some(0.0) })
            .collect();
        let found = Conductances::of(&mesh, |_| 1.0).harmonic(&held, 1e-8, &Control::new()).unwrap();
        for (p, u) in mesh.positions.iter().zip(found) {
            let exact = 8.0 * (1.0 - p.x / n as f64);
            assert!((u - exact).abs() < 8.0 / n as f64, "{p}: {u} {exact}");
        }
    }

    /// With one end held and nothing else, all moves with it; a node of no cell keeps 0.
    #[test]
    fn what_nothing_holds_back_moves_with_the_bone() {
        let mut mesh = bar(4);
        mesh.positions.push(Point::new(50.0, 0.0, 0.0));
        mesh.attachment.push(Attachment::Free);
        let mut held: Vec<Option<f64>> = mesh.positions.iter().map(|p| (p.x == 0.0).then_some(2.0)).collect();
        let found = Conductances::of(&mesh, |_| 1.0).harmonic(&held, 1e-10, &Control::new()).unwrap();
        let (alone, others) = found.split_last().unwrap();
        assert_eq!(*alone, 0.0);
        assert!(others.iter().all(|u| (u - 2.0).abs() < 1e-6));
        held.iter_mut().for_each(|h| *h = None);
        assert!(
            Conductances::of(&mesh, |_| 1.0).harmonic(&held, 1e-10, &Control::new()).unwrap().iter().all(|u| *u == 0.0)
        );
    }

    /// The phantom on a coarse mesh, its upper jaw 4 mm forward: the tissue left out is far from the jaw, and the skin differs
    /// from the solve of all tissue by less than 0.05 mm at P99.
    #[test]
    fn tissue_left_out_is_not_missed() {
        let head = phantom::head();
        let sampled = |solid| phantom::surface_of(solid, &head.bounds(), 3.0).unwrap();
        let (skin, skull) = (sampled(head.skin.as_ref()), sampled(head.skull.as_ref()));
        let anatomy = Anatomy {
            skin,
            skull,
            air: None,
            soft_tissue: None,
            landmarks: head.landmarks.points.clone(),
            midline_x_mm: None,
        };
        let control = Control::new();
        let mut settings = FieldsSettings::default();
        settings.field.field.spacing_mm = 2.0;
        let fields = build_fields(&anatomy, &settings, &control).unwrap();
        let marks = &head.landmarks;
        let cuts =
            le_fort_1(marks.le_fort_1_plane, marks.midline_x_mm, marks.occlusal_plane_z_mm, [None; 2], &fields.bone);
        let bone = cut_bone(&fields.bone, &cuts, &settings.field, &control).unwrap();
        let mesh = MeshSettings { edge_mm: 9.0, ..MeshSettings::default() };
        let tissue = build_tissue(
            &anatomy,
            &fields,
            Some(&bone),
            &TissueSettings { mesh, ..TissueSettings::default() },
            &control,
        )
        .unwrap();
        let jaw = bone.osteotomy.segments.iter().find(|s| s.id != 0 && s.bounded_by.contains(&0)).unwrap().id;
        let path = Path::new(jaw, vec![(1.0, Motion::translation(0.0, -4.0, 0.0))]).unwrap();
        let plan = Plan { paths: vec![path] };
        assert_eq!(displacement_class_mm(&bone, &plan), 4.0);
        let solved = |leave_out_below_mm: f64| {
            let solver = SolveSettings::new(Model::Linear, Preset::Wang2009Stable.materials());
            let run = RunSettings { solver, steps: 1, attachment: None, leave_out_below_mm };
            let mut skin = None;
            let outcome =
                solve(&anatomy, &tissue, &bone, &plan, &run, &control, &mut |frame| skin = Some(frame.skin)).unwrap();
            (outcome, skin.unwrap())
        };
        let ((whole, all), (kept, some)) = (solved(0.0), solved(LEAVE_OUT_BELOW_MM));
        // A normal run needs no action.
        let all_warnings = [&fields.warnings, &bone.osteotomy.warnings, &tissue.report.warnings, &kept.warnings];
        let loud = all_warnings.into_iter().flatten().filter(|w| w.severity != Severity::Info);
        assert_eq!(loud.map(|w| w.code).collect::<Vec<_>>(), [""; 0]);
        assert_eq!(whole.left_out, LeftOut { nodes: 0, of_nodes: tissue.mesh.positions.len(), border_mm: 0.0 });
        let (before, after) = (whole.steps[0].unknowns, kept.steps[0].unknowns);
        assert!(10 * after < 9 * before, "{after} of {before} unknowns are left");
        // Tissue left out was estimated to move by less than 0.03 mm; on cells of 9 mm the estimate is good to a factor of eight.
        assert!(kept.left_out.border_mm < 8.0 * LEAVE_OUT_BELOW_MM, "{:?}", kept.left_out);
        let mut off: Vec<f64> = all.positions().iter().zip(some.positions()).map(|(a, b)| (a - b).norm()).collect();
        off.sort_by(f64::total_cmp);
        let p99 = off[off.len() * 99 / 100];
        assert!(p99 > 0.0 && p99 < 0.05, "{p99} mm");
    }
}
