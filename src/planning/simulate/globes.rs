//! Eyeballs: fixed bodies over which lids glide and to which tissue behind them is tied, placed by landmarks of the orbit's rim.

use std::ops::Deref;

use nalgebra::Matrix3;

use super::Anatomy;
use super::tuning::{
    GLOBE_BONE_MM, GLOBE_FROM_RIM_MM, GLOBE_HEIGHT_SHARE, GLOBE_RADIUS_MM, LATERAL_RIM_MM, LID_MM, MAX_SUNK_MM,
    ORBITS_ABOVE_ANS_MM, UNEVEN_MM,
};
use crate::plan::Proposal;
use prosopon_geometry::{Aabb, Implicit, Point, Severity, Vector, Warning};

/// A globe at rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Globe {
    /// Centre, LPS mm.
    pub center: Point,
    /// Radius, mm.
    pub radius_mm: f64,
}

prosopon_geometry::flat!(Globe { center, radius_mm });

/// A solid together with globes.
#[derive(Debug, Clone)]
pub(super) struct WithGlobes<S> {
    pub(super) solid: S,
    pub(super) globes: Vec<Globe>,
}

/// Where bone moves, for the choice of globes.
#[derive(Debug, Clone)]
pub(super) struct Reach {
    /// Boxes around what can move, mm: segments, or the whole region where the cuts are not known.
    pub(super) parts: Vec<Aabb>,
    /// Region of the mesh, mm.
    pub(super) region: Aabb,
    /// What is known of the cuts.
    pub(super) known: Known,
}

/// What is known of the cuts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Known {
    /// Nothing: a plan may move the orbits or not.
    Nothing,
    /// The segments.
    Segments,
    /// The segments, and by the teeth that they come near the orbits.
    NearOrbits,
}

/// The globes that moving bone can reach, with notes and warnings.
///
/// Landmarks of the anatomy go before proposed ones. `skin` and `bone` are fields, mm.
pub(super) fn place_globes(
    anatomy: &Anatomy,
    proposal: &Proposal,
    reach: &Reach,
    skin: &dyn Implicit,
    bone: &dyn Implicit,
) -> (Vec<Globe>, Vec<Warning>) {
    let given = |name: &str| anatomy.landmarks.iter().find(|(n, _)| n == name).map(|(_, p)| *p);
    let at = |name: &str| {
        given(name).or_else(|| proposal.points.get(name).copied()).ok_or_else(|| format!("`{name}` was not found"))
    };
    let (mut globes, mut faults, mut proposed) = (Vec::new(), Vec::new(), Vec::new());
    for side in [Side::Left, Side::Right] {
        let names = ["orbitale", "frontomalare"].map(|name| format!("{name}_{}", side.name()));
        let [orbitale, lateral] = [at(&names[0]), at(&names[1])];
        let found = orbitale.and_then(|orbitale| Globe::in_orbit(side, [orbitale, lateral?], skin, bone));
        match found {
            Ok(globe) if globe.touches(&reach.region) && reach.parts.iter().any(|part| globe.touches(part)) => {
                globes.push(globe);
                proposed.extend(names.into_iter().filter(|name| given(name).is_none()));
            }
            Ok(_) => {}
            Err(why) => faults.push(why),
        }
    }
    if let [left, right] = globes.as_slice() {
        let apart = (left.center - right.center).norm();
        if apart < left.radius_mm + right.radius_mm {
            faults.push(format!("the centres of both would lie {apart:.0} mm apart"));
            globes.clear();
        }
    }
    let mut warnings: Vec<Warning> = placed(&globes, &proposed).into_iter().collect();
    warnings.extend(uneven(&globes));
    // A fault is of no concern to an operation below the orbits.
    let top = reach.parts.iter().map(|part| part.max.z).fold(f64::NEG_INFINITY, f64::max);
    let is_high = at("ans").is_ok_and(|ans| top > ans.z + ORBITS_ABOVE_ANS_MM);
    if !faults.is_empty() && (is_high || reach.known == Known::NearOrbits) {
        let warning = not_placed(&faults.join("; "));
        warnings.push(if reach.known == Known::Nothing {
            Warning { severity: Severity::Info, ..warning }
        } else {
            warning
        });
    }
    (globes, warnings)
}

/// Warning that globes are missing.
pub(super) fn not_placed(why: &str) -> Warning {
    let message = format!("an eye without a globe moves with the tissue around it: {why}");
    let action = "Set the landmarks `orbitale_*` and `frontomalare_*`, or build the mesh with `globes: false`.";
    Warning::check("globes-not-placed", message).act(action)
}

