//! What a surface file states about its coordinates outside its numbers: coordinate system and unit.
//!
//! No surface format has a place for either. 3D Slicer writes `SPACE=RAS` or `SPACE=LPS` into the header of an STL file, a comment
//! of a PLY or OBJ file, and the field array `SPACE` of a VTP file; others write `coordinate system: RAS`, `units: m` or, as
//! Maya, `This file uses centimeters as units`.

mod frame;
#[cfg(test)]
mod tests;
mod unit;
mod words;

use std::ops::RangeInclusive;

use frame::{Frame, FrameWords};
use prosopon_geometry::{Aabb, Point, Warning};
use unit::{Unit, UnitWords};

/// The marker in the files that this program writes.
pub(crate) const LPS_MARKER: &str = "SPACE=LPS";

/// Statements of one file.
#[derive(Debug, Clone, Default)]
pub(super) struct Stated {
    frames: Statements<Frame>,
    units: Statements<Unit>,
}

/// What is stated of one kind: the first two values that differ, and whether a value was not understood.
#[derive(Debug, Clone)]
struct Statements<T> {
    first: Option<T>,
    other: Option<T>,
    unknown: bool,
}

impl<T> Default for Statements<T> {
    fn default() -> Self {
        Self { first: None, other: None, unknown: false }
    }
}

impl<T: Copy + PartialEq> Statements<T> {
    fn add(&mut self, value: Option<T>) {
        match (value, self.first) {
            (None, _) => self.unknown = true,
            (Some(value), None) => self.first = Some(value),
            (Some(value), Some(first)) if value != first => self.other = self.other.or(Some(value)),
            (Some(_), Some(_)) => {}
        }
    }
}

impl Stated {
    /// Takes the statements of one line of text, such as a comment; most lines have none.
    pub(super) fn read(&mut self, line: &[u8]) {
        let tokens = words::tokens(line);
        for at in 0..tokens.len() {
            let here = tokens.get(at..).unwrap_or_default();
            match frame::stated(here) {
                Some(FrameWords::Known(frame)) => self.frames.add(Some(frame)),
                Some(FrameWords::Unknown) => self.frames.add(None),
                None => {}
            }
            match unit::stated(here) {
                Some(UnitWords::Known(unit)) => self.units.add(Some(unit)),
                Some(UnitWords::Unknown) => self.units.add(None),
                None => {}
            }
        }
    }

    /// The statement of a named value, such as a field array.
    pub(super) fn read_value(&mut self, name: &str, value: &[u8]) {
        self.read(&[name.as_bytes(), b"=", value].concat());
    }

    /// Whether a field array with this name may state a coordinate system or a unit.
    pub(super) fn is_name(name: &str) -> bool {
        let mut trial = Self::default();
        trial.read_value(name, b"RAS");
        trial.read_value(name, b"mm");
        trial.frames.first.is_some() || trial.units.first.is_some()
    }

    /// Converts positions to LPS and mm and orders triangles again after a mirror image; says so in `warnings`.
    pub(super) fn apply(&self, positions: &mut [Point], triangles: &mut [[u32; 3]], warnings: &mut Vec<Warning>) {
        self.apply_frame(positions, triangles, warnings);
        self.apply_unit(positions, warnings);
    }

    fn apply_frame(&self, positions: &mut [Point], triangles: &mut [[u32; 3]], warnings: &mut Vec<Warning>) {
        const ACTION: &str =
            "Check left and right, front and back, and state the coordinate system once, as SPACE=LPS or SPACE=RAS.";
        let Statements { first, other, unknown } = &self.frames;
        let Some(frame) = first else {
            if *unknown {
                let found = "the file states a coordinate system that is not known; LPS was assumed";
                warnings.push(Warning::check("unclear-frame", found).act(ACTION));
            }
            return;
        };
        let name = frame.name();
        if let Some(other) = other {
            let found = format!("the file states two coordinate systems, {name} and {}; {name} was used", other.name());
            warnings.push(Warning::check("unclear-frame", found).act(ACTION));
        }
        if frame.is_rai() {
            let found = "the file states RAI, which was taken as axes that point to right, anterior and inferior; ITK calls LPS so";
            warnings.push(Warning::check("unclear-frame", found).act(ACTION));
        }
        if frame.is_lps() {
            return;
        }
        for p in positions.iter_mut() {
            *p = frame.to_lps(p);
        }
        let mut mirrored = "";
        if frame.is_left_handed() {
            triangles.iter_mut().for_each(|t| t.swap(1, 2));
            mirrored = ", a mirror image: the order of the corners was reversed";
        }
        let found = format!("the file states the coordinate system {name}; it was converted to LPS{mirrored}");
        warnings.push(Warning::info("stated-frame", found));
    }

    fn apply_unit(&self, positions: &mut [Point], warnings: &mut Vec<Warning>) {
        const ACTION: &str = "Check the size of the head, and state the unit once, as UNIT=mm.";
        /// Diagonals of what is planned on, mm: a jaw to a body.
        const USUAL_MM: RangeInclusive<f64> = 50.0..=1500.0;
        let Statements { first, other, unknown } = &self.units;
        let Some(unit) = first else {
            if *unknown {
                let found = "the file states a unit of length that is not known; mm was assumed";
                warnings.push(Warning::check("unclear-unit", found).act(ACTION));
            }
            return;
        };
        if let Some(other) = other {
            let found =
                format!("the file states two units of length, {0} and {1}; {0} were used", unit.name, other.name);
            warnings.push(Warning::check("unclear-unit", found).act(ACTION));
        }
        if unit.mm == 1.0 {
            return;
        }
        // Some programs always write the unit that they are set to, whatever the numbers are.
        let finite = positions.iter().filter(|p| p.iter().all(|c| c.is_finite()));
        let diagonal = Aabb::of(finite).map_or(0.0, |b| b.diagonal());
        let usual = |mm: f64| USUAL_MM.contains(&mm);
        if usual(diagonal) && !usual(diagonal * unit.mm) {
            let found = format!(
                "the file states {}, in which the bounding box would have a diagonal of {:.1} mm; mm was assumed",
                unit.name,
                diagonal * unit.mm
            );
            warnings.push(Warning::check("unclear-unit", found).act(ACTION));
            return;
        }
        for p in positions.iter_mut() {
            p.iter_mut().for_each(|x| *x *= unit.mm);
        }
        let found = format!("the file states {}; they were converted to mm (times {})", unit.name, unit.mm);
        warnings.push(Warning::info("stated-unit", found));
    }
}
