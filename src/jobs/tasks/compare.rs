use crate::geometry::{Aabb, TriMesh};
use crate::jobs::Service;
use crate::session::{ErrorDocument, Fault};

/// Vertices of the prediction that a registration goes by: those outside all of these boxes.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct RegisterOn {
    /// Altered parts, LPS mm.
    pub altered: Vec<Aabb>,
}

/// Two surfaces to compare.
#[derive(Debug, Clone, PartialEq)]
pub struct Comparison {
    /// What was predicted.
    pub prediction: TriMesh,
    /// What it is compared with.
    pub reference: TriMesh,
    /// Name of the reference in the answer.
    pub reference_name: String,
    /// Only prediction vertices in one of these boxes count; all when empty.
    pub mask: Vec<Aabb>,
    /// Rigid registration of the prediction before comparing.
    pub register: Option<RegisterOn>,
}

/// Signed error of a prediction: its document and the value of every vertex, mm.
///
/// # Errors
/// What the numerics say.
pub async fn compare(service: &Service, comparison: Comparison) -> Result<(ErrorDocument, Vec<f32>), Fault> {
    service
        .compute(move |engine, control| {
            let Comparison { mut prediction, reference, reference_name, mask, register } = comparison;
            let inside = |boxes: &[Aabb], mesh: &TriMesh| -> Vec<bool> {
                mesh.positions().iter().map(|p| boxes.iter().any(|b| b.contains(p))).collect()
            };
            let counted = (!mask.is_empty()).then(|| inside(&mask, &prediction));
            let mut applied = None;
            if let Some(on) = register {
                let unaltered: Vec<bool> = inside(&on.altered, &prediction).iter().map(|b| !b).collect();
                let motion = engine.register(&prediction, &reference, Some(&unaltered), &control.part(0.0, 0.5))?;
                prediction = prediction.moved(&motion);
                applied = Some(motion);
            }
            let control = control.part(0.5, 1.0);
            let mut map = engine.error_map(&prediction, &reference, counted.as_deref(), &[], &control)?;
            if let Some(motion) = applied {
                map.registration = motion;
            }
            let mask = if counted.is_some() { "boxes" } else { "all" };
            Ok((ErrorDocument::new(reference_name, mask, &map), map.signed_mm))
        })
        .await
}
