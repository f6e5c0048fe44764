//! Names of the landmarks of a file.

use std::collections::BTreeMap;

use super::check::Check;
use super::fault::Fault;
use prosopon_formats::import::{LandmarkFile, LandmarkName, landmark_name, legal_name};
use prosopon_geometry::Warning;

/// Most labels that a message lists.
const LISTED: usize = 40;
/// Longest label that a message repeats, characters.
const LONGEST: usize = 40;

/// Landmarks of a file under the service's names, and what became of their labels.
#[derive(Debug, Default)]
pub(super) struct Named {
    /// Points by name, LPS mm.
    pub(super) points: BTreeMap<String, [f64; 3]>,
    /// Labels that the table knows and that differ from the name: label, name.
    renamed: Vec<(String, String)>,
    /// Labels of the table without the side that they need.
    without_side: Vec<(String, String)>,
    /// Labels that the table does not know.
    unknown: Vec<(String, String)>,
    /// Whether `LI` could be a lip.
    is_doubtful: bool,
}

impl Named {
    /// Names the points of a file.
    ///
    /// # Errors
    /// A fault that lists the names that two labels have.
    pub(super) fn of(file: &LandmarkFile) -> Result<Self, Fault> {
        let (mut named, mut check) = (Self::default(), Check::default());
        let mut labels: BTreeMap<String, &str> = BTreeMap::new();
        let has = |label: &str| file.points.iter().any(|(l, _)| l.trim() == label);
        let lips_in_capitals = has("LS") && !has("UI");
        for (index, (label, position)) in file.points.iter().enumerate() {
            let own = || legal_name(label).unwrap_or_else(|| format!("point_{}", index + 1));
            let (name, list) = match landmark_name(label) {
                LandmarkName::Known(_) if label.trim() == "LI" && lips_in_capitals => {
                    ("labrale_inferius".to_owned(), &mut named.renamed)
                }
                LandmarkName::Known(name) => (name, &mut named.renamed),
                LandmarkName::WithoutSide(name) => (name, &mut named.without_side),
                LandmarkName::Unknown => (own(), &mut named.unknown),
            };
            list.push((label.clone(), name.clone()));
            named.is_doubtful |= label.trim() == "LI" && !has("UI") && !has("LS") && !has("Li");
            match labels.get(&name) {
                None => {
                    labels.insert(name.clone(), label);
                    named.points.insert(name, *position);
                }
                Some(_) if named.points.get(&name) == Some(position) => {}
                Some(other) => {
                    let detail = format!(
                        "is named by both `{}` and `{}`; remove or rename one of them",
                        shown(other),
                        shown(label)
                    );
                    check.fault(format!("/points/{name}"), detail);
                }
            }
        }
        check.finish()?;
        Ok(named)
    }

    /// Notes and warnings on the names.
    pub(super) fn findings(&self) -> Vec<Warning> {
        let mut found = Vec::new();
        let renamed: Vec<&(String, String)> = self.renamed.iter().filter(|(label, name)| label != name).collect();
        if !renamed.is_empty() {
            found.push(Warning::info(
                "landmarks-renamed",
                format!("landmarks got the service's names: {}", pairs(&renamed)),
            ));
        }
        let unknown: Vec<&(String, String)> = self.unknown.iter().collect();
        if self.renamed.is_empty() && self.without_side.is_empty() && !unknown.is_empty() {
            let message = format!("no label names a landmark that the service knows: {}", pairs(&unknown));
            let action = "Name the points after their landmarks, for example ANS, Pog or Go-L.";
            found.push(Warning::check("no-known-landmark", message).act(action));
        } else if !unknown.is_empty() {
            let message = format!("labels without a known landmark were kept: {}", pairs(&unknown));
            found.push(Warning::info("landmarks-not-known", message));
        }
        if !self.without_side.is_empty() {
            let labels: Vec<&(String, String)> = self.without_side.iter().collect();
            let message =
                format!("labels of landmarks on both sides name no side, so nothing uses them: {}", pairs(&labels));
            found.push(Warning::check("landmarks-without-side", message).act("Add L or R to the labels, as in Go-L."));
        }
        if self.is_doubtful {
            let message = "`LI` was read as the lower incisor, but can mean the lower lip (labrale inferius)";
            found.push(Warning::check("doubtful-landmark-name", message).act("Call it L1 or labrale inferius."));
        }
        found
    }
}

