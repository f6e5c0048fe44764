//! Eyeballs: fixed bodies over which lids glide, placed by landmarks of the orbit's rim.

use std::ops::Deref;

use nalgebra::Matrix3;

use super::Anatomy;
use super::tuning::{
    GLOBE_BONE_MM, GLOBE_FROM_RIM_MM, GLOBE_HEIGHT_SHARE, GLOBE_RADIUS_MM, LATERAL_RIM_MM, LID_MM, MAX_SUNK_MM,
    ORBITS_ABOVE_ANS_MM,
};
use crate::plan::Proposal;
use prosopon_geometry::{Aabb, Implicit, Point, Vector, Warning};

/// A globe at rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Globe {
    /// Centre, LPS mm.
    pub center: Point,
    /// Radius, mm.
    pub radius_mm: f64,
}

/// A solid together with globes.
#[derive(Debug, Clone)]
pub(super) struct WithGlobes<S> {
    pub(super) solid: S,
    pub(super) globes: Vec<Globe>,
}

/// The globes that a moving segment reaches, and a warning where one that might be reached cannot be placed.
///
/// `moving` are the boxes of the segments, mm. Landmarks of the anatomy go before proposed ones. `skin` and `bone` are fields, mm.
pub(super) fn place_globes(
    anatomy: &Anatomy,
    proposal: &Proposal,
    moving: &[Aabb],
    skin: &dyn Implicit,
    bone: &dyn Implicit,
) -> (Vec<Globe>, Option<Warning>) {
    let at = |name: &str| {
        let given = anatomy.landmarks.iter().find(|(n, _)| n == name).map(|(_, p)| *p);
        given.or_else(|| proposal.points.get(name).copied()).ok_or_else(|| format!("`{name}` was not found"))
    };
    let of_side = |side: &str| {
        let (orbitale, lateral) = (at(&format!("orbitale_{side}"))?, at(&format!("frontomalare_{side}"))?);
        Globe::in_orbit(orbitale, lateral, skin, bone).map_err(|why| format!("{side}: {why}"))
    };
    let (mut globes, mut faults) = (Vec::new(), Vec::new());
    for side in ["left", "right"] {
        match of_side(side) {
            Ok(globe) => globes.extend(moving.iter().any(|part| globe.touches(part)).then_some(globe)),
            Err(why) => faults.push(why),
        }
    }
    // A fault is of no concern to an operation below the orbits.
    let top = moving.iter().map(|part| part.max.z).fold(f64::NEG_INFINITY, f64::max);
    let is_reached = at("ans").is_ok_and(|ans| top > ans.z + ORBITS_ABOVE_ANS_MM);
    (globes, (is_reached && !faults.is_empty()).then(|| not_placed(&faults.join("; "))))
}

/// Warning that globes are missing.
pub(super) fn not_placed(why: &str) -> Warning {
    let message = format!("the eyes move with the tissue around them: {why}");
    let action = "Set the landmarks `orbitale_*` and `frontomalare_*`, or build the mesh with `globes: false`.";
    Warning::check("globes-not-placed", message).act(action)
}

/// Note where globes were placed; `None` without one.
pub(super) fn placed(globes: &[Globe]) -> Option<Warning> {
    let first = globes.first()?;
    let places: Vec<String> =
        globes.iter().map(|g| format!("({:.0}, {:.0}, {:.0})", g.center.x, g.center.y, g.center.z)).collect();
    let (radius, places) = (first.radius_mm, places.join(" and "));
    Some(Warning::info("globes-placed", format!("globes of {radius} mm radius stay at {places} mm")))
}

impl Globe {
    /// The globe in the orbit with these landmarks; an error says which of them cannot be right.
    fn in_orbit(orbitale: Point, lateral: Point, skin: &dyn Implicit, bone: &dyn Implicit) -> Result<Self, String> {
        let rise = lateral - orbitale;
        let [least, most] = LATERAL_RIM_MM;
        let is_near = (0.0..=most).contains(&rise.xy().norm());
        if !(is_near && (least..=most).contains(&rise.z)) {
            let [aside, back, up] = [rise.x.abs(), rise.y, rise.z];
            return Err(format!(
                "`frontomalare` lies {up:.0} mm above, {aside:.0} mm beside and {back:.0} mm behind `orbitale`"
            ));
        }
        // The middle lies medial of the lateral rim; left is +x.
        let medial = -GLOBE_FROM_RIM_MM * rise.x.signum();
        let z = orbitale.z + GLOBE_HEIGHT_SHARE * rise.z;
        let mut globe = Self { center: Point::new(lateral.x + medial, lateral.y, z), radius_mm: GLOBE_RADIUS_MM };
        // A lid covers it: it lies deeper where the skin is nearer.
        let sunk = skin.value(&globe.center) + globe.radius_mm + LID_MM;
        if sunk > MAX_SUNK_MM {
            return Err(format!("it would reach {:.0} mm out of the skin", sunk - LID_MM));
        }
        globe.center.y += sunk.max(0.0);
        let room = bone.value(&globe.center);
        if room < globe.radius_mm - GLOBE_BONE_MM {
            return Err(format!("bone lies {room:.0} mm from its centre"));
        }
        Ok(globe)
    }

    fn touches(&self, region: &Aabb) -> bool {
        let nearest = self.center.sup(&region.min).inf(&region.max);
        (nearest - self.center).norm() <= self.radius_mm
    }

    /// Signed distance from the globe's surface, mm.
    fn distance(&self, p: &Point) -> f64 {
        (p - self.center).norm() - self.radius_mm
    }
}

impl<S: Deref<Target: Implicit>> WithGlobes<S> {
    /// Whether a globe lies nearer to `p` than the solid.
    pub(super) fn is_globe_nearest(&self, p: &Point) -> bool {
        self.nearest_globe(p).is_some_and(|(distance, _)| distance < self.solid.value(p))
    }

    fn nearest_globe(&self, p: &Point) -> Option<(f64, &Globe)> {
        self.globes.iter().map(|g| (g.distance(p), g)).min_by(|a, b| a.0.total_cmp(&b.0))
    }
}

impl<S: Deref<Target: Implicit> + Sync> Implicit for WithGlobes<S> {
    fn value(&self, p: &Point) -> f64 {
        let solid = self.solid.value(p);
        self.nearest_globe(p).map_or(solid, |(distance, _)| distance.min(solid))
    }

    fn value_gradient(&self, p: &Point) -> (f64, Vector) {
        let (value, gradient) = self.solid.value_gradient(p);
        match self.nearest_globe(p) {
            Some((distance, globe)) if distance < value => {
                (distance, (p - globe.center).try_normalize(0.0).unwrap_or_else(Vector::zeros))
            }
            Some(_) | None => (value, gradient),
        }
    }

    fn hessian(&self, p: &Point) -> Matrix3<f64> {
        match self.nearest_globe(p) {
            Some((distance, globe)) if distance < self.solid.value(p) => {
                let from = p - globe.center;
                let normal = from.try_normalize(0.0).unwrap_or_else(Vector::zeros);
                (Matrix3::identity() - normal * normal.transpose()) / from.norm().max(f64::MIN_POSITIVE)
            }
            Some(_) | None => self.solid.hessian(p),
        }
    }
}

#[cfg(test)]
mod tests;
