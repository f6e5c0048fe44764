//! Le Fort II and III: cuts swept backwards from the face, closed by a plane that slants down to the pterygoid plates.

use super::super::PlanError;
use super::super::shape::{BoundedPlane, Cut, CutShape};
use super::tuning::{AHEAD_MM, HALF_WIDTH_FACE_MM, HALF_WIDTH_MM, HALF_WIDTH_TEETH_MM, MIN_STEP_MM, OVERLAP_MM};
use super::{Landmarks, le_fort_1, meets, misplaced};
use prosopon_field::Envelope;
use prosopon_geometry::{Point, Vector};

/// Positions that the cuts behind the face share, mm.
struct Back {
    midline: f64,
    front_y: f64,
    tuberosity_y: f64,
    occlusal: f64,
}

impl Back {
    /// Looks for the end of the tuberosities in the lowest 30 % of the height from the occlusal plane to the nasion.
    fn new(landmarks: &Landmarks, bone: &Envelope) -> Result<Self, PlanError> {
        let (nasion, occlusal) = (landmarks.point("nasion")?, landmarks.occlusal()?.point.z);
        let midline = landmarks.midline_x_mm.unwrap_or(nasion.x);
        let height = nasion.z - occlusal;
        if !(35.0..150.0).contains(&height) {
            return Err(misplaced(&format!(
                "put the nasion {height:.0} mm above the occlusal plane, allowed is 35 to 150 mm; check both"
            )));
        }
        let level = Point::new(midline, nasion.y, occlusal + 0.3 * height);
        let [_, tuberosity_y] = le_fort_1::tuberosity_y((level, Vector::z()), midline, occlusal, bone)
            .ok_or_else(|| misplaced("do not locate the tuberosities; check nasion and occlusal plane"))?;
        Ok(Self { midline, front_y: nasion.y - AHEAD_MM, tuberosity_y, occlusal })
    }

    /// A strip swept backwards from a line in the frontal plane, to behind the tuberosities.
    fn swept(&self, line: &[[f64; 2]]) -> Cut {
        let points = line.iter().map(|[x, z]| Point::new(*x, self.front_y, *z)).collect();
        let depth_mm = self.tuberosity_y - self.front_y + 2.0 * OVERLAP_MM;
        CutShape::Polyline { points, direction: Vector::y(), depth_mm }.into()
    }

    /// The plane from `top` (y, z) down to behind the tuberosities: wide above `knee` (z), narrow below it.
    fn slanted(&self, top: [f64; 2], knee: f64, half_width: f64) -> [Cut; 2] {
        let low = [self.tuberosity_y, self.occlusal - OVERLAP_MM];
        let at = |z: f64| {
            let share = (z - low[1]) / (top[1] - low[1]);
            Point::new(self.midline, low[0] + share * (top[0] - low[0]), z)
        };
        let along = (at(top[1]) - at(low[1])).normalize();
        [(knee - OVERLAP_MM, top[1], half_width, "behind_the_face"), (low[1], knee, HALF_WIDTH_MM, "pterygomaxillary")]
            .map(|(from, to, half_width, name)| {
                let (a, b) = (at(from), at(to));
                let bounds = Some((Vector::x(), half_width, 0.5 * (b - a).norm()));
                let plane = BoundedPlane { point: nalgebra::center(&a, &b), normal: Vector::x().cross(&along), bounds };
                Cut::from(plane).named(name)
            })
    }

    fn teeth(&self) -> Cut {
        let back = self.tuberosity_y + OVERLAP_MM;
        let point = Point::new(self.midline, 0.5 * (self.front_y + back), self.occlusal);
        let bounds = Some((Vector::x(), HALF_WIDTH_TEETH_MM, 0.5 * (back - self.front_y)));
        Cut::from(BoundedPlane { point, normal: Vector::z(), bounds }).named("occlusal").separating()
    }
}

