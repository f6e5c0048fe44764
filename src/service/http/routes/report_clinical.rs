//! The part of the report's page in a surgeon's terms.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use maud::{Markup, html};

use super::report_table::{mm, table};
use prosopon_contract::{BeforeAfterDocument, ClinicalDocument, ErrorDocument, NamedPointDocument, StatisticsDocument};
use prosopon_session::profile_picture;

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

/// Tables of points, ratios and angles, with the picture of the profile.
pub(super) fn clinical(c: &ClinicalDocument) -> Markup {
    let point = |p: &NamedPointDocument| {
        let mark = if p.proposed { " *" } else { "" };
        vec![format!("{}{mark}", word(&p.name)), mm(p.forward_mm), mm(p.down_mm), mm(p.left_mm)]
    };
    let names = ["point", "forward", "down", "left"];
    let ratios = c.ratios.iter().map(|r| {
        let share = match (r.ratio, &r.reason) {
            (Some(ratio), _) => format!("{ratio:.2}"),
            (None, reason) => format!("– ({})", reason.as_deref().unwrap_or("not known")),
        };
        vec![word(&r.soft).to_owned(), r.hard.as_deref().map_or("–", word).to_owned(), share]
    });
    let value = |name: &str, unit: &str, value: &Option<BeforeAfterDocument>| {
        let row = |v: &BeforeAfterDocument| {
            let change = format!("{:+.1}{unit}", v.after - v.before);
            vec![name.to_owned(), format!("{:.1}{unit}", v.before), format!("{:.1}{unit}", v.after), change]
        };
        value.as_ref().map(row)
    };
    let angles = [
        value("nasolabial angle", "°", &c.nasolabial_deg),
        value("labiomental angle", "°", &c.labiomental_deg),
        value("gap between the lips", " mm", &c.lip_gap_mm),
    ];
    let is_proposed = c.soft_points.iter().chain(&c.hard_points).any(|p| p.proposed);
    html! {
        @if let Ok(svg) = profile_picture(c) {
            h2 { "Profile before and after" }
            img alt="Profile before and after" src={ "data:image/svg+xml;base64," (STANDARD.encode(svg)) };
        }
        (table("Soft tissue points, mm", &names, c.soft_points.iter().map(point)))
        (table("Bone and teeth, mm", &names, c.hard_points.iter().map(point)))
        (table("Soft to hard ratio, along the motion of the hard point", &["soft", "hard", "ratio"], ratios))
        (table("Angles and lips", &["", "before", "after", "change"], angles.into_iter().flatten()))
        p class="note" {
            @if is_proposed { "* found by the program: check the point before relying on its movement. " }
            @if c.midline_proposed { "The midline was found by the program. " }
            @if c.mouth_sealed { "The lips cannot part in this prediction: its skin is one sheet across the mouth." }
        }
    }
}

/// Table of the error beside that of no prediction and of 0.7 of the nearest bone, by region.
pub(super) fn beside_baselines(error: &ErrorDocument) -> Markup {
    let cells = |s: Option<&StatisticsDocument>| match s {
        Some(s) => [s.mean_abs_mm, s.p95_mm, s.mean_mm].map(mm).join(" / "),
        None => "–".to_owned(),
    };
    let rows = error.beside_baselines();
    let rows = rows.into_iter().map(|(name, of)| std::iter::once(name.to_owned()).chain(of.map(cells)).collect());
    let names = ["region", "prediction", "no prediction", "0.7 of nearest bone"];
    html! {
        (table("Error beside two simple predictions: mean / P95 / signed mean, mm", &names, rows))
        @if let Some(missing) = error.baselines.as_ref().and_then(|b| b.missing.as_ref()) {
            p class="note" { "Not every simple prediction could be scored: " (missing) "." }
        }
    }
}
