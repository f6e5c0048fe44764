//! The check of landmarks against surfaces and against one another.

use super::cause::{Cause, cause};
use super::change::Change;
use super::known::{Tissue, known};
use super::order::Arranged;
use super::places::{Judged, Place, Surfaces, listed};
use super::pose::Pose;
use super::tuning::{DOUBTFUL_MEAN_MM, FEWEST_SHIFTED, SEVERAL};
use crate::evaluate::EvaluateError;
use prosopon_geometry::{Point, TriMesh, Warning};

/// Landmarks of a session.
#[derive(Debug, Clone, Copy)]
pub struct GivenLandmarks<'a> {
    /// All points by name, LPS mm.
    pub points: &'a [(String, Point)],
    /// Names of points that nobody has confirmed; they are not judged.
    pub unconfirmed: &'a [String],
    /// x of the midsagittal plane, mm; `None` when unknown.
    pub midline_x_mm: Option<f64>,
}

/// Checks that landmarks lie on `skin` and `bone` and are arranged as in a head.
///
/// Soft points belong on the skin, bony points on the bone, each within the accuracy of its name and 6 mm. When several lie off,
/// a cause is looked for: another frame, side or unit, or a common shift. Sides and heights are judged along the axes of the
/// head that the landmarks themselves show, so that it may be tilted or turned. Names that are not known are not judged.
///
/// # Errors
/// [`EvaluateError::Input`] when a surface is not usable.
pub fn check_landmarks(
    landmarks: &GivenLandmarks<'_>,
    skin: Option<&TriMesh>,
    bone: Option<&TriMesh>,
) -> Result<Vec<Warning>, EvaluateError> {
    let is_given = |name: &str| !landmarks.unconfirmed.iter().any(|n| n == name);
    let judged = |(name, p): &'_ (String, Point)| known(name).map(|k| (name.clone(), *p, k));
    let known_points: Vec<_> = landmarks.points.iter().filter(|(n, _)| is_given(n)).filter_map(judged).collect();
    let judged: Vec<Judged<'_>> =
        known_points.iter().map(|(name, point, known)| Judged { name, point: *point, known: *known }).collect();
    if judged.is_empty() {
        return Ok(Vec::new());
    }
    let pose = Pose::of(landmarks.points);
    let surfaces = Surfaces::new(skin, bone)?;
    let places = surfaces.places(&judged);
    let off: Vec<&Place<'_>> = places.iter().filter(|p| p.distance.is_off()).collect();
    let is_gross = off.len() >= SEVERAL || (off.len() > 1 && off.len() * 2 >= places.len());
    let mean_mm = places.iter().map(|p| p.distance.mm).sum::<f64>() / places.len().max(1) as f64;
    // Points shifted along a face stay near it one by one, but not all together.
    let is_doubtful = places.len() >= FEWEST_SHIFTED && mean_mm > DOUBTFUL_MEAN_MM;
    let meshes: Vec<&TriMesh> = skin.into_iter().chain(bone).collect();
    let moved_by =
        |judged: &[Judged<'_>]| cause(&surfaces, judged, pose.as_ref(), &meshes).filter(|c| is_gross || c.is_plain());
    let mut affected = affected(&places);
    let mut found = if is_gross || is_doubtful { moved_by(&affected) } else { None };
    if found.is_none() && affected.len() < places.len() && is_doubtful {
        affected = places.iter().map(|p| p.judged).collect();
        found = moved_by(&affected);
    }
    let mut warnings = Vec::new();
    if found.is_some() || !off.is_empty() {
        warnings.push(off_surface(
            &off,
            &places,
            is_gross,
            found.as_ref().map(|cause| (cause, &affected[..])),
            pose.as_ref(),
        ));
    }
    if found.is_none() {
        warnings.extend(pose.as_ref().and_then(unlike_a_head));
    }
    // With a cause, the arrangement is that of the points where they belong.
    let points: Vec<(String, Point)> = match &found {
        Some(cause) => landmarks.points.iter().map(|(name, p)| (name.clone(), cause.apply(p))).collect(),
        None => landmarks.points.to_vec(),
    };
    let midline_x_mm = landmarks.midline_x_mm.filter(|_| found.is_none());
    let pose = Pose::of(&points);
    let arranged = Arranged { points: &points, is_given: &is_given, pose: pose.as_ref(), midline_x_mm };
    warnings.extend(arranged.exchanged());
    warnings.extend(arranged.out_of_order());
    Ok(warnings)
}

/// The landmarks of each tissue at least half of which lie off, or else all.
fn affected<'a>(places: &[Place<'a>]) -> Vec<Judged<'a>> {
    let of = |tissue: Tissue| places.iter().filter(move |p| p.judged.known.tissue == tissue);
    let is_off = |tissue| 2 * of(tissue).filter(|p| p.distance.is_off()).count() >= of(tissue).count();
    let some: Vec<Judged<'a>> = places.iter().filter(|p| is_off(p.judged.known.tissue)).map(|p| p.judged).collect();
    if some.is_empty() { places.iter().map(|p| p.judged).collect() } else { some }
}

