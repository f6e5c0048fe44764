//! Landmarks in files of 3D Slicer, and the names that other programs give them.
//!
//! Slicer writes `.fcsv` (text, read here) and `.mrk.json` (JSON, read by `markups` in `src/service/contract`, since this package
//! knows no JSON). Both state their coordinate system. The points come back in LPS mm with their labels; [`landmark_name`]
//! translates a label.

mod fcsv;
mod names;

pub use fcsv::{fiducials, looks_like_fiducials};
pub use names::{LandmarkName, landmark_name, legal_name};

/// Coordinate system of a landmark file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LandmarkFrame {
    /// x towards the patient's left, y backwards, z upwards.
    Lps,
    /// x towards the patient's right, y forwards, z upwards.
    Ras,
}

impl LandmarkFrame {
    /// The frame that Slicer's files name: `RAS` or `0`, `LPS` or `1`.
    #[must_use]
    pub fn of(word: &str) -> Option<Self> {
        match word.trim() {
            "0" => Some(Self::Ras),
            "1" => Some(Self::Lps),
            word if word.eq_ignore_ascii_case("RAS") => Some(Self::Ras),
            word if word.eq_ignore_ascii_case("LPS") => Some(Self::Lps),
            _ => None,
        }
    }

    /// `LPS` or `RAS`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Lps => "LPS",
            Self::Ras => "RAS",
        }
    }

    /// The point or direction in LPS.
    #[must_use]
    pub fn to_lps(self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        match self {
            Self::Lps => [x, y, z],
            // Zero minus the number gives no negative zero.
            Self::Ras => [0.0 - x, 0.0 - y, z],
        }
    }
}

/// Labelled points of a file, and what was assumed to read them.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct LandmarkFile {
    /// Labels as in the file and positions, LPS mm, in the file's order.
    pub points: Vec<(String, [f64; 3])>,
    /// Number of points that were converted from RAS.
    pub from_ras: usize,
    /// Frame that was assumed because the file states none.
    pub assumed: Option<LandmarkFrame>,
    /// Labels of points that have not been placed.
    pub unplaced: Vec<String>,
    /// Whether numbers have a decimal comma.
    pub has_decimal_commas: bool,
}

impl LandmarkFile {
    /// Adds a point whose coordinates (mm) are of `frame`.
    pub fn push(&mut self, label: String, position_mm: [f64; 3], frame: LandmarkFrame) {
        self.from_ras = self.from_ras.saturating_add(usize::from(frame == LandmarkFrame::Ras));
        self.points.push((label, frame.to_lps(position_mm)));
    }
}
