//! Suggested names of segments.

use super::tuning::ASIDE_MM;
use super::{CutShape, DentalArch, Landmarks, Osteotomy, Segment};

/// Names the segments by their position and by the template cuts that bound them, and finds where the teeth are.
///
/// Names are for people: nothing else depends on them.
/// Of several segments with the same name the largest keeps it; the others get a number, for example `maxilla_2`. Without
/// landmarks the midline is the middle of the skull's bounding box, and the occlusal plane is that of the cut named `occlusal`.
/// Without an occlusal plane, segments whose name depends on it get none.
pub fn name_segments(osteotomy: &mut Osteotomy, landmarks: &Landmarks) {
    let middle = osteotomy.segments.first().map_or(0.0, |s| s.surface.bounds().center().x);
    let midline = landmarks.midline_x_mm.unwrap_or(middle);
    let of_cut = osteotomy.cuts.iter().find_map(|c| match &c.shape {
        CutShape::Plane(plane) if c.name.as_deref() == Some("occlusal") => Some(plane.point.z),
        CutShape::Plane(_) | CutShape::Polyline { .. } | CutShape::Surface(_) | CutShape::FreePart(_) => None,
    });
    let occlusal = landmarks.occlusal_z_mm.or(of_cut);
    let cuts: Vec<String> = osteotomy.cuts.iter().map(|c| c.name.clone().unwrap_or_default()).collect();
    let top_of_chin = osteotomy
        .segments
        .iter()
        .filter(|s| s.id != 0 && s.bounded_by.iter().any(|c| cuts[*c] == "genioplasty"))
        .min_by(|a, b| a.centroid.z.total_cmp(&b.centroid.z))
        .map(|s| s.id);
    osteotomy.arch = DentalArch::of_segments(osteotomy, landmarks);
    let mut taken: Vec<(String, usize)> = Vec::new();
    // Segments are ordered by falling volume, so the largest gets the name without a number.
    for segment in &mut osteotomy.segments {
        let name = match segment.id {
            0 => Some("skull".to_owned()),
            id if Some(id) == top_of_chin => Some("chin".to_owned()),
            _ => name(segment, &cuts, midline, occlusal),
        };
        segment.name = name.map(|name| match taken.iter_mut().find(|(n, _)| *n == name) {
            Some((_, count)) => {
                *count += 1;
                format!("{name}_{count}")
            }
            None => {
                taken.push((name.clone(), 1));
                name
            }
        });
    }
}

fn name(segment: &Segment, cuts: &[String], midline: f64, occlusal: Option<f64>) -> Option<String> {
    let bounded = |start: &str| segment.bounded_by.iter().any(|c| cuts[*c].starts_with(start));
    let off = segment.centroid.x - midline;
    let side = if off > 0.0 { "left" } else { "right" };
    let is_upper = occlusal.map(|z| segment.centroid.z > z);
    // A split may reach the upper jaw where teeth or streaks of metal connect the jaws.
    let is_maxilla = is_upper == Some(true) && bounded("le_fort_1") && off.abs() < ASIDE_MM;
    let split = bounded("bsso_") && !is_maxilla;
    if split || is_upper == Some(false) {
        let aside = off.abs() > ASIDE_MM;
        if split && aside {
            return Some(format!("mandible_proximal_{side}"));
        }
        let cut_through = split || (bounded("genioplasty") && !bounded("joint_"));
        return Some(match (aside, cut_through) {
            (false, true) => "mandible_distal".to_owned(),
            (true, _) => format!("mandible_{side}"),
            (false, false) => "mandible".to_owned(),
        });
    }
    if bounded("joint_") {
        return Some("mandible".to_owned());
    }
    if bounded("le_fort_2") || bounded("le_fort_3") {
        return Some("midface".to_owned());
    }
    if bounded("midsagittal") {
        return Some(format!("maxilla_{side}"));
    }
    (is_upper == Some(true) || bounded("le_fort_1")).then(|| "maxilla".to_owned())
}
