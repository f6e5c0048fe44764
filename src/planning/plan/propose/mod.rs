//! Landmarks proposed from the surfaces of skin and bone.

mod accuracy;
mod by_proportions;
mod ear;
mod jaws;
mod midline;
mod orbit;
mod profile;
mod ramus;
mod tuning;
mod voxels;

use std::collections::BTreeMap;

use super::Landmarks;
pub(crate) use accuracy::measured_accuracy_mm;
pub(super) use by_proportions::propose_by_proportions;
use jaws::{Occlusion, incisal_edge, lower_incisal_edge, nasal_aperture, occlusion};
use midline::midline;
use profile::Profile;
use prosopon_geometry::{Motion, Point, TriMesh, Vector};
use ramus::Jaw;
use tuning::{ABOVE_SPINE_MM, ALVEOLUS_MM, LOWER_CROWN_MM};
use voxels::Voxels;

/// Proposed landmarks, to be checked by a person.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Proposal {
    /// Points by name, LPS mm.
    pub points: BTreeMap<String, Point>,
    /// Accuracy of each point, mm: as measured on heads with known landmarks, worse where the two sides disagree.
    pub within_mm: BTreeMap<String, f64>,
    /// x of the midsagittal plane, mm.
    pub midline_x_mm: f64,
    /// z of the occlusal plane below the anterior nasal spine, mm.
    pub occlusal_z_mm: Option<f64>,
    /// Point and unit normal of the Le Fort I plane: parallel to the occlusal plane, above the palate.
    pub le_fort_1_plane: Option<(Point, Vector)>,
}

impl Proposal {
    /// The proposal in another frame, into which `motion` maps; the midline and the occlusal plane as in [`Landmarks::seen_from`].
    #[must_use]
    pub fn seen_from(&self, motion: &Motion, near: &Point) -> Self {
        let Landmarks { points, midline_x_mm, occlusal_z_mm, le_fort_1_plane } = Landmarks {
            points: self.points.clone(),
            midline_x_mm: Some(self.midline_x_mm),
            occlusal_z_mm: self.occlusal_z_mm,
            le_fort_1_plane: self.le_fort_1_plane,
        }
        .seen_from(motion, near);
        let midline_x_mm = midline_x_mm.unwrap_or(self.midline_x_mm);
        Self { points, midline_x_mm, occlusal_z_mm, le_fort_1_plane, within_mm: self.within_mm.clone() }
    }

    /// Fills the values that `landmarks` lacks; returns their names.
    pub fn fill(&self, landmarks: &mut Landmarks) -> Vec<String> {
        let mut filled = Vec::new();
        for (name, p) in &self.points {
            if !landmarks.points.contains_key(name) {
                landmarks.points.insert(name.clone(), *p);
                filled.push(name.clone());
            }
        }
        if landmarks.midline_x_mm.is_none() {
            landmarks.midline_x_mm = Some(self.midline_x_mm);
            filled.push("midline_x_mm".to_owned());
        }
        if landmarks.occlusal_z_mm.is_none() && self.occlusal_z_mm.is_some() {
            landmarks.occlusal_z_mm = self.occlusal_z_mm;
            filled.push("occlusal_plane_z_mm".to_owned());
        }
        if landmarks.le_fort_1_plane.is_none() && self.le_fort_1_plane.is_some() {
            landmarks.le_fort_1_plane = self.le_fort_1_plane;
            filled.push("le_fort_1_plane".to_owned());
        }
        filled
    }
}

