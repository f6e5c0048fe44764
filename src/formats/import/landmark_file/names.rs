//! Names of landmarks in cephalometry and anthropometry, and the service's own.

/// The service's name of a landmark that a label names.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum LandmarkName {
    /// A landmark that the table knows.
    Known(String),
    /// A landmark of both sides whose label says neither.
    WithoutSide(String),
    /// No entry of the table.
    Unknown,
}

/// Landmarks of bone or teeth in the midline: name, and other names in lower-case letters and digits.
///
/// Where authors differ, an abbreviation without a prime means bone (Jacobson, Radiographic Cephalometry; Arnett's and
/// Burstone's soft-tissue analyses write soft points with a prime).
const MIDLINE: [(&str, &[&str]); 18] = [
    ("ans", &["anteriornasalspine", "spna", "spinanasalisanterior", "acanthion"]),
    ("pns", &["posteriornasalspine", "spnp", "spinanasalisposterior"]),
    ("a_point", &["a", "apoint", "pointa", "ss", "subspinale", "subspinal"]),
    ("b_point", &["b", "bpoint", "pointb", "sm", "supramentale", "supramental"]),
    ("pogonion", &["pog", "pg"]),
    ("gnathion", &["gn"]),
    ("menton", &["me"]),
    ("nasion", &["n", "na"]),
    ("nasal_bone_tip", &["rhinion", "rhi", "nasalbonetip", "tipofnasalbone"]),
    (
        "incisor_upper",
        &[
            "ui",
            "u1",
            "u1e",
            "u1t",
            "uie",
            "uit",
            "is",
            "isu",
            "is1u",
            "incisionsuperius",
            "upperincisor",
            "upperincisortip",
            "upperincisoredge",
            "maxillaryincisor",
            "incisorupper",
        ],
    ),
    (
        "incisor_lower",
        &[
            "l1",
            "l1e",
            "l1t",
            "lie",
            "lit",
            "ii",
            "iil",
            "is1l",
            "incisioninferius",
            "lowerincisor",
            "lowerincisortip",
            "lowerincisoredge",
            "mandibularincisor",
            "incisorlower",
        ],
    ),
    ("prosthion", &["pr", "supradentale"]),
    ("infradentale", &["id"]),
    ("sella", &["s", "sellaturcica"]),
    ("basion", &["ba"]),
    ("glabella", &["g", "gl"]),
    ("d_point", &["d", "dpoint", "pointd"]),
    ("opisthion", &["op"]),
];

/// Landmarks of skin in the midline that have no counterpart of the same name on bone.
const SKIN: [(&str, &[&str]); 10] = [
    ("pronasale", &["prn", "pn", "pronasal", "tipofnose", "nosetip", "nasaltip"]),
    ("columella", &["cm", "c"]),
    ("subnasale", &["sn", "subnasal"]),
    ("labrale_superius", &["ls", "labralesuperior", "labialesuperius", "upperlip", "ulip"]),
    ("stomion", &["sto", "stm", "stomium"]),
    ("stomion_superius", &["stos", "stms", "sts", "stomionsuperior", "stomionsuperioris", "upperstomion"]),
    ("stomion_inferius", &["stoi", "stmi", "sti", "stomioninferior", "stomioninferioris", "lowerstomion"]),
    ("labrale_inferius", &["li", "labraleinferior", "labialeinferius", "lowerlip", "llip"]),
    (
        "sublabiale",
        &["sl", "si", "ils", "mls", "labiomentalfold", "mentolabialfold", "mentolabialsulcus", "labiomentalsulcus"],
    ),
    ("trichion", &["tr"]),
];

