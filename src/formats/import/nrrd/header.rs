//! Fields of an NRRD header.

/// Most bytes of a header.
const MAX_HEADER: usize = 1 << 16;

/// The fields, and where the voxels are.
#[derive(Debug)]
pub(super) struct Header<'a> {
    fields: Vec<(String, &'a str)>,
    /// Names after `data file: LIST`, one a line.
    pub(super) list: Vec<&'a str>,
    /// The bytes after the empty line that ends the header; `None` when it ends with the file.
    pub(super) attached: Option<&'a [u8]>,
}

impl<'a> Header<'a> {
    /// The fields of `bytes`; `None` when no empty line ends them and no field names a voxel file.
    ///
    /// Lines that are not text and pairs of key and value are skipped.
    pub(super) fn read(bytes: &'a [u8]) -> Option<Self> {
        let mut rest = bytes.get(..bytes.len().min(MAX_HEADER))?;
        let mut header = Self { fields: Vec::new(), list: Vec::new(), attached: None };
        let (mut read, mut in_list) = (0usize, false);
        while !rest.is_empty() {
            let length = rest.iter().position(|b| *b == b'\n').map_or(rest.len(), |at| at.saturating_add(1));
            let (line, after) = rest.split_at(length);
            (read, rest) = (read.saturating_add(length), after);
            if line == b"\n" || line == b"\r\n" {
                header.attached = bytes.get(read..);
                break;
            }
            let Ok(line) = std::str::from_utf8(line) else { continue };
            if in_list {
                header.list.push(line.trim());
            } else if let Some((name, value)) = line.split_once(": ").filter(|_| !line.starts_with('#')) {
                let name = name.trim().to_ascii_lowercase();
                in_list = is_data_file(&name) && value.split_whitespace().next() == Some("LIST");
                header.fields.push((name, value.trim()));
            }
        }
        (header.attached.is_some() || header.data_file().is_some()).then_some(header)
    }

    /// Value of the first field with one of these names, which are in lower case.
    pub(super) fn field(&self, names: &[&str]) -> Option<&'a str> {
        self.fields.iter().find(|(name, _)| names.contains(&name.as_str())).map(|(_, value)| *value)
    }

    /// The field that names one or several voxel files.
    pub(super) fn data_file(&self) -> Option<&'a str> {
        self.fields.iter().find(|(name, _)| is_data_file(name)).map(|(_, value)| *value)
    }
}

fn is_data_file(name: &str) -> bool {
    matches!(name, "data file" | "datafile")
}