/// Le Fort II: from below one zygoma over the infraorbital rims and the nasofrontal suture to the other.
///
/// Landmarks: `nasion`; `orbitale_*`, the lowest point of the infraorbital rim; `zygomaxillare_*`, the lowest point of the
/// zygomaticomaxillary suture; `occlusal_plane_z_mm`.
pub(super) fn le_fort_2(landmarks: &Landmarks, bone: &Envelope) -> Result<Vec<Cut>, PlanError> {
    let back = Back::new(landmarks, bone)?;
    let names = ["zygomaxillare_left", "orbitale_left", "nasion", "orbitale_right", "zygomaxillare_right"];
    let [cheek_l, orbit_l, nasion, orbit_r, cheek_r] = names.map(|n| landmarks.point(n));
    let line = [cheek_l?, orbit_l?, nasion?, orbit_r?, cheek_r?];
    let nasion = line[2];
    for (pair, name) in line.windows(2).zip(names.windows(2)) {
        if pair[0].x - pair[1].x < MIN_STEP_MM {
            return Err(misplaced(&format!(
                "have {} {:.1} mm to the left of {}; it must lie at least {MIN_STEP_MM} mm to the left of it",
                name[0],
                pair[0].x - pair[1].x,
                name[1]
            )));
        }
    }
    if let Some((p, name)) = line.iter().zip(names).find(|(p, _)| p.z < back.occlusal + 5.0) {
        return Err(misplaced(&format!(
            "have {name} {:.1} mm above the occlusal plane; it must lie at least 5 mm above it; check both",
            p.z - back.occlusal
        )));
    }
    // Out of the buttress sideways and down, below the border of the zygoma.
    let beyond = |p: &Point, side: f64| [p.x + side * 14.0, p.z - 10.0];
    let mut points = vec![beyond(&line[0], 1.0)];
    points.extend(line.iter().map(|p| [p.x, p.z]));
    points.push(beyond(&line[4], -1.0));
    let knee = line[0].z.min(line[4].z) - 4.0;
    let half_width = (line[0].x - back.midline).max(back.midline - line[4].x) + 16.0;
    let mut cuts = vec![back.swept(&points).named("le_fort_2")];
    cuts.extend(back.slanted([nasion.y + 12.0, nasion.z + 3.0], knee, half_width));
    cuts.extend(Some(back.teeth()).filter(|c| meets(bone, c)));
    Ok(cuts)
}

/// Le Fort III: over the frontozygomatic and nasofrontal sutures; behind, through the lateral orbital walls and the arches.
///
/// Landmarks: `nasion`; `frontomalare_*`, the frontozygomatic suture at the orbit's rim; `occlusal_plane_z_mm`.
pub(super) fn le_fort_3(landmarks: &Landmarks, bone: &Envelope) -> Result<Vec<Cut>, PlanError> {
    let back = Back::new(landmarks, bone)?;
    let (nasion, left, right) =
        (landmarks.point("nasion")?, landmarks.point("frontomalare_left")?, landmarks.point("frontomalare_right")?);
    if left.x - nasion.x < 20.0 || nasion.x - right.x < 20.0 {
        return Err(misplaced(
            "must have frontomalare_left and frontomalare_right at least 20 mm to the left and right of the nasion",
        ));
    }
    let line = [
        [left.x + 20.0, left.z],
        [left.x, left.z],
        [nasion.x, nasion.z],
        [right.x, right.z],
        [right.x - 20.0, right.z],
    ];
    let top = left.z.max(right.z).max(nasion.z) + 3.0;
    let knee = back.occlusal + 0.3 * (nasion.z - back.occlusal);
    let mut cuts = vec![back.swept(&line).named("le_fort_3")];
    cuts.extend(back.slanted([nasion.y + 25.0, top], knee, HALF_WIDTH_FACE_MM));
    cuts.extend(Some(back.teeth()).filter(|c| meets(bone, c)));
    Ok(cuts)
}
