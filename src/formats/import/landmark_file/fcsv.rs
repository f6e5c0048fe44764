//! Reads Slicer's lists of fiducials: `.fcsv` of every version, and the table of control points that it exports as CSV.

use super::super::ImportError;
use super::super::error::{at_most, malformed};
use super::{LandmarkFile, LandmarkFrame};

const FORMAT: &str = "fcsv";
/// Columns since Slicer 4, where the file names none; two more without a name follow since Slicer 5.
const COLUMNS: &str = "id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label,desc,associatedNodeID";
/// Columns of Slicer 3, whose files state no version.
const COLUMNS_OF_SLICER_3: &str = "label,x,y,z,sel,vis";
/// Value of the first unnamed column for a point that has been placed.
const DEFINED: &str = "2";
/// Most points; a head has some hundred landmarks.
const MAX_POINTS: usize = 10_000;
/// Lines in which the header is looked for.
const HEADER_LINES: usize = 20;

/// Whether these may be the bytes of such a list.
#[must_use]
pub fn looks_like_fiducials(bytes: &[u8]) -> bool {
    let text = text_of(bytes);
    let mut lines = text.lines().map(str::trim).filter(|line| !line.is_empty()).take(HEADER_LINES).peekable();
    let is_table = lines.peek().is_some_and(|line| table_columns(line).is_some());
    let is_header = |line: &str| {
        let comment = line.strip_prefix('#').map(str::to_ascii_lowercase);
        comment.is_some_and(|c| ["fiducial", "coordinatesystem", "columns"].iter().any(|word| c.contains(word)))
    };
    is_table || lines.take_while(|line| line.starts_with('#')).any(is_header)
}

/// Reads the points of such a list.
///
/// Fields are separated by commas or semicolons, and may be quoted. A header names columns and coordinate system. Files without
/// a coordinate system are RAS, as in Slicer. Points that Slicer marks as not placed are left out.
///
/// # Errors
/// [`ImportError::Malformed`] with the line of the fault.
pub fn fiducials(bytes: &[u8]) -> Result<LandmarkFile, ImportError> {
    if bytes.trim_ascii().is_empty() {
        return Err(ImportError::Empty);
    }
    let text = text_of(bytes);
    let mut header = Header::default();
    let mut file = LandmarkFile::default();
    for (number, line) in (1u64..).zip(text.lines()) {
        let line = line.trim();
        if line.is_empty() {
            continue;
        }
        if let Some(comment) = line.strip_prefix('#') {
            header.take(comment.trim(), number)?;
        } else if let Some(columns) = table_columns(line).filter(|_| header.columns.is_none()) {
            header.frame = header.frame.or(columns.frame);
            header.columns = Some(columns);
        } else {
            at_most("landmarks", file.points.len() as u64, MAX_POINTS - 1)?;
            header.columns_of(line).read(line, number, header.frame, &mut file)?;
        }
    }
    file.assumed = if header.frame.is_none() { Some(LandmarkFrame::Ras) } else { None };
    Ok(file)
}

fn text_of(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes)).into_owned()
}

#[derive(Debug, Default)]
struct Header {
    has_version: bool,
    frame: Option<LandmarkFrame>,
    columns: Option<Columns>,
}

impl Header {
    fn take(&mut self, comment: &str, line: u64) -> Result<(), ImportError> {
        let Some((name, value)) = comment.split_once('=').map(|(n, v)| (n.trim().to_ascii_lowercase(), v.trim()))
        else {
            return Ok(());
        };
        match name.as_str() {
            "coordinatesystem" => {
                let detail = "the coordinate system is none of RAS (0) and LPS (1); save the points in one of them";
                let frame = LandmarkFrame::of(value);
                self.frame = Some(frame.ok_or_else(|| malformed(FORMAT, format!("line {line}: {detail}")))?);
            }
            "columns" => {
                let detail = "the columns have no x, y, z and label";
                let columns = Columns::of(value).filter(|c| c.label.is_some());
                self.columns = Some(columns.ok_or_else(|| malformed(FORMAT, format!("line {line}: {detail}")))?);
            }
            _ => self.has_version |= name.contains("version"),
        }
        Ok(())
    }

    /// The columns that the header names, else those of its version; a line shows its separator then.
    fn columns_of(&mut self, line: &str) -> Columns {
        if let Some(columns) = self.columns {
            return columns;
        }
        let names = if self.has_version { COLUMNS } else { COLUMNS_OF_SLICER_3 };
        let separator = if line.contains(';') { ';' } else { ',' };
        let columns = Columns { separator, ..Columns::of(names).unwrap_or_default() };
        self.columns = Some(columns);
        columns
    }
}

