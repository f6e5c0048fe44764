//! Reads legacy VTK files (`.vtk`) of unstructured grids, ASCII or binary.
//!
//! Cells may have the layout of versions up to 4 or that from version 5.1 on.
//!
//! # Source
//! VTK File Formats for VTK version 4.2, and the notes on version 5.1 in VTK's documentation.

use super::cells::{self, RawCells};
use super::{finished, points_from};
use crate::import::error::{at_most, malformed};
use crate::import::number::Kind;
use crate::import::text::number;
use crate::import::{ImportError, Limits};
use prosopon_geometry::{DataArray, VolumeMesh};

pub(super) const FORMAT: &str = "legacy VTK";

/// Whether `bytes` begin like a legacy VTK file.
#[must_use]
pub fn is_legacy_vtk(bytes: &[u8]) -> bool {
    bytes.trim_ascii_start().starts_with(b"# vtk DataFile")
}

/// Reads a legacy file.
pub(super) fn read(bytes: &[u8], limits: &Limits) -> Result<(VolumeMesh, Vec<String>), ImportError> {
    let mut file = Reader { rest: bytes.trim_ascii_start(), is_ascii: true };
    // Skips the version and the title.
    file.line();
    file.line();
    file.is_ascii = match file.line().trim_ascii().to_ascii_uppercase().as_slice() {
        b"ASCII" => true,
        b"BINARY" => false,
        other => return Err(fault(format!("line 3 is `{}`, expected ASCII or BINARY", shown(other)))),
    };
    let mut content = Content::default();
    while let Some(words) = file.words()? {
        content.section(&mut file, &words, limits)?;
    }
    content.mesh()
}

fn fault(detail: impl Into<String>) -> ImportError {
    malformed(FORMAT, detail)
}

fn shown(word: &[u8]) -> String {
    let (head, _) = word.split_at_checked(40).unwrap_or((word, &[]));
    String::from_utf8_lossy(head).into_owned()
}

/// Owner of the arrays that follow.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Owner {
    Points,
    Cells,
    /// The file as a whole; its arrays are read and dropped.
    Nobody,
}

#[derive(Debug, Default)]
struct Content {
    has_grid: bool,
    points: Option<Vec<f64>>,
    /// Ends of the cells (indices into the corners), and the corners.
    cells: Option<(Vec<f64>, Vec<f64>)>,
    types: Option<Vec<f64>>,
    /// Owner of the arrays that follow, and their number of tuples.
    owner: Option<(Owner, usize)>,
    point_arrays: Vec<DataArray>,
    cell_arrays: Vec<DataArray>,
}

