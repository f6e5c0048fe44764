//! What a prediction means in a surgeon's terms: named points, soft-to-hard ratios, profile, angles, gap of the lips.

mod lips;
mod off_surface;
mod section;
mod soft_points;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;

use super::EvaluateError;
use super::consistency::{Tissue, known};
use super::distance::Surface;
use super::nearest_bone::{BoneAt, MovedBone};
use super::tuning::{INTO_BONE_MM, PROFILE_STEP_MM, ROOTWARD_MM, STILL_BONE_MM};
use prosopon_geometry::control::Control;
use prosopon_geometry::{Motion, Point, TriMesh, Vector};
use section::{Section, SurfacePoint};
use soft_points::{COLUMELLA, SOFT, soft_points};

/// Inputs of [`clinical`].
#[derive(Debug, Clone, Copy)]
pub struct ClinicalInput<'a> {
    /// Skin at rest, LPS mm.
    pub rest: &'a TriMesh,
    /// The same skin after the operation: the same triangles.
    pub moved: &'a TriMesh,
    /// Landmarks that were set, at rest, LPS mm.
    pub given: &'a [(String, Point)],
    /// Landmarks that were proposed; used where none is given.
    pub proposed: &'a BTreeMap<String, Point>,
    /// x of the midsagittal plane, mm.
    pub midline_x_mm: f64,
    /// All segments of bone; empty when they are not known.
    pub bones: &'a [MovedBone<'a>],
}

/// Movement of a named point.
#[derive(Debug, Clone, PartialEq)]
pub struct NamedPoint {
    /// Name, as landmarks are named.
    pub name: &'static str,
    /// Position at rest, LPS mm.
    pub rest: Point,
    /// Position after the operation, LPS mm.
    pub moved: Point,
    /// Whether the point was given; otherwise it was found on the profile or proposed.
    pub is_given: bool,
}

impl NamedPoint {
    /// Movement, LPS mm.
    #[must_use]
    pub fn movement(&self) -> Vector {
        self.moved - self.rest
    }
}

/// Why there is no soft-to-hard ratio.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum NoRatio {
    /// The soft point is not known.
    NoSoftPoint,
    /// None of its hard points is known, or the bone is not known.
    NoHardPoint,
    /// The hard point hardly moves, mm.
    Still(f64),
}

/// Movement of a soft point in proportion to its hard point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SoftToHard {
    /// Name of the soft point.
    pub soft: &'static str,
    /// Name of the hard point; `None` when none of those below it is known.
    pub hard: Option<&'static str>,
    /// `u_soft · u_hard / |u_hard|²`: the soft movement along the hard movement, as a share of it.
    pub ratio: Result<f64, NoRatio>,
}

/// A piece of the profile, as (y, z) in LPS mm: the same points of skin before and after.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ProfilePiece {
    /// At rest, from above downwards.
    pub before: Vec<[f64; 2]>,
    /// After the operation.
    pub after: Vec<[f64; 2]>,
}

/// A value before and after the operation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BeforeAfter {
    /// At rest.
    pub before: f64,
    /// After the operation.
    pub after: f64,
}

/// The answers in a surgeon's terms, in the frame of the inputs: x to the left, y to the back, z up.
#[derive(Debug, Clone, PartialEq)]
pub struct Clinical {
    /// x of the midsagittal plane, mm.
    pub midline_x_mm: f64,
    /// Soft points that are known, from above downwards.
    pub soft: Vec<NamedPoint>,
    /// Hard points that are known, from above downwards; empty when the bone is not known.
    pub hard: Vec<NamedPoint>,
    /// Ratio of each soft point.
    pub ratios: Vec<SoftToHard>,
    /// The skin's line near the midline; in two pieces where the lips are parted in the mesh.
    pub profile: Vec<ProfilePiece>,
    /// Angle at subnasale between columella and upper lip, in the sagittal plane, degrees.
    pub nasolabial_deg: Option<BeforeAfter>,
    /// Angle at sublabiale between lower lip and chin, in the sagittal plane, degrees.
    pub labiomental_deg: Option<BeforeAfter>,
    /// Height of the upper lip's margin above the lower one's, mm; 0 where they touch.
    pub lip_gap_mm: Option<BeforeAfter>,
    /// Whether both margins are one point of skin, so that the lips cannot part.
    pub is_mouth_sealed: bool,
    /// Given points that lie too far from their surface to be measured, with their distance, mm.
    pub left_out: Vec<(&'static str, f64)>,
}

/// Hard points from above downwards, each with the way into its own bone, LPS mm.
const HARD: [(&str, [f64; 3]); 7] = [
    ("ans", [0.0, INTO_BONE_MM, -INTO_BONE_MM]),
    ("a_point", [0.0, INTO_BONE_MM, 0.0]),
    ("incisor_upper", [0.0, 0.0, ROOTWARD_MM]),
    ("incisor_lower", [0.0, 0.0, -ROOTWARD_MM]),
    ("b_point", [0.0, INTO_BONE_MM, 0.0]),
    ("pogonion", [0.0, INTO_BONE_MM, 0.0]),
    ("menton", [0.0, 0.0, INTO_BONE_MM]),
];

/// Hard points under each soft point; the first that is known counts.
fn hard_of(soft: &str) -> &'static [&'static str] {
    match soft {
        "pronasale" | "subnasale" => &["a_point", "ans", "incisor_upper"],
        "labrale_superius" | "stomion_superius" => &["incisor_upper", "a_point", "ans"],
        "stomion_inferius" | "labrale_inferius" => &["incisor_lower", "b_point"],
        "sublabiale" => &["b_point", "pogonion"],
        "soft_pogonion" => &["pogonion", "menton"],
        "soft_menton" => &["menton", "pogonion"],
        _ => &[],
    }
}

