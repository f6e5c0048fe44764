//! Bone cut into segments.

use super::arch::DentalArch;
use super::shape::{Cut, Purpose};
use prosopon_geometry::{Motion, Point, TriMesh, Warning};

/// A piece of bone.
#[derive(Debug, Clone, PartialEq)]
pub struct Segment {
    /// Number: 0 is the skull, which is fixed; the others follow by falling volume.
    pub id: u32,
    /// Suggested name, for example `maxilla`; [`super::name_segments`] sets it.
    pub name: Option<String>,
    /// Closed surface with caps, LPS mm, at rest.
    pub surface: TriMesh,
    /// Volume, mm³.
    pub volume_mm3: f64,
    /// Area, mm².
    pub area_mm2: f64,
    /// Centroid of the solid, LPS mm, at rest.
    pub centroid: Point,
    /// Indices of the cuts that bound it, ascending.
    pub bounded_by: Vec<usize>,
}

impl Segment {
    /// Name of the segment in messages, for example `maxilla`; without a name, `segment` and its number.
    #[must_use]
    pub fn label(&self) -> String {
        self.name.clone().unwrap_or_else(|| format!("segment {}", self.id))
    }
}

/// Bone cut into segments.
#[derive(Debug, Clone, PartialEq)]
pub struct Osteotomy {
    /// The cuts.
    pub cuts: Vec<Cut>,
    /// The segments, ascending by number.
    pub segments: Vec<Segment>,
    /// Volume of the bone before it was cut, mm³.
    pub bone_mm3: f64,
    /// Volume of the fragments that touch no segment and were dropped, mm³.
    pub dropped_mm3: f64,
    /// What was dropped or should be checked.
    pub warnings: Vec<Warning>,
    /// Where the teeth are; [`super::name_segments`] sets it where the landmarks or the cuts show it.
    pub arch: Option<DentalArch>,
}

impl Osteotomy {
    /// The osteotomy moved in space, with the places in its warnings.
    #[must_use]
    pub fn moved(&self, motion: &Motion) -> Self {
        let segment =
            |s: &Segment| Segment { surface: s.surface.moved(motion), centroid: motion * s.centroid, ..s.clone() };
        Self {
            cuts: self.cuts.iter().map(|cut| cut.moved(motion)).collect(),
            segments: self.segments.iter().map(segment).collect(),
            warnings: self.warnings.iter().map(|w| w.clone().moved(motion)).collect(),
            arch: self.arch.map(|arch| DentalArch { front: motion * arch.front, up: motion * arch.up }),
            ..*self
        }
    }

    /// Whether bone was sawn between two segments; a separation of bones that touch in the image is no saw line.
    #[must_use]
    pub fn is_sawn_between(&self, a: &Segment, b: &Segment) -> bool {
        let sawn = |cut: &usize| self.cuts.get(*cut).is_some_and(|c| c.purpose == Purpose::Osteotomy);
        a.bounded_by.iter().any(|cut| b.bounded_by.contains(cut) && sawn(cut))
    }

    /// Number of the segment that contains `p` (LPS mm), else of the one with the nearest vertex.
    ///
    /// `None` when there are no segments.
    #[must_use]
    pub fn segment_near(&self, p: &Point) -> Option<u32> {
        let nearest =
            |s: &Segment| s.surface.positions().iter().map(|q| (q - p).norm_squared()).fold(f64::MAX, f64::min);
        let inside = self.segments.iter().find(|s| contains(&s.surface, p));
        let best = || self.segments.iter().min_by(|a, b| nearest(a).total_cmp(&nearest(b)));
        inside.or_else(best).map(|s| s.id)
    }
}

/// Whether `p` lies inside a closed surface: its solid angles then add up to 4π (Van Oosterom & Strackee 1983).
fn contains(surface: &TriMesh, p: &Point) -> bool {
    if !surface.bounds().contains(p) {
        return false;
    }
    let mut half_angle = 0.0;
    for t in 0..surface.triangles().len() {
        let [a, b, c] = surface.corners(t).map(|q| q - p);
        let (la, lb, lc) = (a.norm(), b.norm(), c.norm());
        let below = la * lb * lc + a.dot(&b) * lc + b.dot(&c) * la + c.dot(&a) * lb;
        half_angle += a.dot(&b.cross(&c)).atan2(below);
    }
    half_angle > std::f64::consts::PI
}