/// Landmarks of both sides, without the side.
const PAIRED: [(&str, &[&str]); 21] = [
    ("gonion", &["go"]),
    ("orbitale", &["or"]),
    ("porion", &["po"]),
    ("condylion", &["co", "cd", "cond", "condyle"]),
    ("coronoid", &["coronoidprocess", "coronion"]),
    ("articulare", &["ar"]),
    ("lingula", &["lin", "lg", "mandibularlingula"]),
    ("mental_foramen", &["mf", "mentalforamen", "foramenmentale", "mentale", "mforamen"]),
    ("zygion", &["zy", "zyg"]),
    ("zygomaxillare", &["zm", "zmx"]),
    ("jugale", &["j", "ju", "jugal"]),
    ("frontomalare", &["fmo", "fz", "fzs", "frontomalareorbitale", "frontozygomatic", "frontozygomaticsuture"]),
    ("molar_upper", &["u6", "ms", "um", "uppermolar", "upperfirstmolar", "maxillarymolar", "maxillaryfirstmolar"]),
    ("molar_lower", &["l6", "mi", "lm", "lowermolar", "lowerfirstmolar", "mandibularmolar", "mandibularfirstmolar"]),
    ("canine_upper", &["u3", "uppercanine", "maxillarycanine"]),
    ("canine_lower", &["l3", "lowercanine", "mandibularcanine"]),
    ("molar", &[]),
    ("cheilion", &["ch", "mouthcorner", "cornerofmouth", "commissure", "oralcommissure"]),
    ("alare", &["al", "ala", "nasalala"]),
    ("exocanthion", &["ex", "exo", "outercanthus", "lateralcanthus"]),
    ("endocanthion", &["en", "endo", "innercanthus", "medialcanthus"]),
];

/// First molars and canines by their numbers (FDI), and the service's names.
const TEETH: [(&str, &str); 8] = [
    ("16", "molar_upper_right"),
    ("26", "molar_upper_left"),
    ("36", "molar_lower_left"),
    ("46", "molar_lower_right"),
    ("13", "canine_upper_right"),
    ("23", "canine_upper_left"),
    ("33", "canine_lower_left"),
    ("43", "canine_lower_right"),
];

/// Skin over a landmark of bone: its stem and the name of the skin's point. All others get `soft_` before their name.
const SKIN_OVER: [(&str, &str); 1] = [("b_point", "sublabiale")];

/// Words that say that a point lies on skin, without spaces.
const SOFT_WORDS: [&str; 6] = ["softtissue", "soft", "cutaneous", "skin", "integumental", "st"];
/// Words that say that a point lies on bone.
const HARD_WORDS: [&str; 6] = ["hardtissue", "hard", "bony", "bone", "skeletal", "osseous"];
/// Words for the sides.
const SIDES: [(&str, &str); 8] = [
    ("left", "left"),
    ("right", "right"),
    ("lft", "left"),
    ("rgt", "right"),
    ("lt", "left"),
    ("rt", "right"),
    ("l", "left"),
    ("r", "right"),
];
/// Marks that make a landmark one of skin: Pog', N′.
const PRIMES: [char; 6] = ['\'', '\u{2019}', '\u{2032}', '\u{b4}', '`', '\u{2bc}'];

/// The landmark that a label names: `Pog'`, `Go (L)`, `Left Gonion`, `ANS`.
///
/// Upper and lower case, spaces and punctuation make no difference, except that `LI` in capitals is the lower incisor and `Li`
/// the lower lip, and that a prime means skin. Labels that two landmarks share (`Pog`, `N`, `Me`) mean bone.
///
/// ```
/// use prosopon_formats::import::{LandmarkName, landmark_name};
///
/// assert_eq!(landmark_name("Pog'"), LandmarkName::Known("soft_pogonion".into()));
/// assert_eq!(landmark_name("Go (L)"), LandmarkName::Known("gonion_left".into()));
/// assert_eq!(landmark_name("gonion"), LandmarkName::WithoutSide("gonion".into()));
/// assert_eq!(landmark_name("F-1"), LandmarkName::Unknown);
/// ```
#[must_use]
pub fn landmark_name(label: &str) -> LandmarkName {
    if label.trim() == "LI" {
        return LandmarkName::Known("incisor_lower".to_owned());
    }
    let has_prime = label.contains(PRIMES);
    let key: String = label.chars().filter(char::is_ascii_alphanumeric).map(|c| c.to_ascii_lowercase()).collect();
    if let Some((_, name)) = TEETH.iter().find(|(number, _)| key.strip_prefix("tooth").unwrap_or(&key) == *number) {
        return LandmarkName::Known((*name).to_owned());
    }
    let plain = |key: &str| find(key, has_prime);
    let found = plain(&key)
        .or_else(|| without(&key, &SOFT_WORDS).find_map(|rest| find(rest, true)))
        .or_else(|| without(&key, &HARD_WORDS).find_map(|rest| find(rest, false)))
        .or_else(|| soft_letter(&key).and_then(|rest| find(rest, true)));
    found.unwrap_or(LandmarkName::Unknown)
}

