//! Reads the XML part: the arrays and the position of their numbers.

use std::borrow::Cow;

use super::FORMAT;
use crate::import::ImportError;
use crate::import::error::malformed;
use crate::import::number::{ByteOrder, NumberType};
use crate::import::stated::Stated;
use quick_xml::Reader;
use quick_xml::events::{BytesStart, Event};

/// Most components of an array; no solver writes so many. Bounds products.
const MAX_COMPONENTS: usize = 1000;

/// Part of the file that holds an array.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Section {
    Points,
    Cells,
    PointData,
    CellData,
    Polys,
    Strips,
    /// Values of the whole file; of those of a surface only what may state the coordinate system or the unit is kept.
    FieldData,
}

/// Supported types of VTK data sets.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Grid {
    UnstructuredGrid,
    PolyData,
}

/// Encoding and position of an array's numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Content<'a> {
    Ascii(&'a [u8]),
    Base64(&'a [u8]),
    /// Offset into the appended data.
    Appended(usize),
}

/// An array as the XML describes it.
#[derive(Debug, Clone)]
pub(super) struct RawArray<'a> {
    pub(super) section: Section,
    /// Index of the array in its section.
    pub(super) place: usize,
    pub(super) name: String,
    /// Type of the numbers; `None` for text.
    pub(super) number_type: Option<NumberType>,
    pub(super) components: usize,
    pub(super) content: Content<'a>,
}

impl RawArray<'_> {
    /// Index and section, for messages.
    pub(super) fn place(&self) -> String {
        format!("array {} of {:?}", self.place, self.section)
    }
}

/// Encoding of the appended data.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Appended<'a> {
    Raw(&'a [u8]),
    Base64(&'a [u8]),
}

/// The content of the XML part.
#[derive(Debug)]
pub(super) struct VtkXml<'a> {
    pub(super) byte_order: ByteOrder,
    /// Whether lengths take eight bytes instead of four.
    pub(super) wide_header: bool,
    pub(super) zlib: bool,
    pub(super) n_points: usize,
    /// Number of cells of a grid, or of polygons of a surface.
    pub(super) n_cells: usize,
    /// Number of triangle strips of a surface.
    pub(super) n_strips: usize,
    pub(super) arrays: Vec<RawArray<'a>>,
    pub(super) appended: Option<Appended<'a>>,
    /// What the comments state about the coordinates.
    pub(super) stated: Stated,
}

/// The number type with the VTK name `name`.
fn number_type_named(name: &str) -> Option<NumberType> {
    Some(match name {
        "Int8" => NumberType::I8,
        "UInt8" => NumberType::U8,
        "Int16" => NumberType::I16,
        "UInt16" => NumberType::U16,
        "Int32" => NumberType::I32,
        "UInt32" => NumberType::U32,
        "Int64" => NumberType::I64,
        "UInt64" => NumberType::U64,
        "Float32" => NumberType::F32,
        "Float64" => NumberType::F64,
        _ => return None,
    })
}

fn fault(detail: impl Into<String>) -> ImportError {
    malformed(FORMAT, detail)
}

/// An attribute's value.
fn attribute(tag: &BytesStart<'_>, name: &str) -> Result<Option<String>, ImportError> {
    let found = tag.try_get_attribute(name).map_err(|_| fault("an attribute is not well formed"))?;
    found.map(|a| a.unescape_value().map(|v| v.into_owned()).map_err(|_| fault("an attribute is not text"))).transpose()
}

fn count(tag: &BytesStart<'_>, name: &str) -> Result<usize, ImportError> {
    let text = attribute(tag, name)?.ok_or_else(|| fault(format!("{name} is missing")))?;
    text.trim().parse().map_err(|_| fault(format!("{name} is not a count")))
}

/// Form of an XML element.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum TagForm {
    /// `<a/>`
    Empty,
    /// `<a>`, whose content follows.
    Open,
}

/// State of the parser.
struct Parser<'a> {
    file: VtkXml<'a>,
    section: Option<Section>,
    /// The inline array that is open.
    open: Option<RawArray<'a>>,
    /// Whether the parser is within the information on an array, which may stand beside its numbers.
    in_key: bool,
    pieces: usize,
    expected: Grid,
    is_grid: bool,
}

