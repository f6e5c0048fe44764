//! Reads legacy VTK files (`.vtk`) of unstructured grids, ASCII or binary.
//!
//! Cells may have the layout of versions up to 4 or that from version 5.1 on.
//!
//! # Source
//! VTK File Formats for VTK version 4.2, and the notes on version 5.1 in VTK's documentation.

use super::cells::{self, RawCells};
use super::{points_from, with_warnings};
use crate::import::error::{at_most, malformed};
use crate::import::number::{ByteOrder, NumberType};
use crate::import::text::number;
use crate::import::{ImportError, Limits};
use prosopon_geometry::{DataArray, VolumeMesh, Warning};

pub(super) const FORMAT: &str = "legacy VTK";

/// Whether `bytes` begin like a legacy VTK file.
#[must_use]
pub fn is_legacy_vtk(bytes: &[u8]) -> bool {
    bytes.trim_ascii_start().starts_with(b"# vtk DataFile")
}

/// Reads a legacy file.
pub(super) fn read(bytes: &[u8], limits: &Limits) -> Result<(VolumeMesh, Vec<Warning>), ImportError> {
    let mut file = Reader { rest: bytes.trim_ascii_start(), length: bytes.len(), is_ascii: true };
    // Skips the version and the title.
    file.line();
    file.line();
    file.is_ascii = match file.line().trim_ascii().to_ascii_uppercase().as_slice() {
        b"ASCII" => true,
        b"BINARY" => false,
        _ => return Err(fault("line 3: expected ASCII or BINARY")),
    };
    let mut content = Content::default();
    while let Some(line) = file.words()? {
        content.section(&mut file, &line, limits)?;
    }
    content.mesh()
}

fn fault(detail: impl Into<String>) -> ImportError {
    malformed(FORMAT, detail)
}

/// The words of a line, and the byte at which it begins.
struct Line {
    byte: usize,
    words: Vec<String>,
}

/// Cells of a file: for each the end of its corners in `corners`.
#[derive(Debug, Default)]
struct CellLists {
    ends: Vec<f64>,
    corners: Vec<f64>,
}

/// Section of the arrays that follow: their owner and the number of its tuples.
#[derive(Debug, Clone, Copy)]
struct Attributes {
    owner: Owner,
    n_tuples: usize,
}

/// Description of an array; `byte` is where that begins.
struct ArrayHead<'a> {
    byte: usize,
    name: &'a str,
    number_type: &'a str,
    components: usize,
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
    cells: Option<CellLists>,
    types: Option<Vec<f64>>,
    /// Owner of the arrays that follow.
    attributes: Option<Attributes>,
    point_arrays: Vec<DataArray>,
    cell_arrays: Vec<DataArray>,
}

