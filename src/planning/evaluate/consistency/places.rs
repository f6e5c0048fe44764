//! Distances of landmarks from the surfaces on which they belong.

use super::known::{Known, Tissue};
use super::tuning::{MOST_NAMED, OUTSIDE_MM};
use crate::evaluate::EvaluateError;
use crate::evaluate::distance::Surface;
use prosopon_geometry::{Point, TriMesh};

/// A landmark that someone set and whose tissue is known.
#[derive(Debug, Clone, Copy)]
pub(super) struct Judged<'a> {
    pub(super) name: &'a str,
    pub(super) point: Point,
    pub(super) known: Known,
}

/// The surfaces of a session, as far as it has them.
pub(super) struct Surfaces {
    skin: Option<Surface>,
    bone: Option<Surface>,
}

/// A landmark with its distance.
#[derive(Debug, Clone, Copy)]
pub(super) struct Place<'a> {
    pub(super) judged: Judged<'a>,
    pub(super) distance: Distance,
}

/// Distance of a point from where it belongs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Distance {
    /// Distance, mm; for points inside the head, how far they lie outside the skin.
    pub(super) mm: f64,
    /// From what, for messages.
    from: &'static str,
    /// Closest point of that surface.
    pub(super) closest: Point,
    limit_mm: f64,
}

impl Distance {
    pub(super) fn is_off(&self) -> bool {
        self.mm > self.limit_mm
    }
}

impl Surfaces {
    pub(super) fn new(skin: Option<&TriMesh>, bone: Option<&TriMesh>) -> Result<Self, EvaluateError> {
        Ok(Self { skin: skin.map(Surface::new).transpose()?, bone: bone.map(Surface::new).transpose()? })
    }

    /// Distance of `p`, called as in `judged`, from its surface; `None` when the session lacks that surface.
    pub(super) fn distance(&self, known: &Known, p: &Point) -> Option<Distance> {
        let limit_mm = known.limit_mm;
        let on = |surface: &Surface, from| {
            let hit = surface.nearest(p);
            Distance { mm: hit.signed.abs(), from, closest: hit.point, limit_mm }
        };
        match (known.tissue, &self.skin, &self.bone) {
            (Tissue::Skin, Some(skin), _) => Some(on(skin, "from the skin")),
            (Tissue::Bone, _, Some(bone)) => Some(on(bone, "from the bone")),
            (Tissue::Inside | Tissue::Bone, Some(skin), _) => {
                let hit = skin.nearest(p);
                let outside = if hit.on_border { 0.0 } else { hit.signed.max(0.0) };
                Some(Distance { mm: outside, from: "outside the skin", closest: hit.point, limit_mm: OUTSIDE_MM })
            }
            (Tissue::Skin, None, _) | (Tissue::Inside | Tissue::Bone, None, _) => None,
        }
    }

    /// All landmarks whose surface is there.
    pub(super) fn places<'a>(&self, judged: &[Judged<'a>]) -> Vec<Place<'a>> {
        let place = |j: &Judged<'a>| Some(Place { judged: *j, distance: self.distance(&j.known, &j.point)? });
        judged.iter().filter_map(place).collect()
    }
}

/// Names and distances for a message, the farthest first.
pub(super) fn listed(places: &[&Place<'_>]) -> String {
    let mut places: Vec<&&Place<'_>> = places.iter().collect();
    places.sort_by(|a, b| b.distance.mm.total_cmp(&a.distance.mm));
    let one = |p: &&&Place<'_>| format!("{} {:.0} mm {}", p.judged.name, p.distance.mm, p.distance.from);
    let named: Vec<String> = places.iter().take(MOST_NAMED).map(one).collect();
    let more = places.len().saturating_sub(MOST_NAMED);
    if more > 0 { format!("{} and {more} more", named.join(", ")) } else { named.join(", ") }
}