impl<'a> VtkXml<'a> {
    pub(super) fn parse(bytes: &'a [u8], expected: Grid) -> Result<Self, ImportError> {
        let mut reader = Reader::from_reader(bytes);
        let file = VtkXml {
            byte_order: ByteOrder::Little,
            wide_header: false,
            zlib: false,
            n_points: 0,
            n_cells: 0,
            n_strips: 0,
            arrays: Vec::new(),
            appended: None,
            stated: Stated::default(),
        };
        let mut parser = Parser { file, section: None, open: None, in_key: false, pieces: 0, expected, is_grid: false };
        let mut depth = 0usize;
        loop {
            let event = reader.read_event().map_err(|e| {
                let what = match e {
                    quick_xml::Error::Syntax(_) => "has a syntax error",
                    quick_xml::Error::IllFormed(_) => "is not well formed",
                    quick_xml::Error::Io(_)
                    | quick_xml::Error::InvalidAttr(_)
                    | quick_xml::Error::Encoding(_)
                    | quick_xml::Error::Escape(_)
                    | quick_xml::Error::Namespace(_) => "cannot be read",
                };
                fault(format!("the XML {what} near byte {}", reader.error_position()))
            })?;
            match event {
                Event::Start(tag) if tag.name().as_ref() == b"AppendedData" => {
                    // The bytes that follow need not be XML.
                    let rest = usize::try_from(reader.buffer_position()).ok().and_then(|at| bytes.get(at..));
                    parser.file.appended = Some(appended(&tag, rest.unwrap_or_default())?);
                    break;
                }
                Event::Start(tag) => {
                    depth = depth.saturating_add(1);
                    parser.begin(&tag, TagForm::Open)?;
                }
                Event::Empty(tag) => parser.begin(&tag, TagForm::Empty)?,
                Event::Text(text) => {
                    if let Cow::Borrowed(inside) = text.into_inner() {
                        parser.text(inside);
                    }
                }
                Event::End(tag) => {
                    depth = depth.saturating_sub(1);
                    parser.end(tag.name().as_ref());
                }
                Event::Eof if depth > 0 => return Err(fault("the XML is cut off")),
                Event::Eof => break,
                Event::Comment(text) => parser.file.stated.read(&text.into_inner()),
                Event::CData(_) | Event::Decl(_) | Event::PI(_) | Event::DocType(_) | Event::GeneralRef(_) => {}
            }
        }
        if !parser.is_grid {
            return Err(fault(format!("there is no VTKFile of type {expected:?}")));
        }
        if parser.pieces != 1 {
            return Err(fault(format!("{} pieces, expected 1: merge them first", parser.pieces)));
        }
        Ok(parser.file)
    }
}

impl<'a> Parser<'a> {
    fn begin(&mut self, tag: &BytesStart<'_>, form: TagForm) -> Result<(), ImportError> {
        match tag.name().as_ref() {
            b"VTKFile" => self.head(tag)?,
            b"Piece" => {
                self.pieces = self.pieces.saturating_add(1);
                self.file.n_points = count(tag, "NumberOfPoints")?;
                match self.expected {
                    Grid::UnstructuredGrid => self.file.n_cells = count(tag, "NumberOfCells")?,
                    Grid::PolyData => {
                        self.file.n_cells = count(tag, "NumberOfPolys")?;
                        self.file.n_strips = count(tag, "NumberOfStrips").unwrap_or(0);
                    }
                }
            }
            b"Points" => self.section = Some(Section::Points),
            b"Cells" => self.section = Some(Section::Cells),
            b"PointData" => self.section = Some(Section::PointData),
            b"CellData" => self.section = Some(Section::CellData),
            b"Polys" => self.section = Some(Section::Polys),
            b"Strips" => self.section = Some(Section::Strips),
            // Points and lines are not part of a surface.
            b"Verts" | b"Lines" => self.section = None,
            b"FieldData" => self.section = (self.expected == Grid::PolyData).then_some(Section::FieldData),
            b"InformationKey" => self.in_key = form == TagForm::Open,
            b"DataArray" | b"Array" if self.section == Some(Section::FieldData) => self.field_array(tag, form),
            b"DataArray" | b"Array" => self.array(tag, form)?,
            _ => {}
        }
        if form == TagForm::Empty && !matches!(tag.name().as_ref(), b"DataArray" | b"Array" | b"InformationKey") {
            self.section = None;
        }
        Ok(())
    }