/// Measures a prediction in a surgeon's terms.
///
/// A point of skin is followed as a point of the surface: it is not looked for again on the deformed skin. A given soft point
/// is the nearest point of the skin; others are found on the profile, the skin's line in the midsagittal plane or up to 3 mm
/// beside it where that line runs into a nostril. A hard point moves with the segment in which it lies. A hard point that moves
/// by less than 1 mm gives no ratio. Given points farther from skin or bone than their accuracy and 6 mm are left out.
///
/// # Errors
/// [`EvaluateError::Input`] when the two skins have other triangles or a surface is not usable; [`EvaluateError::Cancelled`].
pub fn clinical(input: &ClinicalInput<'_>, control: &Control) -> Result<Clinical, EvaluateError> {
    if input.rest.triangles() != input.moved.triangles() {
        let detail = "the skins before and after the operation must have the same triangles".to_owned();
        return Err(EvaluateError::Input { detail });
    }
    let section = Section::near(input.rest, input.midline_x_mm);
    control.check()?;
    let mut left_out = Vec::new();
    let hard = hard(input, &mut left_out)?;
    control.check()?;
    let soft = soft(input, &section, &mut left_out)?;
    let point = |points: &[NamedPoint], name: &str| points.iter().find(|p| p.name == name).cloned();
    let ratios = SOFT.map(|name| ratio(name, point(&soft, name).as_ref(), &hard)).to_vec();
    let angle = |names: [&str; 3]| {
        let [a, b, c] = names.map(|name| point(&soft, name));
        let (a, b, c) = (a?, b?, c?);
        let before = angle_deg(&a.rest, &b.rest, &c.rest)?;
        Some(BeforeAfter { before, after: angle_deg(&a.moved, &b.moved, &c.moved)? })
    };
    let margins = point(&soft, "stomion_superius").zip(point(&soft, "stomion_inferius"));
    let gap = |upper: &Point, lower: &Point| (upper.z - lower.z).max(0.0);
    Ok(Clinical {
        midline_x_mm: input.midline_x_mm,
        nasolabial_deg: angle([COLUMELLA, "subnasale", "labrale_superius"]),
        labiomental_deg: angle(["labrale_inferius", "sublabiale", "soft_pogonion"]),
        lip_gap_mm: margins.as_ref().map(|(upper, lower)| BeforeAfter {
            before: gap(&upper.rest, &lower.rest),
            after: gap(&upper.moved, &lower.moved),
        }),
        is_mouth_sealed: section.breaks.is_empty() && margins.is_some_and(|(upper, lower)| upper.rest == lower.rest),
        profile: profile(&section, input.moved),
        soft,
        hard,
        ratios,
        left_out,
    })
}