impl Content {
    fn section(&mut self, file: &mut Reader<'_>, words: &[String], limits: &Limits) -> Result<(), ImportError> {
        let name = words.first().map(|w| w.to_ascii_uppercase()).unwrap_or_default();
        let word = |n: usize| {
            words.get(n).map(String::as_str).ok_or_else(|| fault(format!("the line `{name}` has too few words")))
        };
        let count = |n: usize| {
            let text = word(n)?;
            text.parse::<usize>().map_err(|_| fault(format!("`{name}`: `{text}` is not a count")))
        };
        match name.as_str() {
            "DATASET" if word(1)?.eq_ignore_ascii_case("UNSTRUCTURED_GRID") => self.has_grid = true,
            "DATASET" => {
                return Err(fault(format!("the data set is {}, expected UNSTRUCTURED_GRID", word(1)?)));
            }
            "POINTS" => {
                let n = count(1)?;
                at_most("points", n as u64, limits.max_cells)?;
                self.points = Some(file.numbers(n.saturating_mul(3), word(2)?)?);
            }
            "CELLS" => {
                let (n, size) = (count(1)?, count(2)?);
                at_most("cells", n as u64, limits.max_cells.saturating_add(1))?;
                self.cells = Some(if file.next_is(b"OFFSETS") { file.cells_5(n, size)? } else { file.cells(n, size)? });
            }
            "CELL_TYPES" => {
                let n = count(1)?;
                at_most("cells", n as u64, limits.max_cells)?;
                self.types = Some(file.numbers(n, "int")?);
            }
            "POINT_DATA" => self.owner = Some((Owner::Points, count(1)?)),
            "CELL_DATA" => self.owner = Some((Owner::Cells, count(1)?)),
            "SCALARS" => {
                let components = if words.len() > 3 { count(3)? } else { 1 };
                let (array, kind) = (word(1)?, word(2)?);
                if file.next_is(b"LOOKUP_TABLE") {
                    file.line();
                }
                self.array(file, array, kind, components)?;
            }
            "VECTORS" | "NORMALS" => self.array(file, word(1)?, word(2)?, 3)?,
            "TENSORS" => self.array(file, word(1)?, word(2)?, 9)?,
            "TENSORS6" => self.array(file, word(1)?, word(2)?, 6)?,
            "GLOBAL_IDS" | "PEDIGREE_IDS" => self.array(file, word(1)?, word(2)?, 1)?,
            "TEXTURE_COORDINATES" => self.array(file, word(1)?, word(3)?, count(2)?)?,
            "COLOR_SCALARS" => {
                let kind = if file.is_ascii { "float" } else { "unsigned_char" };
                self.array(file, word(1)?, kind, count(2)?)?;
            }
            "LOOKUP_TABLE" => {
                let kind = if file.is_ascii { "float" } else { "unsigned_char" };
                file.numbers(count(2)?.saturating_mul(4), kind)?;
            }
            "FIELD" => {
                for _ in 0..count(2)? {
                    let Some(head) = file.words_but_metadata()? else {
                        return Err(fault("a field ends before its arrays"));
                    };
                    self.field_array(file, &head)?;
                }
            }
            "METADATA" => file.skip_metadata(),
            _ => return Err(fault(format!("`{}` is not a known section", shown(name.as_bytes())))),
        }
        Ok(())
    }

    fn field_array(&mut self, file: &mut Reader<'_>, head: &[String]) -> Result<(), ImportError> {
        let [name, components, tuples, kind] = head else {
            return Err(fault("an array of a field needs name, components, tuples and type"));
        };
        let [Ok(components), Ok(tuples)] = [components, tuples].map(|text| text.parse::<usize>()) else {
            return Err(fault(format!("array `{}` of a field has invalid counts", shown(name.as_bytes()))));
        };
        let owner = self.owner.unwrap_or((Owner::Nobody, tuples));
        if owner.1 != tuples {
            let detail = format!("array `{}` has {tuples} tuples, expected {}", shown(name.as_bytes()), owner.1);
            return Err(fault(detail));
        }
        let before = self.owner.replace(owner);
        self.array(file, name, kind, components)?;
        self.owner = before;
        Ok(())
    }

    /// Reads the values of an array.
    fn array(&mut self, file: &mut Reader<'_>, name: &str, kind: &str, components: usize) -> Result<(), ImportError> {
        let Some((owner, n)) = self.owner else {
            return Err(fault(format!("array `{}` comes before POINT_DATA and CELL_DATA", shown(name.as_bytes()))));
        };
        if components == 0 {
            return Err(fault(format!("array `{}` has no components", shown(name.as_bytes()))));
        }
        let values = file.numbers(n.saturating_mul(components), kind)?;
        let arrays = match owner {
            Owner::Points => &mut self.point_arrays,
            Owner::Cells => &mut self.cell_arrays,
            Owner::Nobody => return Ok(()),
        };
        let name = decoded(name);
        if arrays.iter().any(|a| a.name == name) {
            return Err(fault(format!("two arrays have the name `{}`", shown(name.as_bytes()))));
        }
        arrays.push(DataArray { name, components, values });
        Ok(())
    }

