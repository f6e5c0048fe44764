use super::Clinical;
use prosopon_geometry::Warning;

impl Clinical {
    /// The warning of given points that were left out because they lie too far from skin or bone.
    #[must_use]
    pub fn points_off_surface(&self) -> Option<Warning> {
        let one = |(name, mm): &(&str, f64)| format!("{name} ({mm:.0} mm)");
        let names: Vec<String> = self.left_out.iter().map(one).collect();
        (!names.is_empty()).then(|| {
            let message =
                format!("named points were left out, since they lie too far from skin or bone: {}", names.join(", "));
            Warning::check("points-not-measured", message)
                .act("Correct these landmarks, or leave them out to have them found.")
        })
    }
}