/// Proposes landmarks from the surfaces of skin and bone.
///
/// The head faces -y with z up, within about 20° of upright; the mouth may be open.
///
/// - The midline is where the front of the skin is most symmetric.
/// - The nasal aperture is the highest gap in the bone's front beside the midline; `ans` is the corner below it.
/// - The occlusal plane is the one below the palate that cuts least bone, without a tilt from side to side, lowered half-way to
///   the edge of the upper incisors; everything else is looked for with that plane horizontal.
/// - Skin: `pronasale`, the foremost point of all; `subnasale`, the deepest point between it and the upper lip;
///   `soft_pogonion`, the foremost point of the chin; `soft_menton`, the lowest.
/// - Bone, midline: `menton`, the lowest point of the chin; `pogonion`, its foremost; `b_point`, the deepest between `pogonion`
///   and the lower teeth; `a_point`, the deepest between `ans` and
///   the teeth; `nasal_bone_tip`, the lowest of the nasal bones, and `nasion`, the deepest above it; `incisor_upper`, the edge
///   of the upper incisors, and `incisor_lower` where they do not hide it.
/// - Bone, sides: the ramus is the plate beside and behind the upper teeth. `lingula_*` on its medial face, three fifths from
///   its front, 3 mm above the occlusal plane; `molar_*` on the body's outer face, 14 mm in front of the ramus;
///   `zygomaxillare_*`, the lower border of the cheek bone 37 mm beside the midline. `condylion_*`, the top of the condyle, or
///   the last level at which it is separate from the skull; `porion_*`, the top of the bony ear canal; `gonion_*`, the angle of
///   the jaw; `orbitale_*`, the lowest point of the orbit's rim; `frontomalare_*`, its lateral rim at three quarters of its
///   height.
///
/// Landmarks that cannot be found are left out.
///
/// # Accuracy
/// [`Proposal::within_mm`] holds it for each point (`prosopon bench proposals`). Lingula and molar lie as in an average jaw,
/// accurate enough for a cut that a person checks. Streaks of dental metal, masks and beards degrade the proposals.
///
/// ```
/// use prosopon_geometry::{Point, TriMesh};
/// use prosopon_planning::plan::propose;
///
/// // A box has no nasal aperture, from which the search starts: nothing but a midline is proposed.
/// let end = |i: u32, bit: u32, half: f64| if i >> bit & 1 == 1 { half } else { -half };
/// let corner = |i: u32| Point::new(end(i, 0, 60.0), end(i, 1, 80.0), end(i, 2, 90.0));
/// let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
/// let triangles = faces.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).collect();
/// let block = TriMesh::new((0..8).map(corner).collect(), triangles)?;
///
/// let proposal = propose(&block, &block);
/// assert!(proposal.points.is_empty() && proposal.le_fort_1_plane.is_none());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[must_use]
pub fn propose(skin: &TriMesh, skull: &TriMesh) -> Proposal {
    let midline = midline(skin);
    let mut found = Proposal { midline_x_mm: midline, ..Proposal::default() };
    let Some(UpperJaw { spine, bite }) = upper_jaw(skull, midline) else {
        return found;
    };
    // From here on the occlusal plane is horizontal.
    let pivot = Point::new(midline, spine[0], spine[1]);
    let level = turn_about(&pivot, -bite.pitch);
    let (skin, skull) = (skin.moved(&level), skull.moved(&level));
    let bone = Voxels::of(&skull);
    let occlusal = spine[1] + bite.height * bite.pitch.cos();
    let jaw = Jaw { bone: &bone, midline, spine_y: spine[0], occlusal };
    let back = level.inverse();
    let mut put = |name: &str, p: Option<Point>| -> Option<Point> {
        found.points.insert(name.to_owned(), back * p?);
        p
    };
    let (soft, hard) = (Profile::new(&skin, midline), Profile::new(&skull, midline));
    let at = |p: [f64; 2]| Point::new(midline, p[0], p[1]);
    let ans = put("ans", Some(pivot)).unwrap_or(pivot);
    let alveolar = hard.foremost(ans.z - 24.0, ans.z - 10.0);
    let upper = incisal_edge(&bone, midline, [ans.y, ans.z]);
    put("incisor_upper", upper.map(at));
    let lower_edge = upper.and_then(|edge| lower_incisal_edge(&bone, midline, edge));
    put("incisor_lower", lower_edge.map(at));
    put("a_point", alveolar.and_then(|a| hard.deepest(a, [ans.y, ans.z])).map(at));
    if let Some(nose) = soft.foremost(ans.z - 6.0, ans.z + 28.0) {
        put("pronasale", Some(at(nose)));
        // The lip's foremost point is looked for below the nose's underside.
        let lip = soft.foremost(nose[1] - 38.0, nose[1] - 16.0);
        put("subnasale", lip.and_then(|lip| soft.deepest(lip, nose)).map(at));
        // The edge of the nasal bones: going down, the profile falls back into the nose.
        let tip = hard.last_before_drop(nose[1] + 55.0, nose[1] + 8.0, 8.0);
        put("nasal_bone_tip", tip.map(at));
        put("nasion", tip.and_then(|t| hard.first_hollow(t[1] + 6.0, t[1] + 32.0)).map(at));
    }
    if let Some([pogonion, menton]) = jaw.chin() {
        let blunt = hard.summit(menton.z + 2.0, menton.z + 18.0).filter(|p| (p[0] - pogonion.y).abs() < 2.0);
        let pogonion = blunt.map_or(pogonion, at);
        let below = hard.bottom([menton.y - 2.0, menton.y + 12.0], menton.z - 3.0);
        put("pogonion", Some(pogonion));
        // The front of the lower teeth's bone, below their crowns.
        let edge = lower_edge.or(upper).map_or(pogonion.z + ALVEOLUS_MM[1], |edge| edge[1] - LOWER_CROWN_MM);
        let alveolar = hard.foremost(pogonion.z + ALVEOLUS_MM[0], edge.min(pogonion.z + ALVEOLUS_MM[1]));
        let b_point = alveolar.and_then(|a| hard.deepest([pogonion.y, pogonion.z], a));
        put("b_point", b_point.map(at));
        put("menton", Some(below.map_or(menton, at)));
        let chin = soft.summit(pogonion.z - 6.0, pogonion.z + 8.0);
        put("soft_pogonion", chin.map(at));
        put("soft_menton", chin.and_then(|c| soft.lowest_within(c, 18.0, 30.0)).map(at));
    }
    for side in [1.0, -1.0] {
        let name = Landmarks::side_name(side);
        let points = jaw.side(side);
        put(&format!("lingula_{name}"), points.as_ref().map(|p| p.lingula));
        put(&format!("molar_{name}"), points.as_ref().map(|p| p.molar));
        put(&format!("zygomaxillare_{name}"), jaw.zygoma(side, ans.z));
        let orbit = jaw.orbit(side, ans.z);
        put(&format!("orbitale_{name}"), orbit.as_ref().map(|o| o.orbitale));
        put(&format!("frontomalare_{name}"), orbit.as_ref().and_then(|o| o.frontomalare));
        let ends = jaw.ends(side);
        let condylion = put(&format!("condylion_{name}"), ends.as_ref().and_then(|e| e.condylion));
        put(&format!("porion_{name}"), condylion.and_then(|c| jaw.porion(side, &c)));
        put(&format!("gonion_{name}"), ends.as_ref().and_then(|e| e.gonion));
    }
    let up = back * Vector::z();
    found.occlusal_z_mm = Some(spine[1] + bite.height);
    found.le_fort_1_plane = Some((pivot + up * ABOVE_SPINE_MM, up));
    found.within_mm = accuracy::within_mm(&found.points, midline);
    found
}