/// Places of what is read.
#[derive(Debug, Clone, Copy, Default)]
struct Columns {
    separator: char,
    position: [usize; 3],
    label: Option<usize>,
    id: Option<usize>,
    /// Whether the point has been placed: a column of its own, or the first one without a name.
    status: usize,
    /// Frame that the columns' names state.
    frame: Option<LandmarkFrame>,
}

impl Columns {
    fn of(names: &str) -> Option<Self> {
        let separator = if names.contains(';') { ';' } else { ',' };
        let names: Vec<String> = fields(names, separator).iter().map(|name| name.trim().to_ascii_lowercase()).collect();
        let at = |name: &str| names.iter().position(|n| n == name);
        let triple = |axes: [&str; 3]| Some([at(axes[0])?, at(axes[1])?, at(axes[2])?]);
        let (position, frame) = triple(["x", "y", "z"])
            .map(|p| (p, None))
            .or_else(|| Some((triple(["r", "a", "s"])?, Some(LandmarkFrame::Ras))))
            .or_else(|| Some((triple(["l", "p", "s"])?, Some(LandmarkFrame::Lps))))?;
        let status = at("defined").unwrap_or(names.len());
        Some(Self { separator, position, label: at("label"), id: at("id"), status, frame })
    }

    fn read(
        &self,
        line: &str,
        number: u64,
        frame: Option<LandmarkFrame>,
        file: &mut LandmarkFile,
    ) -> Result<(), ImportError> {
        let fields = fields(line, self.separator);
        let field = |at: usize| fields.get(at).map(|f| f.trim()).filter(|f| !f.is_empty());
        let label = self.label.and_then(field).or(self.id.and_then(field)).unwrap_or_default().to_owned();
        let status = field(self.status);
        let is_table = self.frame.is_some();
        if status.is_some_and(|status| if is_table { status == "0" } else { status != DEFINED }) {
            file.unplaced.push(label);
            return Ok(());
        }
        let mut position = [0.0; 3];
        for (axis, (coordinate, at)) in ["x", "y", "z"].iter().zip(position.iter_mut().zip(self.position)) {
            let word = field(at).unwrap_or_default();
            let read = word.parse().ok().or_else(|| {
                let read = word.replacen(',', ".", 1).parse().ok();
                file.has_decimal_commas |= read.is_some();
                read
            });
            *coordinate = read
                .filter(|c: &f64| c.is_finite())
                .ok_or_else(|| malformed(FORMAT, format!("line {number}: {axis} of the point is no number")))?;
        }
        file.push(label, position, frame.unwrap_or(LandmarkFrame::Ras));
        Ok(())
    }
}

/// Columns of an exported table, whose axes `r a s` or `l p s` state the frame.
fn table_columns(line: &str) -> Option<Columns> {
    Columns::of(line).filter(|columns| columns.frame.is_some() && columns.label.is_some())
}