    fn mesh(self) -> Result<(VolumeMesh, Vec<String>), ImportError> {
        if !self.has_grid {
            return Err(fault("there is no DATASET UNSTRUCTURED_GRID"));
        }
        let mut warnings = Vec::new();
        let points = points_from(FORMAT, &self.points.ok_or_else(|| fault("there are no POINTS"))?)?;
        let (ends, corners) = self.cells.ok_or_else(|| fault("there are no CELLS"))?;
        let types = self.types.ok_or_else(|| fault("there are no CELL_TYPES"))?;
        if types.len() != ends.len() {
            return Err(fault(format!("there are {} cells but {} types", ends.len(), types.len())));
        }
        let raw = RawCells { format: FORMAT, types: &types, ends: &ends, corners: &corners };
        let (cells, kept) = cells::from_raw(&raw, points.len(), &mut warnings)?;
        let right = |arrays: &[DataArray], n: usize, what: &str| {
            let wrong = arrays.iter().find(|a| a.values.len() != n.saturating_mul(a.components));
            wrong.map_or(Ok(()), |a| Err(fault(format!("array `{}` does not have a value for each {what}", a.name))))
        };
        right(&self.point_arrays, points.len(), "point")?;
        right(&self.cell_arrays, types.len(), "cell")?;
        let mut cell_arrays = self.cell_arrays;
        if let Some(kept) = kept {
            for array in &mut cell_arrays {
                let rows = array.values.chunks_exact(array.components).zip(&kept);
                array.values = rows.filter(|(_, kept)| **kept).flat_map(|(row, _)| row.iter().copied()).collect();
            }
        }
        let mesh = VolumeMesh { points, cells, point_arrays: self.point_arrays, cell_arrays };
        Ok(finished(mesh, warnings))
    }
}