/// The label in lower-case letters, digits and `_`, at most 64; `None` when nothing is left of it.
#[must_use]
pub fn legal_name(label: &str) -> Option<String> {
    let mut name = String::new();
    for c in label.chars() {
        if c.is_ascii_alphanumeric() {
            name.push(c.to_ascii_lowercase());
        } else if !name.ends_with('_') && !name.is_empty() {
            name.push('_');
        }
    }
    let name: String = name.trim_end_matches('_').chars().take(64).collect();
    (!name.is_empty()).then_some(name)
}

/// The key without a word of `words` at its beginning or end.
fn without<'a>(key: &'a str, words: &'static [&'static str]) -> impl Iterator<Item = &'a str> {
    words.iter().flat_map(|word| [key.strip_prefix(word), key.strip_suffix(word)]).flatten()
}

/// `spog`, `pogs` and the like: the key without the letter. Only for keys whose rest has at least two letters.
fn soft_letter(key: &str) -> Option<&str> {
    let rest = key.strip_prefix('s').or(key.strip_suffix('s'))?;
    (rest.len() > 1).then_some(rest)
}

fn find(key: &str, is_soft: bool) -> Option<LandmarkName> {
    if let Some(name) = stem(key, &MIDLINE) {
        return Some(LandmarkName::Known(if is_soft { over(name) } else { name.to_owned() }));
    }
    // The service's own names of skin over bone: soft_pogonion.
    if let Some(name) = stem(key, &SKIN) {
        return Some(LandmarkName::Known(name.to_owned()));
    }
    let named = |name: &str| if is_soft && !is_skin(name) { over(name) } else { name.to_owned() };
    if let Some(name) = stem(key, &PAIRED) {
        return Some(LandmarkName::WithoutSide(named(name)));
    }
    SIDES.iter().find_map(|(word, side)| {
        let rests = [key.strip_suffix(word), key.strip_prefix(word)];
        let name = rests.into_iter().flatten().find_map(|rest| stem(rest, &PAIRED))?;
        Some(LandmarkName::Known(format!("{}_{side}", named(name))))
    })
}

fn over(name: &str) -> String {
    let known = SKIN_OVER.iter().find(|(bone, _)| *bone == name);
    known.map_or_else(|| format!("soft_{name}"), |(_, skin)| (*skin).to_owned())
}

/// Whether the paired landmark lies on skin anyway.
fn is_skin(name: &str) -> bool {
    ["cheilion", "alare", "exocanthion", "endocanthion"].contains(&name)
}