/// Fields of a line. A field that begins with a quotation mark ends with one; two of them inside stand for one.
fn fields(line: &str, separator: char) -> Vec<String> {
    let (mut found, mut field, mut quoted) = (Vec::new(), String::new(), false);
    let mut rest = line.chars().peekable();
    while let Some(c) = rest.next() {
        match c {
            '"' if quoted && rest.peek() == Some(&'"') => {
                field.push('"');
                rest.next();
            }
            '"' if quoted => quoted = false,
            '"' if field.trim().is_empty() => {
                field.clear();
                quoted = true;
            }
            c if c == separator && !quoted => found.push(std::mem::take(&mut field)),
            c => field.push(c),
        }
    }
    found.push(field);
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    const SLICER_5: &str = "# Markups fiducial file version = 5.6\n# CoordinateSystem = LPS\n\
        # columns = id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label,desc,associatedNodeID\n";

    fn read(text: &str) -> LandmarkFile {
        assert!(looks_like_fiducials(text.as_bytes()), "{text}");
        fiducials(text.as_bytes()).unwrap()
    }

    /// The same two points in the forms of all versions.
    #[test]
    fn every_version_gives_the_same_points() {
        let points = vec![("ANS".to_owned(), [6.0, -84.5, 45.0]), ("Go, left".to_owned(), [50.0, 0.0, -8.25])];
        let rows = |x: f64, more: &str, label: &str| {
            format!(
                "1,{},{},45,0,0,0,1,1,1,0,ANS,,{more}\n2,{},0,-8.25,0,0,0,1,1,1,0,{label},,{more}\n",
                6.0 * x,
                -84.5 * x,
                50.0 * x
            )
        };
        let quoted = "\"Go, left\"";
        for (text, from_ras, assumed) in [
            (format!("{SLICER_5}{}", rows(1.0, ",2,0", quoted)), 0, None),
            (format!("{SLICER_5}{}", rows(1.0, "", quoted)).replace('\n', "\r\n"), 0, None),
            (format!("\u{feff}{}{}", SLICER_5.replace("LPS", "1"), rows(1.0, "", quoted)), 0, None),
            (format!("{}{}", SLICER_5.replace("5.6", "4.10").replace("LPS", "0"), rows(-1.0, "", quoted)), 2, None),
            (format!("{}{}", SLICER_5.replace("LPS", "RAS"), rows(-1.0, "", quoted)), 2, None),
            (format!("# Markups fiducial file version = 4.6\n{}", rows(-1.0, "", quoted)), 2, Some(LandmarkFrame::Ras)),
            (
                "# Fiducial List file a.fcsv\n# version = 2\n# name = L\n# columns = label,x,y,z,sel,vis\n\
                 ANS,-6,84.5,45,1,1\n\"Go, left\",-50,0,-8.25,1,1\n"
                    .to_owned(),
                2,
                Some(LandmarkFrame::Ras),
            ),
            (
                "# Fiducial List file a.fcsv\nANS,-6,84.5,45,1,1\n\"Go, left\",-50,0,-8.25,1,1\n".to_owned(),
                2,
                Some(LandmarkFrame::Ras),
            ),
            (
                "label,r,a,s,defined,selected,visible,locked,description\nANS,-6,84.5,45,1,1,1,0,\n\
                 \"Go, left\",-50,0,-8.25,1,1,1,0,\n"
                    .to_owned(),
                2,
                None,
            ),
            ("label,l,p,s\nANS,6,-84.5,45\n\"Go, left\",50,0,-8.25\n".to_owned(), 0, None),
        ] {
            let file = read(&text);
            assert_eq!((&file.points, file.from_ras, file.assumed), (&points, from_ras, assumed), "{text}");
            assert!(!file.has_decimal_commas && file.unplaced.is_empty());
        }
        let semicolons = SLICER_5.replace("id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label,desc,", "id;x;y;z;label;");
        let file = read(&format!("{semicolons}1;6,0;-84,5;45;ANS\n2;50;0;-8,25;Go, left\n"));
        assert_eq!((&file.points, file.has_decimal_commas), (&points, true));
    }

    #[test]
    fn points_that_are_not_placed_are_named() {
        let rows = "1,0,0,0,0,0,0,1,1,1,0,ANS,,,0,0\n2,1,2,3,0,0,0,1,1,1,0,A,,,2,0\n3,1,2,3,0,0,0,1,1,1,0,B,,,1,0\n";
        let file = read(&format!("{SLICER_5}{rows}"));
        assert_eq!(
            (file.points, file.unplaced),
            (vec![("A".into(), [1.0, 2.0, 3.0])], vec!["ANS".into(), "B".to_owned()])
        );
        let table = read("label,l,p,s,defined\nANS,0,0,0,0\nA,1,2,3,1\n");
        assert_eq!((table.points.len(), table.unplaced), (1, vec!["ANS".to_owned()]));
    }

    #[test]
    fn faulty_lists_are_refused_with_their_line() {
        for (text, part) in [
            ("# CoordinateSystem = 2\n", "line 1: the coordinate system is none of RAS (0) and LPS (1)"),
            ("# columns = id,x,y\n", "line 1: the columns have no x, y, z and label"),
            ("# columns = label,x,y,z\nANS,1,2\n", "line 2: z of the point is no number"),
            ("# columns = label,x,y,z\n\nANS,1,nan,3\n", "line 3: y of the point is no number"),
        ] {
            let error = fiducials(text.as_bytes()).unwrap_err().to_string();
            assert!(error.contains(part), "{text:?}: {error}");
        }
        let many = "a,1,2,3\n".repeat(MAX_POINTS + 1);
        assert!(matches!(fiducials(many.as_bytes()), Err(ImportError::TooLarge { .. })));
        for other in [&b"{\"points\": {}}"[..], b"# a comment\nv 1 2 3", b"ply\n", b"", b"ans,1,2,3\n"] {
            assert!(!looks_like_fiducials(other), "{other:?}");
        }
    }
}