/// Decodes a percent-encoded name: `%20` is a blank, `%25` a percent sign.
fn decoded(name: &str) -> String {
    let mut bytes = Vec::new();
    let mut rest = name.as_bytes();
    while let Some((&first, tail)) = rest.split_first() {
        let code = tail.get(..2).and_then(|hex| std::str::from_utf8(hex).ok()).filter(|_| first == b'%');
        match code.and_then(|hex| u8::from_str_radix(hex, 16).ok()) {
            Some(byte) => {
                bytes.push(byte);
                rest = tail.get(2..).unwrap_or_default();
            }
            None => {
                bytes.push(first);
                rest = tail;
            }
        }
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

fn kind_of(name: &str) -> Result<Kind, ImportError> {
    Ok(match name.to_ascii_lowercase().as_str() {
        "char" | "signed_char" | "vtktypeint8" => Kind::I8,
        "unsigned_char" | "vtktypeuint8" => Kind::U8,
        "short" | "vtktypeint16" => Kind::I16,
        "unsigned_short" | "vtktypeuint16" => Kind::U16,
        "int" | "vtkidtype" | "vtktypeint32" => Kind::I32,
        "unsigned_int" | "vtktypeuint32" => Kind::U32,
        "long" | "vtktypeint64" => Kind::I64,
        "unsigned_long" | "vtktypeuint64" => Kind::U64,
        "float" => Kind::F32,
        "double" => Kind::F64,
        other => return Err(fault(format!("values of type `{}` are not supported", shown(other.as_bytes())))),
    })
}

/// Reads the file from front to back.
struct Reader<'a> {
    rest: &'a [u8],
    is_ascii: bool,
}

impl<'a> Reader<'a> {
    /// The rest of the line, without the line end.
    fn line(&mut self) -> &'a [u8] {
        let end = self.rest.iter().position(|&c| c == b'\n').unwrap_or(self.rest.len());
        let (line, tail) = self.rest.split_at(end);
        self.rest = tail.split_first().map_or(&[], |(_, tail)| tail);
        line
    }

    /// The words of the next line that has words; `None` at the end of the file.
    fn words(&mut self) -> Result<Option<Vec<String>>, ImportError> {
        self.rest = self.rest.trim_ascii_start();
        if self.rest.is_empty() {
            return Ok(None);
        }
        let line = self.line();
        let text = std::str::from_utf8(line)
            .map_err(|_| fault(format!("a line of text was expected, found `{}`", shown(line))))?;
        Ok(Some(text.split_ascii_whitespace().map(str::to_owned).collect()))
    }

    fn words_but_metadata(&mut self) -> Result<Option<Vec<String>>, ImportError> {
        while self.next_is(b"METADATA") {
            self.line();
            self.skip_metadata();
        }
        self.words()
    }

    /// Skips everything up to and including the next empty line.
    fn skip_metadata(&mut self) {
        while !self.rest.is_empty() && !self.line().trim_ascii().is_empty() {}
    }

    fn next_is(&self, word: &[u8]) -> bool {
        let rest = self.rest.trim_ascii_start();
        rest.get(..word.len()).is_some_and(|head| head.eq_ignore_ascii_case(word))
    }

    /// The next `n` numbers.
    fn numbers(&mut self, n: usize, kind: &str) -> Result<Vec<f64>, ImportError> {
        let kind = kind_of(kind)?;
        let short = || fault(format!("the file ends before {n} numbers"));
        if !self.is_ascii {
            let (head, tail) = self.rest.split_at_checked(n.saturating_mul(kind.size())).ok_or_else(short)?;
            self.rest = tail;
            return Ok(kind.all(head, false));
        }
        // Each number takes at least a digit: refuses impossible counts before anything is allocated.
        if n > self.rest.len() {
            return Err(short());
        }
        let mut numbers = Vec::with_capacity(n);
        for _ in 0..n {
            self.rest = self.rest.trim_ascii_start();
            let end = self.rest.iter().position(u8::is_ascii_whitespace).unwrap_or(self.rest.len());
            let (word, tail) = self.rest.split_at(end);
            if word.is_empty() {
                return Err(short());
            }
            self.rest = tail;
            numbers.push(number(word).ok_or_else(|| fault(format!("`{}` is not a number", shown(word))))?);
        }
        Ok(numbers)
    }

    /// Reads cells up to version 4: per cell the number of corners and the corners, `size` numbers in all.
    ///
    /// Returns the ends of the cells and the corners.
    fn cells(&mut self, n: usize, size: usize) -> Result<(Vec<f64>, Vec<f64>), ImportError> {
        let numbers = self.numbers(size, "int")?;
        let wrong = || fault(format!("the {size} numbers of CELLS do not make {n} cells"));
        let (mut ends, mut corners) = (Vec::new(), Vec::new());
        let mut rest = numbers.as_slice();
        while let Some((&count, tail)) = rest.split_first() {
            let whole = count >= 0.0 && count.fract() == 0.0;
            let (mine, tail) = tail.split_at_checked(count as usize).filter(|_| whole).ok_or_else(wrong)?;
            corners.extend_from_slice(mine);
            ends.push(corners.len() as f64);
            rest = tail;
        }
        if ends.len() == n { Ok((ends, corners)) } else { Err(wrong()) }
    }

    /// Reads cells from version 5.1 on: `n` offsets, then `size` corners.
    fn cells_5(&mut self, n: usize, size: usize) -> Result<(Vec<f64>, Vec<f64>), ImportError> {
        let mut part = |name: &str, n: usize| {
            let words = self.words()?.unwrap_or_default();
            match words.as_slice() {
                [found, kind] if found.eq_ignore_ascii_case(name) => self.numbers(n, kind),
                _ => Err(fault(format!("CELLS has no line `{name}` with a type"))),
            }
        };
        let offsets = part("OFFSETS", n)?;
        let corners = part("CONNECTIVITY", size)?;
        match offsets.split_first() {
            Some((&0.0, ends)) => Ok((ends.to_vec(), corners)),
            Some(_) => Err(fault("the offsets of CELLS do not begin with 0")),
            None => Ok((Vec::new(), corners)),
        }
    }
}
