//! Where bone carries teeth.

use super::tuning::{ARCH_DEPTH_MM, ARCH_HALF_WIDTH_MM, BEFORE_ARCH_MM, CROWN_MM, FRONT_HALF_WIDTH_MM};
use prosopon_geometry::{Point, TriMesh, Vector};

/// Place of both rows of teeth, in closed bite.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DentalArch {
    /// Point of the occlusal plane in the midline, at the front of the teeth, LPS mm.
    pub front: Point,
    /// Unit normal of the occlusal plane, upwards.
    pub up: Vector,
}

prosopon_geometry::flat!(DentalArch { front, up });

impl DentalArch {
    /// The arch on the occlusal plane through `point` with the normal `up`, in front of which the foremost bone of `surfaces`
    /// within a crown's height lies; `None` where there is no bone at the plane.
    #[must_use]
    pub fn on_plane<'a>(
        surfaces: impl IntoIterator<Item = &'a TriMesh>,
        midline_x_mm: f64,
        point: &Point,
        up: &Vector,
    ) -> Option<Self> {
        let up = up.try_normalize(1e-6)?;
        let mut arch = Self { front: Point::new(midline_x_mm, point.y, point.z), up };
        // On the plane, in the midline.
        let lift = (point - arch.front).dot(&up) / up.z;
        arch.front.z += lift;
        let at_front = |p: &&Point| arch.height(p).abs() < CROWN_MM && (p.x - midline_x_mm).abs() < FRONT_HALF_WIDTH_MM;
        let bone = surfaces.into_iter().flat_map(|s| s.positions().iter());
        let behind = bone.filter(at_front).map(|p| arch.behind(p)).min_by(f64::total_cmp)?;
        arch.front += arch.back() * behind;
        Some(arch)
    }

    /// Direction backwards in the occlusal plane.
    fn back(&self) -> Vector {
        self.up.cross(&Vector::x()).normalize()
    }

    /// Height of `p` above the occlusal plane, mm.
    #[must_use]
    pub fn height(&self, p: &Point) -> f64 {
        (p - self.front).dot(&self.up)
    }

    /// Distance of `p` behind the front of the teeth, mm.
    #[must_use]
    pub fn behind(&self, p: &Point) -> f64 {
        (p - self.front).dot(&self.back())
    }

    /// Distance of `p` from the zone of teeth and gum, which reaches `height_mm` above and below the occlusal plane, mm; 0 inside.
    #[must_use]
    pub fn distance(&self, p: &Point, height_mm: f64) -> f64 {
        let behind = self.behind(p);
        let beyond = [
            self.height(p).abs() - height_mm,
            (p.x - self.front.x).abs() - ARCH_HALF_WIDTH_MM,
            behind - ARCH_DEPTH_MM,
            -behind - BEFORE_ARCH_MM,
        ];
        beyond.iter().map(|d| d.max(0.0).powi(2)).sum::<f64>().sqrt()
    }
}