/// What the search starts from.
struct UpperJaw {
    /// The anterior nasal spine as (y, z).
    spine: [f64; 2],
    /// The occlusal plane below it.
    bite: Occlusion,
}

fn upper_jaw(skull: &TriMesh, midline: f64) -> Option<UpperJaw> {
    const NEAR_APERTURE_MM: f64 = 6.0;
    let bone = Voxels::of(skull);
    let [bottom, _] = nasal_aperture(&bone, midline)?;
    let profile = Profile::new(skull, midline);
    let spine = profile.corner(bottom - NEAR_APERTURE_MM, bottom + NEAR_APERTURE_MM)?;
    let mut bite = occlusion(&bone, midline, spine)?;
    if let Some([y, z]) = incisal_edge(&bone, midline, spine) {
        // The plane of least bone lies between the molars; for a deep bite of the incisors it is lowered half-way to their edge.
        let at_edge = z - spine[1] - bite.pitch.tan() * (y - spine[0]);
        bite.height = bite.height.min(0.5 * (bite.height + at_edge));
    }
    Some(UpperJaw { spine, bite })
}

/// Rotation about the axis along x through `pivot`, radian; positive angles raise points behind it.
fn turn_about(pivot: &Point, angle: f64) -> Motion {
    Motion::rotation_wrt_point(nalgebra::UnitQuaternion::from_axis_angle(&Vector::x_axis(), angle), *pivot)
}

/// Points of the surface no farther than about `spacing` apart.
fn samples(mesh: &TriMesh, spacing: f64) -> impl Iterator<Item = Point> {
    (0..mesh.triangles().len()).flat_map(move |t| {
        let [a, b, c] = mesh.corners(t);
        let longest = (b - a).norm().max((c - a).norm()).max((c - b).norm());
        let n = ((longest / spacing).ceil() as usize).clamp(1, 64);
        (0..=n).flat_map(move |i| {
            (0..=n - i).map(move |j| {
                let (u, v) = (i as f64 / n as f64, j as f64 / n as f64);
                a + (b - a) * u + (c - a) * v
            })
        })
    })
}

#[cfg(test)]
mod tests;
