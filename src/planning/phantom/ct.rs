use super::Phantom;
use prosopon_geometry::{Point, Vector, Volume};
use rayon::prelude::*;

const AIR: f64 = -1000.0;
const FAT: f64 = -90.0;
const SOFT: f64 = 40.0;
const BONE: f64 = 1200.0;
/// Fat lies between these depths below the skin, mm.
const FAT_FROM_MM: f64 = 2.0;
const FAT_TO_MM: f64 = 7.0;

impl Phantom {
    /// Samples a CT of the phantom with cubic voxels of edge `spacing_mm`.
    ///
    /// The values are -1000 HU for air, 40 for soft tissue, -90 for fat (2 to 7 mm below the skin) and 1200 for bone. Within
    /// half a voxel of a surface the values of both sides are mixed by their share (partial volume).
    #[must_use]
    pub fn ct(&self, spacing_mm: f64) -> Volume {
        let bounds = self.bounds();
        let extent = bounds.max - bounds.min;
        let dims = [0, 1, 2].map(|a| (extent[a] / spacing_mm).ceil() as usize + 1);
        let mut hu = vec![0i16; dims.iter().product()];
        hu.par_chunks_mut(dims[0]).enumerate().for_each(|(row, values)| {
            let (j, k) = (row % dims[1], row / dims[1]);
            for (i, value) in values.iter_mut().enumerate() {
                let p = bounds.min + Vector::new(i as f64, j as f64, k as f64) * spacing_mm;
                *value = self.hounsfield(&p, spacing_mm).round() as i16;
            }
        });
        let axes = [Vector::x() * spacing_mm, Vector::y() * spacing_mm, Vector::z() * spacing_mm];
        Volume { dims, origin: bounds.min, axes, hu }
    }

    pub(super) fn hounsfield(&self, p: &Point, spacing_mm: f64) -> f64 {
        let share_inside = |signed_distance: f64| (0.5 - signed_distance / spacing_mm).clamp(0.0, 1.0);
        let mix = |outside: f64, inside: f64, share: f64| outside + (inside - outside) * share;
        let skin = self.skin.value(p);
        let body = share_inside(skin);
        if body == 0.0 {
            return AIR;
        }
        let fat = share_inside((skin + FAT_FROM_MM).max(-FAT_TO_MM - skin));
        let mut hu = mix(AIR, mix(SOFT, FAT, fat), body);
        hu = mix(hu, BONE, share_inside(self.skull.value(p)));
        mix(hu, AIR, share_inside(self.air.value(p)))
    }
}
