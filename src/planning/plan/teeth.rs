//! Which bone carries teeth, and where they are on cut bone.

use super::arch::DentalArch;
use super::osteotomy::{Osteotomy, Segment};
use super::shape::{CutShape, Purpose};
use super::tuning::{ARCH_DEPTH_MM, CROWN_MM, TOOTHED_MM2};
use super::{Landmarks, Proposal};
use prosopon_geometry::{Point, TriMesh, Vector};

/// Teeth that a segment carries.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Teeth {
    /// Those of the upper jaw.
    Upper,
    /// Those of the lower jaw.
    Lower,
}

impl DentalArch {
    /// The arch of a head, from a proposal.
    #[must_use]
    pub fn proposed(skull: &TriMesh, proposal: &Proposal) -> Option<Self> {
        let spine = proposal.points.get("ans")?;
        let (_, up) = proposal.le_fort_1_plane?;
        let below = Point::new(proposal.midline_x_mm, spine.y, proposal.occlusal_z_mm?);
        Self::on_plane([skull], proposal.midline_x_mm, &below, &up)
    }

    /// The arch of cut bone: on the occlusal plane of the landmarks, or else on that of a separation between the rows of teeth.
    ///
    /// Without a midline the middle of the skull's bounding box is used.
    pub(super) fn of_segments(osteotomy: &Osteotomy, landmarks: &Landmarks) -> Option<Self> {
        let middle = osteotomy.segments.first().map_or(0.0, |s| s.surface.bounds().center().x);
        let midline = landmarks.midline_x_mm.unwrap_or(middle);
        let surfaces = || osteotomy.segments.iter().map(|s| &s.surface);
        let tilted = landmarks.le_fort_1_plane.map(|(_, up)| up);
        if let Some(z) = landmarks.occlusal_z_mm {
            // The landmark is the plane's height below the anterior nasal spine.
            let y = landmarks
                .points
                .get("ans")
                .map_or_else(|| surfaces().next().map_or(0.0, |s| s.bounds().min.y), |p| p.y);
            return Self::on_plane(surfaces(), midline, &Point::new(midline, y, z), &tilted.unwrap_or(Vector::z()));
        }
        // Of two levels of a tilted plane the first one lies between the front teeth.
        osteotomy.cuts.iter().filter(|c| c.purpose == Purpose::Separation).find_map(|c| match &c.shape {
            CutShape::Plane(plane) if plane.normal.z.abs() > 0.7 => {
                let up = if plane.normal.z < 0.0 { -plane.normal } else { plane.normal };
                Self::on_plane(surfaces(), midline, &plane.point, &up)
            }
            CutShape::Plane(_) | CutShape::Polyline { .. } | CutShape::Surface(_) | CutShape::FreePart(_) => None,
        })
    }

    /// The teeth that a segment carries, from the area of its surface on both sides of the occlusal plane.
    #[must_use]
    pub fn teeth_of(&self, segment: &Segment) -> Option<Teeth> {
        let (mut above, mut below) = (0.0, 0.0);
        for t in 0..segment.surface.triangles().len() {
            let [a, b, c] = segment.surface.corners(t);
            let centre = Point::from((a.coords + b.coords + c.coords) / 3.0);
            if self.distance(&centre, CROWN_MM) > 0.0 || self.behind(&centre) > ARCH_DEPTH_MM - 10.0 {
                continue;
            }
            let area = 0.5 * segment.surface.scaled_normal(t).norm();
            *if self.height(&centre) > 0.0 { &mut above } else { &mut below } += area;
        }
        if above.max(below) < TOOTHED_MM2 {
            None
        } else {
            Some(if above > below { Teeth::Upper } else { Teeth::Lower })
        }
    }
}