/// The soft points with the columella.
fn soft(
    input: &ClinicalInput<'_>,
    section: &Section,
    left_out: &mut Vec<(&'static str, f64)>,
) -> Result<Vec<NamedPoint>, EvaluateError> {
    let mut given: BTreeMap<&str, Point> = input.given.iter().map(|(name, p)| (name.as_str(), *p)).collect();
    given.retain(|name, _| left_out.iter().all(|(left, _)| left != name));
    let surface = if given.is_empty() { None } else { Some(Surface::new(input.rest)?) };
    let mut off: Vec<&'static str> = Vec::new();
    for name in SOFT.into_iter().chain([COLUMELLA, "stomion"]) {
        let Some((p, surface)) = given.get(name).zip(surface.as_ref()) else { continue };
        let mm = surface.nearest(p).signed.abs();
        if is_off(name, Tissue::Skin, mm) {
            left_out.push((name, mm));
            off.push(name);
            given.remove(name);
        }
    }
    if let Some(stomion) = given.get("stomion").copied() {
        given.entry("stomion_superius").or_insert(stomion);
        given.entry("stomion_inferius").or_insert(stomion);
    }
    let mut known = given.clone();
    for name in ["pronasale", "soft_pogonion", "menton"] {
        if let Some(p) = input.proposed.get(name) {
            known.entry(name).or_insert(*p);
        }
    }
    let found = soft_points(section, &known);
    let is_left_out = |name: &str| off.contains(&name) || (name.starts_with("stomion") && off.contains(&"stomion"));
    let of = |name: &'static str| {
        if is_left_out(name) && !given.contains_key(name) {
            return None;
        }
        let on_skin = given.get(name).zip(surface.as_ref()).map(|(p, surface)| {
            let hit = surface.nearest(p);
            SurfacePoint::in_triangle(input.rest, hit.triangle, &hit.point)
        });
        let point = on_skin.or_else(|| Some(section.points[*found.get(name)?]))?;
        let (rest, moved) = (point.on(input.rest), point.on(input.moved));
        Some(NamedPoint { name, rest, moved, is_given: on_skin.is_some() })
    };
    let [first, others @ ..] = SOFT;
    Ok([first, COLUMELLA].into_iter().chain(others).filter_map(of).collect())
}

/// Whether the given point `name` lies too far from its surface.
fn is_off(name: &str, tissue: Tissue, mm: f64) -> bool {
    known(name).is_some_and(|known| known.tissue == tissue && mm > known.limit_mm)
}

fn hard(input: &ClinicalInput<'_>, left_out: &mut Vec<(&'static str, f64)>) -> Result<Vec<NamedPoint>, EvaluateError> {
    let bones = BoneAt::new(input.bones)?;
    let mut of = |(name, inward): (&'static str, [f64; 3])| {
        let given = input.given.iter().find(|(n, _)| n == name).map(|(_, p)| *p);
        let rest = given.or_else(|| input.proposed.get(name).copied())?;
        let (_, depth) = bones.at(&rest)?;
        if given.is_some() && is_off(name, Tissue::Bone, depth) {
            left_out.push((name, depth));
            return None;
        }
        let (motion, _): (Motion, f64) = bones.at(&(rest + Vector::from(inward)))?;
        Some(NamedPoint { name, rest, moved: motion * rest, is_given: given.is_some() })
    };
    Ok(HARD.into_iter().filter_map(&mut of).collect())
}

fn ratio(name: &'static str, soft: Option<&NamedPoint>, hard: &[NamedPoint]) -> SoftToHard {
    let under = hard_of(name).iter().find_map(|name| hard.iter().find(|p| p.name == *name));
    let ratio = match (soft, under) {
        (None, _) => Err(NoRatio::NoSoftPoint),
        (_, None) => Err(NoRatio::NoHardPoint),
        (Some(soft), Some(hard)) => {
            let bone = hard.movement();
            if bone.norm() < STILL_BONE_MM {
                Err(NoRatio::Still(bone.norm()))
            } else {
                Ok(soft.movement().dot(&bone) / bone.norm_squared())
            }
        }
    };
    SoftToHard { soft: name, hard: under.map(|p| p.name), ratio }
}

/// Angle at `b` in the sagittal plane, degrees; `None` when two points coincide there.
fn angle_deg(a: &Point, b: &Point, c: &Point) -> Option<f64> {
    let flat = |v: Vector| Vector::new(0.0, v.y, v.z);
    let (u, v) = (flat(a - b), flat(c - b));
    (u.norm() > 0.0 && v.norm() > 0.0).then(|| u.angle(&v).to_degrees())
}

fn profile(section: &Section, moved: &TriMesh) -> Vec<ProfilePiece> {
    let mut bounds = vec![0];
    bounds.extend(section.breaks.iter().copied());
    bounds.push(section.points.len());
    let piece = |ends: &[usize]| {
        let mut piece = ProfilePiece::default();
        let (from, to) = (ends[0], ends[1]);
        let mut last: Option<Point> = None;
        for i in from..to {
            let p = section.rest[i];
            if i + 1 < to && last.is_some_and(|last| (p - last).norm() < PROFILE_STEP_MM) {
                continue;
            }
            let after = section.points[i].on(moved);
            piece.before.push([p.y, p.z]);
            piece.after.push([after.y, after.z]);
            last = Some(p);
        }
        piece
    };
    bounds.windows(2).map(piece).filter(|piece| piece.before.len() > 1).collect()
}
