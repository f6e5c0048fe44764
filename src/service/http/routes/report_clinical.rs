//! The part of the report's page about named points of skin, bone and teeth.

use std::collections::BTreeMap;

use serde::Serialize;

use super::report_pictures::data_uri;
use super::report_table::{Table, movement, sentence};
use prosopon_contract::{BeforeAfterDocument, ClinicalDocument, NamedPointDocument, SoftToHardDocument};
use prosopon_session::profile_drawing;

/// Words for the points, as on a cephalometric tracing.
const WORDS: [(&str, &str); 17] = [
    ("pronasale", "tip of the nose (Prn)"),
    ("columella", "columella (Cm)"),
    ("subnasale", "subnasale (Sn)"),
    ("labrale_superius", "upper lip (Ls)"),
    ("stomion_superius", "upper lip's margin (Stms)"),
    ("stomion_inferius", "lower lip's margin (Stmi)"),
    ("labrale_inferius", "lower lip (Li)"),
    ("sublabiale", "labiomental fold (Sl)"),
    ("soft_pogonion", "soft chin (Pog′)"),
    ("soft_menton", "soft menton (Me′)"),
    ("ans", "anterior nasal spine (ANS)"),
    ("a_point", "A point"),
    ("incisor_upper", "upper incisor (Is)"),
    ("incisor_lower", "lower incisor (Ii)"),
    ("b_point", "B point"),
    ("pogonion", "pogonion (Pog)"),
    ("menton", "menton (Me)"),
];

fn word(name: &str) -> &str {
    WORDS.iter().find(|(known, _)| *known == name).map_or(name, |(_, word)| word)
}

/// Points, ratios, angles and profile.
#[derive(Debug, Serialize)]
pub(super) struct Clinical {
    soft: Table,
    hard: Table,
    angles: Table,
    /// Picture of the profile as a data URI; `None` without a profile.
    profile: Option<String>,
    /// Points that were found by the program, and other facts on which the measurements depend.
    notes: Vec<String>,
}

pub(super) fn clinical(c: &ClinicalDocument) -> Clinical {
    let soft = c.soft_points.iter().map(|p| {
        let ratio = c.ratios.iter().find(|r| r.soft == p.name).and_then(ratio);
        point(p).chain([ratio.unwrap_or_else(|| "–".to_owned())]).collect()
    });
    let hard = c.hard_points.iter().map(|p| point(p).collect());
    let angles = [
        change("nasolabial angle", "°", c.nasolabial_deg),
        change("labiomental angle", "°", c.labiomental_deg),
        // One sheet of skin has no gap to measure.
        change("gap between the lips", " mm", c.lip_gap_mm.filter(|_| !c.mouth_sealed)),
    ];
    let is_proposed = c.soft_points.iter().chain(&c.hard_points).any(|p| p.proposed);
    let notes = [
        is_proposed.then(|| "* The program found this point. Check it before you rely on its movement.".to_owned()),
        c.midline_proposed.then(|| "The program found the midline.".to_owned()),
        c.mouth_sealed.then(|| "The lips are joined in this prediction.".to_owned()),
    ];
    Clinical {
        soft: Table::new(
            "Soft tissue points, mm",
            &["point", "forward / back", "down / up", "left / right", "ratio to bone"],
            soft,
        )
        .with_notes(ratio_notes(c)),
        hard: Table::new("Bone and teeth, mm", &["point", "forward / back", "down / up", "left / right"], hard),
        angles: Table::new("Angles and lips", &["measure", "before", "after", "change"], angles.into_iter().flatten()),
        profile: profile_drawing(c).ok().map(|svg| data_uri("image/svg+xml", svg.as_bytes())),
        notes: notes.into_iter().flatten().collect(),
    }
}

fn point(p: &NamedPointDocument) -> impl Iterator<Item = String> {
    let mark = if p.proposed { " *" } else { "" };
    let name = format!("{}{mark}", word(&p.name));
    std::iter::once(name).chain(movement(p.forward_mm, p.down_mm, p.left_mm))
}

/// The ratio with the hard point to which it refers.
fn ratio(r: &SoftToHardDocument) -> Option<String> {
    r.ratio.map(|ratio| match &r.hard {
        Some(hard) => format!("{ratio:.2} of {}", word(hard)),
        None => format!("{ratio:.2}"),
    })
}

/// What the ratios are, and why some are missing.
fn ratio_notes(c: &ClinicalDocument) -> Vec<String> {
    let mut by_reason: BTreeMap<&str, Vec<String>> = BTreeMap::new();
    for r in c.ratios.iter().filter(|r| r.ratio.is_none()) {
        let hard = r.hard.as_deref().map(|hard| format!(" to {}", word(hard))).unwrap_or_default();
        by_reason
            .entry(r.reason.as_deref().unwrap_or("not known"))
            .or_default()
            .push(format!("{}{hard}", word(&r.soft)));
    }
    let missing = by_reason.iter().map(|(reason, of)| sentence(&format!("no ratio of {}: {reason}", of.join(", "))));
    let meaning = "Ratio: movement of the soft point along that of the bone or tooth below it, as a share of it.";
    let meaning = (!c.ratios.is_empty()).then(|| meaning.to_owned());
    meaning.into_iter().chain(missing).collect()
}

fn change(name: &str, unit: &str, value: Option<BeforeAfterDocument>) -> Option<Vec<String>> {
    value.map(|v| {
        let change = format!("{:+.1}{unit}", v.after - v.before);
        vec![name.to_owned(), format!("{:.1}{unit}", v.before), format!("{:.1}{unit}", v.after), change]
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ratio_of(ratio: Option<f64>) -> SoftToHardDocument {
        let reason = ratio.is_none().then(|| "the hard point moves by only 0.2 mm".to_owned());
        SoftToHardDocument { soft: "subnasale".to_owned(), hard: Some("a_point".to_owned()), ratio, reason }
    }

    #[test]
    fn a_ratio_names_its_hard_point() {
        assert_eq!(ratio(&ratio_of(Some(0.743))).as_deref(), Some("0.74 of A point"));
        assert_eq!(ratio(&ratio_of(None)), None);
    }

    #[test]
    fn a_point_that_the_program_found_has_a_mark() {
        let p = NamedPointDocument {
            name: "pronasale".to_owned(),
            position_mm: [0.0, -110.0, 40.0],
            side_yz_mm: None,
            forward_mm: 2.1,
            down_mm: -3.0,
            left_mm: 0.0,
            proposed: true,
        };
        let cells: Vec<String> = point(&p).collect();
        assert_eq!(cells, ["tip of the nose (Prn) *", "2.1 forward", "3.0 up", "0.0"]);
    }
}
