use super::{Clinical, NamedPoint, hard_of};
use prosopon_geometry::Warning;

/// Movement of the jaws apart above which joined lips matter, mm: the accuracy that a prediction aims at.
const APART_MM: f64 = 1.0;

impl Clinical {
    /// The warning of lips that hold each other because they are joined in the mesh while their jaws move apart.
    #[must_use]
    pub fn joined_lips(&self) -> Option<Warning> {
        let hard = |soft: &str| hard_of(soft).iter().find_map(|name| self.hard.iter().find(|p| p.name == *name));
        let margin = self.soft.iter().find(|p| p.name == "stomion_inferius").filter(|_| self.is_mouth_sealed)?;
        let [upper, lower] = [hard("stomion_superius")?, hard("stomion_inferius")?].map(NamedPoint::movement);
        ((upper - lower).norm() > APART_MM).then(|| {
            let message = format!(
                "the lips are joined in the mesh, but the upper jaw moves by {:.1} mm and the lower one by {:.1} mm: each lip \
                 holds the other, and the line between them moves by {:.1} mm",
                upper.norm(),
                lower.norm(),
                margin.movement().norm()
            );
            let action = "Do not rely on the lips, or build the mesh with `mouth` set to `auto`, which lets them part.";
            Warning::check("joined-lips", message).act(action)
        })
    }
}