fn off_surface(
    off: &[&Place<'_>],
    places: &[Place<'_>],
    is_gross: bool,
    cause: Option<(&Cause, &[Judged<'_>])>,
    pose: Option<&Pose>,
) -> Warning {
    let (k, n) = (off.len(), places.len());
    let all_places: Vec<&Place<'_>> = places.iter().collect();
    // With a common cause the others are wrong too, however near a surface they lie.
    let which = listed(if cause.is_some() { &all_places } else { off });
    let mean_mm = places.iter().map(|p| p.distance.mm).sum::<f64>() / n.max(1) as f64;
    let is_of = |tissue| move |j: &Judged<'_>| j.known.tissue == tissue;
    let all = match cause {
        Some((_, moved)) if moved.len() < n && moved.iter().all(is_of(Tissue::Skin)) => "those of the skin",
        Some((_, moved)) if moved.len() < n && moved.iter().all(is_of(Tissue::Bone)) => "those of the bone",
        _ => "the landmarks",
    };
    // A sum with zero has no negative zero.
    let whole = |mm: f64| mm.round() + 0.0;
    match cause.map(|(cause, _)| cause) {
        Some(Cause::Change(change)) => {
            let faces_forward = pose.is_some_and(|p| !p.looks_backwards()) && change.is_half_turn();
            let message = format!(
                "the landmarks lie {mean_mm:.0} mm off their surfaces on average: {which}; with {all} {change}, they lie on them"
            );
            let action = if faces_forward {
                "Upload the surfaces in LPS and mm: the landmarks look forward in LPS."
            } else {
                "Convert the landmarks to LPS and mm, and send them again."
            };
            Warning::unreliable("landmarks-wrong-frame", message).act(action)
        }
        Some(Cause::Shift(by)) => {
            let message = format!(
                "the landmarks lie {mean_mm:.0} mm off their surfaces on average: {which}; with {all} shifted by \
                 ({:.0}, {:.0}, {:.0}) mm, they lie on them",
                whole(by.x),
                whole(by.y),
                whole(by.z)
            );
            let action = "Check that landmarks and surfaces come from one scan with one origin.";
            Warning::unreliable("landmarks-wrong-frame", message).act(action)
        }
        None if is_gross => {
            let message = format!(
                "{k} of {n} landmarks lie off their surface: {which}; no likely frame, unit or shift puts them on it"
            );
            let action = "Check that landmarks and surfaces show one patient in one frame.";
            Warning::unreliable("landmarks-off-surface", message).act(action)
        }
        None => {
            let message = format!("{k} of {n} landmarks lie off their surface: {which}");
            Warning::check("landmarks-off-surface", message).act("Check the positions of these landmarks.")
        }
    }
}

/// Landmarks of a size or direction that those of a head in LPS and mm do not have.
fn unlike_a_head(pose: &Pose) -> Option<Warning> {
    let action = "Convert the landmarks to LPS and mm, and send them again.";
    if !pose.has_size_of_a_head() {
        let size = pose.size;
        let unit = Change::of_unit(size).map(|c| format!("; {c}, they have the size of a head")).unwrap_or_default();
        let message = format!("the landmarks lie as in a head {size:.3} times as large as that of an adult{unit}");
        return Some(Warning::unreliable("landmarks-wrong-frame", message).act(action));
    }
    pose.looks_backwards().then(|| {
        let message = "the landmarks show a face that looks towards +y, which is backwards in LPS and forwards in RAS";
        Warning::check("landmarks-wrong-frame", message).act(action)
    })
}