/// Note where globes were placed, by which `proposed` landmarks; `None` without one.
fn placed(globes: &[Globe], proposed: &[String]) -> Option<Warning> {
    let first = globes.first()?;
    let places: Vec<String> =
        globes.iter().map(|g| format!("({:.0}, {:.0}, {:.0})", g.center.x, g.center.y, g.center.z)).collect();
    let (radius, places) = (first.radius_mm, places.join(" and "));
    let message = format!("globes of {radius} mm radius stay at {places} mm");
    Some(if proposed.is_empty() {
        Warning::info("globes-placed", message)
    } else {
        Warning::info("globes-placed", format!("{message}, by proposed landmarks ({})", proposed.join(", ")))
            .act("Confirm these landmarks.")
    })
}

/// Warning that one globe lies much higher or farther back than the other.
fn uneven(globes: &[Globe]) -> Option<Warning> {
    let [left, right] = globes else { return None };
    let [_, back, up] = (left.center - right.center).map(f64::abs).into();
    (up.max(back) > UNEVEN_MM).then(|| {
        let message = format!(
            "one globe lies {up:.0} mm higher and {back:.0} mm farther back than the other, which faces rarely show"
        );
        Warning::check("globes-uneven", message)
            .act("Check the landmarks `orbitale_*` and `frontomalare_*` of both sides.")
    })
}

/// Side of the patient.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Side {
    Left,
    Right,
}

impl Side {
    fn name(self) -> &'static str {
        match self {
            Self::Left => "left",
            Self::Right => "right",
        }
    }

    /// Sign of x away from the midline, LPS.
    fn lateral(self) -> f64 {
        match self {
            Self::Left => 1.0,
            Self::Right => -1.0,
        }
    }
}

impl Globe {
    /// The globe in the orbit of this side, with its landmarks `orbitale` and `frontomalare`; an error says which cannot be right.
    fn in_orbit(
        side: Side,
        [orbitale, lateral]: [Point; 2],
        skin: &dyn Implicit,
        bone: &dyn Implicit,
    ) -> Result<Self, String> {
        let rise = lateral - orbitale;
        let ([least, most], name) = (LATERAL_RIM_MM, side.name());
        let (aside, back, up) = (side.lateral() * rise.x, rise.y, rise.z);
        let is_beside = (0.0..=most).contains(&aside) && back.abs() <= most;
        if !(is_beside && (least..=most).contains(&up)) {
            return Err(format!(
                "`frontomalare_{name}` lies {up:.1} mm above, {aside:.1} mm to the {name} of and {back:.1} mm behind \
                 `orbitale_{name}`; expected are {least} to {most} mm above and 0 to {most} mm to the {name}"
            ));
        }
        let z = orbitale.z + GLOBE_HEIGHT_SHARE * up;
        let x = lateral.x - side.lateral() * GLOBE_FROM_RIM_MM;
        let mut globe = Self { center: Point::new(x, lateral.y, z), radius_mm: GLOBE_RADIUS_MM };
        // A lid covers it: it lies deeper where the skin is nearer.
        let sunk = skin.value(&globe.center) + globe.radius_mm + LID_MM;
        if sunk > MAX_SUNK_MM {
            return Err(format!("the {name} globe would reach {:.0} mm out of the skin", sunk - LID_MM));
        }
        globe.center.y += sunk.max(0.0);
        let room = bone.value(&globe.center);
        if room < globe.radius_mm - GLOBE_BONE_MM {
            return Err(format!("bone lies {room:.0} mm from the centre of the {name} globe"));
        }
        Ok(globe)
    }

    fn touches(&self, region: &Aabb) -> bool {
        let nearest = self.center.sup(&region.min).inf(&region.max);
        (nearest - self.center).norm() <= self.radius_mm
    }

    /// Whether tissue at `p` on the globe glides, as lids do. Behind its equator muscles and their sheath hold the tissue.
    pub(super) fn glides_at(&self, p: &Point) -> bool {
        p.y < self.center.y
    }

    /// Signed distance from the globe's surface, mm.
    pub(super) fn distance(&self, p: &Point) -> f64 {
        (p - self.center).norm() - self.radius_mm
    }
}

impl<S: Deref<Target: Implicit>> WithGlobes<S> {
    /// The globe that is nearer to `p` than the solid.
    pub(super) fn globe_before_solid(&self, p: &Point) -> Option<&Globe> {
        let (distance, globe) = self.nearest_globe(p)?;
        (distance < self.solid.value(p)).then_some(globe)
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
