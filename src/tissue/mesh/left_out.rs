//! What a mesh leaves out of the tissue, and the warnings about it.

use super::MixedMesh;
use super::parts::LooseParts;
use super::pockets::Pockets;
use super::report::volume_mm3;
use super::tuning::{MINOR_PART_SHARE, MINOR_POCKET_SHARE, MINOR_PRISM_SHARE};
use prosopon_geometry::Warning;

/// Tissue and elements that are not in the mesh.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct LeftOut {
    pub(super) pockets: Pockets,
    pub(super) prisms: LeftOutPrisms,
    pub(super) loose: LooseParts,
}

/// Prisms that were left out.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct LeftOutPrisms {
    /// Prisms that could not be formed under folds of the skin.
    pub(super) folded: usize,
    /// Prisms at folds that are too thin for the lattice.
    pub(super) off_skin: usize,
    /// Number of all prisms, with those left out.
    pub(super) of: usize,
}

impl LeftOut {
    /// One warning for each kind of thing that was left out of `mesh`, which was built with edges of `edge_mm`.
    pub(super) fn warnings(&self, mesh: &MixedMesh, edge_mm: f64) -> Vec<Warning> {
        let Self { pockets, prisms, loose } = *self;
        let mut out = Vec::new();
        if pockets.pockets > 0 {
            let volume = volume_mm3(mesh);
            let share = pockets.volume_mm3 / volume;
            let message = format!(
                "tissue behind narrow necks was left out: {} pockets with {} tetrahedra and {:.2} cm³, {:.1} % of the mesh",
                pockets.pockets,
                pockets.tetrahedra,
                pockets.volume_mm3 / 1000.0,
                100.0 * share
            );
            let action = "Check whether the bone's surface closes off tissue that should move.";
            out.push(by_share("mesh-pockets", message, share, MINOR_POCKET_SHARE, action));
        }
        let left_out = prisms.folded + prisms.off_skin;
        if left_out > 0 {
            let message = format!(
                "{left_out} of {} prisms were left out: {} could not be formed under folds of the skin, {} lie at folds \
                 too thin for an edge of {edge_mm:.2} mm",
                prisms.of, prisms.folded, prisms.off_skin
            );
            let share = left_out as f64 / prisms.of as f64;
            out.push(by_share("mesh-prisms-left-out", message, share, MINOR_PRISM_SHARE, "Use a shorter edge."));
        }
        if loose.parts > 0 {
            let message = format!(
                "{} parts attached to the tissue by fewer than two faces were dropped ({} of {} elements)",
                loose.parts, loose.elements, loose.of
            );
            let share = loose.elements as f64 / loose.of as f64;
            out.push(by_share("mesh-loose-parts", message, share, MINOR_PART_SHARE, "Use a shorter edge."));
        }
        out
    }
}

/// A fact below the share `minor`, a check with something to do from there on.
fn by_share(code: &'static str, message: String, share: f64, minor: f64, action: &'static str) -> Warning {
    if share < minor { Warning::info(code, message) } else { Warning::check(code, message).act(action) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use prosopon_geometry::Severity;

    #[test]
    fn small_losses_are_facts_and_large_ones_are_to_be_checked() {
        let mesh = MixedMesh {
            positions: [[0.0; 3], [10.0, 0.0, 0.0], [0.0, 10.0, 0.0], [0.0, 0.0, 6.0]].map(Into::into).to_vec(),
            tetrahedra: vec![[0, 1, 2, 3]],
            tetrahedron_tissue: vec![super::super::Tissue::Fat],
            prisms: Vec::new(),
            prism_tissue: Vec::new(),
            bone_faces: Vec::new(),
            attachment: vec![super::super::Attachment::Free; 4],
            depth_cut_nodes: Vec::new(),
            facing: Vec::new(),
        };
        assert_eq!(LeftOut::default().warnings(&mesh, 4.0), []);
        let found = |pocket_mm3: f64, left_out: usize| {
            let left_out = LeftOut {
                pockets: Pockets { pockets: 1, tetrahedra: 3, volume_mm3: pocket_mm3 },
                prisms: LeftOutPrisms { folded: left_out, off_skin: 0, of: 1000 },
                loose: LooseParts { parts: 1, elements: left_out, of: 1000 },
            };
            let warnings = left_out.warnings(&mesh, 4.0);
            assert!(warnings.iter().all(|w| w.action.is_empty() == (w.severity == Severity::Info)), "{warnings:?}");
            warnings.into_iter().map(|w| (w.code, w.severity)).collect::<Vec<_>>()
        };
        let codes = ["mesh-pockets", "mesh-prisms-left-out", "mesh-loose-parts"];
        // The tetrahedron holds 100 mm³.
        assert_eq!(found(4.9, 9), codes.map(|c| (c, Severity::Info)));
        assert_eq!(found(5.1, 10), codes.map(|c| (c, Severity::Check)));
    }
}