/// The note that `count` landmarks were converted.
pub(super) fn from_ras(count: usize) -> Warning {
    Warning::info("landmarks-from-ras", format!("{count} landmarks were converted from RAS to LPS"))
}

/// `label → name` for the first of `list`.
fn pairs(list: &[&(String, String)]) -> String {
    let shown: Vec<String> = list.iter().map(|(label, name)| format!("`{}` → `{name}`", shown(label))).collect();
    listed_plain(&shown)
}

/// The first labels of a list, quoted.
pub(super) fn listed(labels: &[String]) -> String {
    let shown: Vec<String> = labels.iter().map(|label| format!("`{}`", shown(label))).collect();
    listed_plain(&shown)
}

fn listed_plain(shown: &[String]) -> String {
    let first = shown.iter().take(LISTED).cloned().collect::<Vec<_>>().join(", ");
    match shown.len().saturating_sub(LISTED) {
        0 => first,
        more => format!("{first} and {more} more"),
    }
}

/// A label without control characters, shortened.
fn shown(label: &str) -> String {
    let plain = label.chars().filter(|c| !c.is_control()).take(LONGEST + 1).collect::<String>();
    match plain.char_indices().nth(LONGEST) {
        Some((end, _)) => format!("{}…", plain.get(..end).unwrap_or_default()),
        None => plain,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn named(labels: &[&str]) -> Result<Named, Fault> {
        let points = labels.iter().enumerate().map(|(i, l)| ((*l).to_owned(), [i as f64, 0.0, 0.0])).collect();
        Named::of(&LandmarkFile { points, ..LandmarkFile::default() })
    }

    fn codes(labels: &[&str]) -> Vec<&'static str> {
        named(labels).unwrap().findings().iter().map(|w| w.code).collect()
    }

    #[test]
    fn labels_are_reported_with_their_names() {
        let found = named(&["ANS", "pogonion", "Screw 3"]).unwrap();
        assert_eq!(found.points.keys().collect::<Vec<_>>(), ["ans", "pogonion", "screw_3"]);
        let findings = found.findings();
        assert_eq!(findings[0].message, "landmarks got the service's names: `ANS` → `ans`");
        assert!(findings[1].message.ends_with("`Screw 3` → `screw_3`"), "{findings:?}");
        assert_eq!(codes(&["ANS", "pogonion", "Screw 3"]), ["landmarks-renamed", "landmarks-not-known"]);
        assert_eq!(codes(&["ans", "pogonion"]), [""; 0]);
        assert_eq!(codes(&["F-1", "F-2"]), ["no-known-landmark"]);
        assert_eq!(codes(&["ans", "Go"]), ["landmarks-without-side"]);
        assert_eq!(named(&["", "Ä"]).unwrap().points.keys().collect::<Vec<_>>(), ["point_1", "point_2"]);
        let many: Vec<String> = (0..100).map(|i| format!("x{i}")).collect();
        assert!(listed(&many).ends_with("`x39` and 60 more"));
        assert_eq!(shown(&"y".repeat(100)).chars().count(), LONGEST + 1);
    }

    #[test]
    fn two_labels_of_one_landmark_are_refused() {
        let fault = named(&["Pog", "ANS", "Pogonion"]).unwrap_err();
        assert!(fault.detail.contains("`Pog` and `Pogonion`"), "{fault:?}");
        assert_eq!(fault.errors[0].pointer, "/points/pogonion");
        assert!(named(&["F-1", "f_1"]).is_err());
        assert!(named(&["Pog", "Pog'"]).is_ok());
    }

    #[test]
    fn lip_and_incisor_are_told_apart() {
        let name = |labels: &[&str]| named(labels).unwrap().points.into_keys().collect::<Vec<_>>();
        assert_eq!(name(&["LI", "UI"]), ["incisor_lower", "incisor_upper"]);
        assert_eq!(name(&["LI", "LS"]), ["labrale_inferius", "labrale_superius"]);
        assert_eq!(name(&["LI", "Li"]), ["incisor_lower", "labrale_inferius"]);
        assert_eq!(codes(&["LI", "ans"]), ["landmarks-renamed", "doubtful-landmark-name"]);
        assert_eq!(codes(&["LI", "UI", "ans"]), ["landmarks-renamed"]);
    }
}