impl Content {
    fn section(&mut self, file: &mut Reader<'_>, line: &Line, limits: &Limits) -> Result<(), ImportError> {
        let words = &line.words;
        let name = words.first().map(|w| w.to_ascii_uppercase()).unwrap_or_default();
        // Only sections that the format knows ask for words, so that errors name no text of the file.
        let word = |n: usize| {
            words.get(n).map(String::as_str).ok_or_else(|| fault(format!("the line `{name}` has too few words")))
        };
        let count = |n: usize| {
            let expected =
                || fault(format!("`{name}` at byte {}: word {} is not a count", line.byte, n.saturating_add(1)));
            word(n)?.parse::<usize>().map_err(|_| expected())
        };
        match name.as_str() {
            "DATASET" if word(1)?.eq_ignore_ascii_case("UNSTRUCTURED_GRID") => self.has_grid = true,
            "DATASET" => return Err(fault("the data set has another type, expected UNSTRUCTURED_GRID")),
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
            "POINT_DATA" => self.attributes = Some(Attributes { owner: Owner::Points, n_tuples: count(1)? }),
            "CELL_DATA" => self.attributes = Some(Attributes { owner: Owner::Cells, n_tuples: count(1)? }),
            "LOOKUP_TABLE" => {
                let number_type = file.color_type();
                file.numbers(count(2)?.saturating_mul(4), number_type)?;
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
            _ => {
                let (number_type, components) = match name.as_str() {
                    "SCALARS" => (word(2)?, if words.len() > 3 { count(3)? } else { 1 }),
                    "VECTORS" | "NORMALS" => (word(2)?, 3),
                    "TENSORS" => (word(2)?, 9),
                    "TENSORS6" => (word(2)?, 6),
                    "GLOBAL_IDS" | "PEDIGREE_IDS" => (word(2)?, 1),
                    "TEXTURE_COORDINATES" => (word(3)?, count(2)?),
                    "COLOR_SCALARS" => (file.color_type(), count(2)?),
                    _ => {
                        return Err(fault(format!(
                            "byte {}: expected a section of the format, such as POINTS",
                            line.byte
                        )));
                    }
                };
                if name == "SCALARS" && file.next_is(b"LOOKUP_TABLE") {
                    file.line();
                }
                self.array(file, &ArrayHead { byte: line.byte, name: word(1)?, number_type, components })?;
            }
        }
        Ok(())
    }

    fn field_array(&mut self, file: &mut Reader<'_>, line: &Line) -> Result<(), ImportError> {
        let byte = line.byte;
        let [name, components, tuples, number_type] = line.words.as_slice() else {
            return Err(fault(format!("byte {byte}: expected name, components, tuples and type of a field's array")));
        };
        let [Ok(components), Ok(tuples)] = [components, tuples].map(|text| text.parse::<usize>()) else {
            return Err(fault(format!("byte {byte}: expected numbers of components and tuples of a field's array")));
        };
        let attributes = self.attributes.unwrap_or(Attributes { owner: Owner::Nobody, n_tuples: tuples });
        if attributes.n_tuples != tuples {
            let detail = format!("the array at byte {byte} has {tuples} tuples, expected {}", attributes.n_tuples);
            return Err(fault(detail));
        }
        let before = self.attributes.replace(attributes);
        self.array(file, &ArrayHead { byte, name, number_type, components })?;
        self.attributes = before;
        Ok(())
    }

    /// Reads the values of an array.
    fn array(&mut self, file: &mut Reader<'_>, head: &ArrayHead<'_>) -> Result<(), ImportError> {
        let &ArrayHead { byte, name, number_type, components } = head;
        let Some(Attributes { owner, n_tuples }) = self.attributes else {
            return Err(fault(format!("the array at byte {byte} comes before POINT_DATA and CELL_DATA")));
        };
        if components == 0 {
            return Err(fault(format!("the array at byte {byte} has no components")));
        }
        let values = file.numbers(n_tuples.saturating_mul(components), number_type)?;
        let arrays = match owner {
            Owner::Points => &mut self.point_arrays,
            Owner::Cells => &mut self.cell_arrays,
            Owner::Nobody => return Ok(()),
        };
        let name = decoded(name);
        if arrays.iter().any(|a| a.name == name) {
            return Err(fault(format!("the array at byte {byte} has the name of an earlier array")));
        }
        arrays.push(DataArray { name, components, values });
        Ok(())
    }

    fn mesh(self) -> Result<(VolumeMesh, Vec<Warning>), ImportError> {
        if !self.has_grid {
            return Err(fault("there is no DATASET UNSTRUCTURED_GRID"));
        }
        let mut warnings = Vec::new();
        let points = points_from(FORMAT, &self.points.ok_or_else(|| fault("there are no POINTS"))?)?;
        let CellLists { ends, corners } = self.cells.ok_or_else(|| fault("there are no CELLS"))?;
        let types = self.types.ok_or_else(|| fault("there are no CELL_TYPES"))?;
        if types.len() != ends.len() {
            return Err(fault(format!("there are {} cells but {} types", ends.len(), types.len())));
        }
        let raw = RawCells { format: FORMAT, types: &types, ends: &ends, corners: &corners };
        let found = cells::from_raw(&raw, points.len(), &mut warnings)?;
        check_lengths(&self.point_arrays, points.len(), "POINT_DATA")?;
        check_lengths(&self.cell_arrays, types.len(), "CELL_DATA")?;
        let mut cell_arrays = self.cell_arrays;
        for array in &mut cell_arrays {
            array.values = found.kept_values(std::mem::take(&mut array.values), array.components);
        }
        let mesh = VolumeMesh { points, cells: found.cells, point_arrays: self.point_arrays, cell_arrays };
        Ok(with_warnings(mesh, warnings))
    }
}

/// Requires one value for each of the `n` points or cells, and each component.
fn check_lengths(arrays: &[DataArray], n: usize, section: &str) -> Result<(), ImportError> {
    let wrong = arrays.iter().position(|a| a.values.len() != n.saturating_mul(a.components));
    wrong.map_or(Ok(()), |index| {
        let number = index.saturating_add(1);
        Err(fault(format!("array {number} of {section} does not have the {n} tuples of the grid")))
    })
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

/// The number type with the name `name` in this format.
fn number_type_named(name: &str) -> Option<NumberType> {
    Some(match name.to_ascii_lowercase().as_str() {
        "char" | "signed_char" | "vtktypeint8" => NumberType::I8,
        "unsigned_char" | "vtktypeuint8" => NumberType::U8,
        "short" | "vtktypeint16" => NumberType::I16,
        "unsigned_short" | "vtktypeuint16" => NumberType::U16,
        "int" | "vtkidtype" | "vtktypeint32" => NumberType::I32,
        "unsigned_int" | "vtktypeuint32" => NumberType::U32,
        "long" | "vtktypeint64" => NumberType::I64,
        "unsigned_long" | "vtktypeuint64" => NumberType::U64,
        "float" => NumberType::F32,
        "double" => NumberType::F64,
        _ => return None,
    })
}

/// Reads the file from front to back.
struct Reader<'a> {
    rest: &'a [u8],
    /// Length of the file.
    length: usize,
    is_ascii: bool,
}

impl<'a> Reader<'a> {
    /// Index of the next byte.
    fn byte(&self) -> usize {
        self.length.saturating_sub(self.rest.len())
    }

