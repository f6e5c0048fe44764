//! Published soft-to-hard ratios.

use super::Measure;

/// A range of a ratio that patients show.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Published {
    /// Begin of the operation's name.
    pub(super) operation: &'static str,
    pub(super) measure: Measure,
    pub(super) range: [f64; 2],
}

/// The ranges that issue 26 asks for, by operation; [`SOURCES`] says where they come from.
///
/// An operation on both jaws has the ranges of its two parts. "Little up" of the nasal tip is taken as at most 0.15 of the
/// advance: a choice of this study, not a published number.
pub(super) const PUBLISHED: [Published; 12] = [
    of("le_fort_1", Measure::Ratio("labrale_superius"), [0.5, 0.9]),
    of("le_fort_1", Measure::Ratio("subnasale"), [0.4, 0.6]),
    of("le_fort_1", Measure::Ratio("pronasale"), [0.2, 0.35]),
    of("le_fort_1", Measure::UpPerAdvance("pronasale"), [-0.05, 0.15]),
    of("set-back", Measure::Ratio("labrale_inferius"), [0.6, 0.9]),
    of("set-back", Measure::Ratio("soft_pogonion"), [0.9, 1.0]),
    of("advance", Measure::Ratio("soft_pogonion"), [0.9, 1.0]),
    of("genioplasty", Measure::Ratio("soft_pogonion"), [0.8, 1.0]),
    of("bimaxillary", Measure::Ratio("subnasale"), [0.4, 0.6]),
    of("bimaxillary", Measure::Ratio("labrale_superius"), [0.5, 0.9]),
    of("bimaxillary", Measure::Ratio("labrale_inferius"), [0.6, 0.9]),
    of("bimaxillary", Measure::Ratio("soft_pogonion"), [0.9, 1.0]),
];

const fn of(operation: &'static str, measure: Measure, range: [f64; 2]) -> Published {
    Published { operation, measure, range }
}

/// Sources, with what was checked of each.
///
/// The ranges themselves are those of issue 26. Ratios behind the word "abstract" were read in the publication's abstract; none
/// of the printed tables was at hand.
pub(super) const SOURCES: &[&str] = &[
    "pronasale, up: no published number; issue 26 wants \"little\", which this study takes as at most 0.15 of the advance.",
    "Le Fort I: San Miguel Moragas, Van Cauteren, Mommaerts, A systematic review on soft-to-hard tissue ratios in orthognathic \
     surgery part I: Maxillary repositioning osteotomy, J Craniomaxillofac Surg 42 (2014) 1341-1351 (title and pages checked; \
     its tables not).",
    "Le Fort I, other end of the spread: PMC6173856 (32 patients, structured light, abstract): nasal tip 0.17, Ls 0.21 of an \
     advance, Li 0.66 of a set-back or advance of the lower jaw.",
    "Lower jaw: Hallulli, Sjöström, Facial soft tissue changes following isolated bilateral sagittal split osteotomy, a review, \
     PMC12954955 (abstract): Pog' 0.80 to 1.33 of an advance.",
    "Set-back: Three-dimensional evaluation of soft tissue change gradients after mandibular setback surgery, Angle Orthod 80(5) \
     (2010) 896 (abstract, 26 patients): Li 6.9, B' 6.7, Pog' 6.7 mm back, Stm 1.6 mm.",
    "Genioplasty: San Miguel Moragas et al., part II: Chin procedures (PubMed 26321067; title checked, its tables not); \
     Long-term hard and soft tissue response following isolated genioplasty, Oral Maxillofac Surg (2021), \
     doi 10.1007/s10006-021-00991-7 (abstract): 0.77 to 0.91 after two years.",
];