fn stem(key: &str, table: &[(&'static str, &[&str])]) -> Option<&'static str> {
    let own = |name: &str| name.bytes().filter(|c| *c != b'_').eq(key.bytes());
    table.iter().find(|(name, others)| own(name) || others.contains(&key)).map(|(name, _)| *name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_of_other_programs_mean_the_landmark() {
        for (labels, name) in [
            (&["ANS", "ans", "Ans ", "anterior nasal spine", "A.N.S."][..], "ans"),
            (&["A", "A point", "A-point", "Point A", "Subspinale", "ss", "a_point"], "a_point"),
            (&["B", "B-Point", "Supramentale"], "b_point"),
            (&["Pog", "Pg", "Pogonion", "pogonion (bony)", "Hard tissue Pogonion"], "pogonion"),
            (
                &[
                    "Pog'",
                    "Pog\u{2032}",
                    "Pg\u{2019}",
                    "soft pogonion",
                    "Soft tissue pogonion",
                    "soft_pogonion",
                    "sPog",
                    "ST-Pog",
                    "Pog (soft)",
                ],
                "soft_pogonion",
            ),
            (&["Me", "Menton"], "menton"),
            (&["Me'", "soft menton", "sMe"], "soft_menton"),
            (&["Gn", "Gnathion"], "gnathion"),
            (&["N", "Na", "Nasion"], "nasion"),
            (&["N'", "Soft Nasion", "Na'"], "soft_nasion"),
            (&["B'", "Sublabiale", "Labiomental fold", "Si"], "sublabiale"),
            (&["Sn", "Sn'", "Subnasale"], "subnasale"),
            (&["Pn", "Prn", "Pronasale", "nose tip"], "pronasale"),
            (&["Ls", "Labrale superius"], "labrale_superius"),
            (&["Li", "li", "Labrale inferius"], "labrale_inferius"),
            (&["LI", "L1", "Ii", "lower incisor", "lower_incisor", "incisor_lower"], "incisor_lower"),
            (&["UI", "U1", "Is", "Upper Incisor", "upper_incisor", "Incision superius"], "incisor_upper"),
            (&["Sto", "Stm", "Stomion"], "stomion"),
            (&["Stms", "stomion superius"], "stomion_superius"),
            (&["PNS"], "pns"),
            (&["Rhinion", "nasal bone tip"], "nasal_bone_tip"),
            (
                &["Go-L", "Go (L)", "GoL", "Left Gonion", "gonion_left", "Go left", "L Go", "Go.l", "lt. gonion"],
                "gonion_left",
            ),
            (&["GoR", "Go-R", "Right gonion"], "gonion_right"),
            (&["Go'-R"], "soft_gonion_right"),
            (&["Or-L", "OrL", "Orbitale (left)"], "orbitale_left"),
            (&["Or-R", "OrR"], "orbitale_right"),
            (&["Po-R", "PoR", "Porion right"], "porion_right"),
            (&["Co-L", "CdL", "Left condylion", "Condyle L"], "condylion_left"),
            (&["CoR", "Cd-R"], "condylion_right"),
            (&["U6-L", "U6L", "26", "upper first molar left"], "molar_upper_left"),
            (&["L6 R", "46", "tooth 46"], "molar_lower_right"),
            (&["MF-L", "Mental foramen left", "L mental foramen"], "mental_foramen_left"),
            (&["lingula_left", "Lingula L"], "lingula_left"),
            (&["Zy-R", "zygion right"], "zygion_right"),
            (&["Ch-R", "chR", "Cheilion right"], "cheilion_right"),
            (&["Al-L", "alare left"], "alare_left"),
            (&["Ex-R", "exocanthion_right"], "exocanthion_right"),
            (&["En-L"], "endocanthion_left"),
            (&["frontomalare_left", "Fmo L", "FZ-L"], "frontomalare_left"),
            (&["zygomaxillare_right", "ZmR"], "zygomaxillare_right"),
            (&["molar_left"], "molar_left"),
        ] {
            for label in labels {
                assert_eq!(landmark_name(label), LandmarkName::Known(name.to_owned()), "{label}");
            }
        }
        for (label, name) in [("Go", "gonion"), ("Orbitale", "orbitale"), ("Ch", "cheilion")] {
            assert_eq!(landmark_name(label), LandmarkName::WithoutSide(name.to_owned()), "{label}");
        }
        for label in ["F-1", "", "'", "Patient 7", "left", "R", "xyz", "soft", "screw 3"] {
            assert_eq!(landmark_name(label), LandmarkName::Unknown, "{label}");
        }
    }

    /// A label cannot mean two landmarks, and each name means itself.
    #[test]
    fn no_label_stands_twice_in_the_table() {
        let all: Vec<(&str, &[&str])> = MIDLINE.iter().chain(&SKIN).chain(&PAIRED).copied().collect();
        let mut seen = std::collections::BTreeSet::new();
        for (name, others) in all {
            let own = name.replace('_', "");
            for label in others.iter().map(|o| (*o).to_owned()).filter(|o| *o != own).chain([own.clone()]) {
                assert!(seen.insert(label.clone()), "{label}");
            }
        }
        // Nor one with a side at its end.
        for (stem, others) in PAIRED {
            for label in others.iter().copied().chain([stem]) {
                for side in ["l", "r"] {
                    assert!(!seen.contains(&format!("{}{side}", label.replace('_', ""))), "{label}{side}");
                }
            }
        }
    }

    #[test]
    fn own_names_have_a_legal_form() {
        for (label, name) in [
            ("Screw 3 (left)", Some("screw_3_left")),
            ("  F-1", Some("f_1")),
            ("Ä", None),
            ("''", None),
            ("__a__b", Some("a_b")),
        ] {
            assert_eq!(legal_name(label).as_deref(), name, "{label}");
        }
        assert_eq!(legal_name(&"x".repeat(100)).map(|n| n.len()), Some(64));
    }
}