    fn head(&mut self, tag: &BytesStart<'_>) -> Result<(), ImportError> {
        let kind = attribute(tag, "type")?.unwrap_or_default();
        if kind != format!("{:?}", self.expected) {
            return Err(fault(format!("the VTKFile has another type, expected {:?}", self.expected)));
        }
        self.is_grid = true;
        self.file.byte_order = match attribute(tag, "byte_order")?.as_deref() {
            None | Some("LittleEndian") => ByteOrder::Little,
            Some("BigEndian") => ByteOrder::Big,
            Some(_) => return Err(fault("unknown byte_order, expected LittleEndian or BigEndian")),
        };
        self.file.wide_header = match attribute(tag, "header_type")?.as_deref() {
            None | Some("UInt32") => false,
            Some("UInt64") => true,
            Some(_) => return Err(fault("unknown header_type, expected UInt32 or UInt64")),
        };
        self.file.zlib = match attribute(tag, "compressor")?.as_deref() {
            None | Some("") => false,
            Some("vtkZLibDataCompressor") => true,
            Some(_) => {
                return Err(fault(
                    "unknown compressor, expected a file without compression or with vtkZLibDataCompressor",
                ));
            }
        };
        Ok(())
    }

    fn array(&mut self, tag: &BytesStart<'_>, form: TagForm) -> Result<(), ImportError> {
        let Some(section) = self.section else { return Ok(()) };
        let name = attribute(tag, "Name")?.unwrap_or_default();
        let components = match attribute(tag, "NumberOfComponents")? {
            None => 1,
            Some(text) => text
                .trim()
                .parse()
                .ok()
                .filter(|n| (1..=MAX_COMPONENTS).contains(n))
                .ok_or_else(|| fault(format!("NumberOfComponents of an array is not 1 to {MAX_COMPONENTS}")))?,
        };
        let number_type = number_type_named(attribute(tag, "type")?.as_deref().unwrap_or_default());
        let place = self.file.arrays.iter().filter(|a| a.section == section).count();
        let mut array = RawArray { section, place, name, number_type, components, content: Content::Ascii(&[]) };
        let is_inline = match attribute(tag, "format")?.as_deref() {
            None | Some("ascii") => true,
            Some("binary") => {
                array.content = Content::Base64(&[]);
                true
            }
            Some("appended") => {
                array.content = Content::Appended(count(tag, "offset")?);
                false
            }
            Some(_) => return Err(fault("unknown format of an array, expected ascii, binary or appended")),
        };
        if is_inline && form == TagForm::Open {
            self.open = Some(array);
        } else {
            self.file.arrays.push(array);
        }
        Ok(())
    }

    /// Takes a field array that may state the coordinate system or the unit. Faults in others do not matter.
    fn field_array(&mut self, tag: &BytesStart<'_>, form: TagForm) {
        let name = attribute(tag, "Name").ok().flatten().unwrap_or_default();
        if Stated::is_name(&name) && self.array(tag, form).is_err() {
            self.file.stated.read_value(&name, b"?");
        }
    }

    fn text(&mut self, text: &'a [u8]) {
        if let Some(array) = &mut self.open
            && !self.in_key
            && !text.trim_ascii().is_empty()
        {
            array.content = match array.content {
                Content::Base64(_) => Content::Base64(text),
                Content::Ascii(_) | Content::Appended(_) => Content::Ascii(text),
            };
        }
    }

    fn end(&mut self, name: &[u8]) {
        match name {
            b"DataArray" | b"Array" => {
                if let Some(array) = self.open.take() {
                    self.file.arrays.push(array);
                }
            }
            b"InformationKey" => self.in_key = false,
            b"Points" | b"Cells" | b"PointData" | b"CellData" | b"Polys" | b"Strips" | b"FieldData" => {
                self.section = None;
            }
            _ => {}
        }
    }
}

/// The appended data after the mark `_`, up to the closing tag when they are text.
fn appended<'a>(tag: &BytesStart<'_>, rest: &'a [u8]) -> Result<Appended<'a>, ImportError> {
    let mark = rest.iter().position(|c| !c.is_ascii_whitespace()).filter(|&at| rest.get(at) == Some(&b'_'));
    let data = mark.and_then(|at| rest.get(at.saturating_add(1)..));
    let data = data.ok_or_else(|| fault("the appended data do not begin with `_`"))?;
    match attribute(tag, "encoding")?.as_deref() {
        Some("raw") => Ok(Appended::Raw(data)),
        None | Some("base64") => {
            let end = data.iter().position(|&c| c == b'<').unwrap_or(data.len());
            Ok(Appended::Base64(data.get(..end).unwrap_or_default()))
        }
        Some(_) => Err(fault("unknown encoding of the appended data, expected raw or base64")),
    }
}