    /// Type of the components of colours.
    fn color_type(&self) -> &'static str {
        if self.is_ascii { "float" } else { "unsigned_char" }
    }

    /// The rest of the line, without the line end.
    fn line(&mut self) -> &'a [u8] {
        let end = self.rest.iter().position(|&c| c == b'\n').unwrap_or(self.rest.len());
        let (line, tail) = self.rest.split_at(end);
        self.rest = tail.split_first().map_or(&[], |(_, tail)| tail);
        line
    }

    /// The words of the next line that has words; `None` at the end of the file.
    fn words(&mut self) -> Result<Option<Line>, ImportError> {
        self.rest = self.rest.trim_ascii_start();
        if self.rest.is_empty() {
            return Ok(None);
        }
        let byte = self.byte();
        let text = std::str::from_utf8(self.line());
        let text = text.map_err(|_| fault(format!("byte {byte}: expected a line of text")))?;
        Ok(Some(Line { byte, words: text.split_ascii_whitespace().map(str::to_owned).collect() }))
    }

    fn words_but_metadata(&mut self) -> Result<Option<Line>, ImportError> {
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

    /// The next `n` numbers, of the type with the name `number_type`.
    fn numbers(&mut self, n: usize, number_type: &str) -> Result<Vec<f64>, ImportError> {
        let unknown = || fault(format!("the numbers from byte {} on have a type that is not supported", self.byte()));
        let number_type = number_type_named(number_type).ok_or_else(unknown)?;
        let short = || fault(format!("the file ends before {n} numbers"));
        if !self.is_ascii {
            let (head, tail) = self.rest.split_at_checked(n.saturating_mul(number_type.size())).ok_or_else(short)?;
            self.rest = tail;
            return Ok(number_type.all(head, ByteOrder::Big));
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
            numbers.push(number(word).ok_or_else(|| fault(format!("byte {}: expected a number", self.byte())))?);
            self.rest = tail;
        }
        Ok(numbers)
    }

    /// Reads cells up to version 4: per cell the number of corners and the corners, `size` numbers in all.
    fn cells(&mut self, n: usize, size: usize) -> Result<CellLists, ImportError> {
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
        if ends.len() == n { Ok(CellLists { ends, corners }) } else { Err(wrong()) }
    }

    /// Reads cells from version 5.1 on: `n` offsets, then `size` corners.
    fn cells_5(&mut self, n: usize, size: usize) -> Result<CellLists, ImportError> {
        let mut part = |name: &str, n: usize| {
            let words = self.words()?.map_or_else(Vec::new, |line| line.words);
            match words.as_slice() {
                [found, number_type] if found.eq_ignore_ascii_case(name) => self.numbers(n, number_type),
                _ => Err(fault(format!("CELLS has no line `{name}` with a type"))),
            }
        };
        let offsets = part("OFFSETS", n)?;
        let corners = part("CONNECTIVITY", size)?;
        match offsets.split_first() {
            Some((&0.0, ends)) => Ok(CellLists { ends: ends.to_vec(), corners }),
            Some(_) => Err(fault("the offsets of CELLS do not begin with 0")),
            None => Ok(CellLists { ends: Vec::new(), corners }),
        }
    }
}
