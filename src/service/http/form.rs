//! The one file of a `multipart/form-data` body (RFC 7578), as `curl -F file=@skin.stl` and web forms send it.
//!
//! The body streams with a bounded buffer: `multer`, which axum uses, keeps all that has arrived until it finds the next boundary,
//! which a client can leave out of gigabytes.

use axum::body::{BodyDataStream, Bytes};
use axum::http::{HeaderMap, header};
use bytes::{Buf, BytesMut};
use futures::StreamExt;
use prosopon_contract::FaultKind;

use super::Problem;

/// Longest header of a part, and longest text before the first part, bytes.
const MAX_HEAD: usize = 16 << 10;
/// Longest boundary, bytes; RFC 2046 allows 70.
const MAX_BOUNDARY: usize = 200;
/// Most bytes of a form beside its file: three boundaries and two headers.
pub(super) const OVERHEAD: u64 = 64 << 10;
const AS_IT_IS: &str = "send one file (curl -F file=@skin.stl), or the bytes as they are (curl -T skin.stl)";

/// A form with exactly one file.
pub(super) struct Form {
    body: BodyDataStream,
    buffer: BytesMut,
    /// Line break, two hyphens and the boundary, which end every part.
    delimiter: Vec<u8>,
    state: State,
    /// What the part says of the file.
    pub(super) head: Head,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    BeforeFile,
    InFile,
    Done,
}

/// What a part says of itself.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(super) struct Head {
    /// Name of the field.
    pub(super) field: String,
    /// Name of the file; `None` for fields that are no files.
    pub(super) file_name: Option<String>,
    /// Content-Type of the part.
    pub(super) media_type: Option<String>,
}

/// Whether the body has parts.
pub(super) fn is_multipart(headers: &HeaderMap) -> bool {
    content_type(headers).to_ascii_lowercase().starts_with("multipart/")
}

fn content_type(headers: &HeaderMap) -> &str {
    headers.get(header::CONTENT_TYPE).and_then(|t| t.to_str().ok()).unwrap_or_default().trim()
}

fn refused(detail: &str) -> Problem {
    Problem::new(FaultKind::MalformedRequest, format!("{detail}; {AS_IT_IS}"))
}

impl Form {
    /// The form of a body with these headers.
    pub(super) fn new(headers: &HeaderMap, body: BodyDataStream) -> Result<Self, Problem> {
        let kind = content_type(headers);
        let (essence, parameters) = kind.split_once(';').unwrap_or((kind, ""));
        if !essence.trim().eq_ignore_ascii_case("multipart/form-data") {
            let detail = format!("of bodies with parts only multipart/form-data is read; {AS_IT_IS}");
            return Err(Problem::new(FaultKind::UnsupportedFormat, detail));
        }
        let boundary = parameter(parameters, "boundary").filter(|b| (1..=MAX_BOUNDARY).contains(&b.len()));
        let boundary = boundary.ok_or_else(|| refused("the Content-Type multipart/form-data has no boundary"))?;
        let delimiter = [b"\r\n--", boundary.as_bytes()].concat();
        // The first boundary has no line break before it.
        let buffer = BytesMut::from(&b"\r\n"[..]);
        Ok(Self { body, buffer, delimiter, state: State::BeforeFile, head: Head::default() })
    }

    /// The next bytes of the file; `None` at its end, when nothing else follows in the form.
    pub(super) async fn next(&mut self) -> Option<Result<Bytes, Problem>> {
        if self.state == State::BeforeFile {
            if let Err(problem) = self.open().await {
                return Some(Err(problem));
            }
            self.state = State::InFile;
        }
        match self.state {
            State::Done => None,
            State::BeforeFile | State::InFile => self.piece().await.transpose(),
        }
    }

    /// Skips to the content of the first part, which must be a file.
    async fn open(&mut self) -> Result<(), Problem> {
        self.skip_to(0, "the form has no boundary within its first bytes").await?;
        let Some(head) = self.head().await? else { return Err(refused("the form has no file")) };
        if head.file_name.is_none() {
            return Err(refused(&format!(
                "the form has the field `{}`, which is no file; settings are query parameters of the URL",
                short(&head.field)
            )));
        }
        self.head = head;
        Ok(())
    }

    async fn piece(&mut self) -> Result<Option<Bytes>, Problem> {
        loop {
            if let Some(end) = find(&self.buffer, &self.delimiter) {
                if end > 0 {
                    return Ok(Some(self.buffer.split_to(end).freeze()));
                }
                self.state = State::Done;
                self.buffer.advance(self.delimiter.len());
                return match self.head().await? {
                    None => Ok(None),
                    Some(Head { file_name: Some(_), .. }) => Err(refused("the form has several files")),
                    Some(Head { field, .. }) => Err(refused(&format!(
                        "the form has the field `{}` beside its file; settings are query parameters of the URL",
                        short(&field)
                    ))),
                };
            }
            // The end of the buffer can be the beginning of a boundary.
            let sure = self.buffer.len().saturating_sub(self.delimiter.len());
            if sure > 0 {
                return Ok(Some(self.buffer.split_to(sure).freeze()));
            }
            self.more().await?;
        }
    }

    /// Skips the next boundary and what is before it.
    async fn skip_to(&mut self, mut from: usize, otherwise: &str) -> Result<(), Problem> {
        loop {
            if let Some(at) = self.buffer.get(from..).and_then(|rest| find(rest, &self.delimiter)) {
                self.buffer.advance(from + at + self.delimiter.len());
                return Ok(());
            }
            if self.buffer.len() > MAX_HEAD {
                return Err(refused(otherwise));
            }
            from = self.buffer.len().saturating_sub(self.delimiter.len());
            self.more().await?;
        }
    }

    /// The header after a boundary; `None` after the last one.
    async fn head(&mut self) -> Result<Option<Head>, Problem> {
        loop {
            if self.buffer.starts_with(b"--") {
                return Ok(None);
            }
            if let Some(end) = find(&self.buffer, b"\r\n\r\n") {
                let text = self.buffer.split_to(end + 4);
                return Ok(Some(Head::of(&String::from_utf8_lossy(&text))));
            }
            if self.buffer.len() > MAX_HEAD {
                return Err(refused("a part of the form has a header of more than 16 kB"));
            }
            self.more().await?;
        }
    }

    /// Waits for more bytes.
    async fn more(&mut self) -> Result<(), Problem> {
        match self.body.next().await {
            Some(Ok(bytes)) => {
                self.buffer.extend_from_slice(&bytes);
                Ok(())
            }
            Some(Err(_)) => Err(Problem::new(FaultKind::MalformedRequest, "the upload broke off; send it again")),
            None => {
                Err(Problem::new(FaultKind::MalformedRequest, "the form ends without its last boundary; send it again"))
            }
        }
    }
}

impl Head {
    fn of(text: &str) -> Self {
        let mut head = Self::default();
        for line in text.lines() {
            let Some((name, value)) = line.split_once(':') else { continue };
            if name.trim().eq_ignore_ascii_case("content-disposition") {
                head.field = parameter(value, "name").unwrap_or_default();
                head.file_name = parameter(value, "filename").or_else(|| parameter(value, "filename*"));
            } else if name.trim().eq_ignore_ascii_case("content-type") {
                head.media_type = Some(value.trim().to_owned());
            }
        }
        head
    }
}

/// The parameter `name` of a header's value, without its quotation marks.
fn parameter(value: &str, name: &str) -> Option<String> {
    let (mut parts, mut part, mut quoted, mut escaped) = (Vec::new(), String::new(), false, false);
    for c in value.chars() {
        match c {
            _ if escaped => {
                part.push(c);
                escaped = false;
            }
            '\\' if quoted => escaped = true,
            '"' => quoted = !quoted,
            ';' if !quoted => parts.push(std::mem::take(&mut part)),
            c => part.push(c),
        }
    }
    parts.push(part);
    parts.iter().find_map(|part| {
        let (found, value) = part.split_once('=')?;
        found.trim().eq_ignore_ascii_case(name).then(|| value.trim().to_owned())
    })
}

fn find(bytes: &[u8], wanted: &[u8]) -> Option<usize> {
    let first = wanted.first()?;
    let mut from = 0;
    while let Some(rest) = bytes.get(from..) {
        let at = from + rest.iter().position(|b| b == first)?;
        if bytes.get(at..)?.starts_with(wanted) {
            return Some(at);
        }
        from = at + 1;
    }
    None
}

/// A name for a message.
fn short(name: &str) -> String {
    name.chars().filter(|c| !c.is_control()).take(60).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use axum::body::Body;
    use futures::stream;

    fn headers(kind: &str) -> HeaderMap {
        HeaderMap::from_iter([(header::CONTENT_TYPE, kind.parse().unwrap())])
    }

    /// Reads a form that arrives in pieces of `size` bytes.
    async fn read(body: &[u8], size: usize) -> Result<(Vec<u8>, Head), Problem> {
        let pieces: Vec<_> = body.chunks(size).map(|c| Ok::<_, std::io::Error>(Bytes::copy_from_slice(c))).collect();
        let body = Body::from_stream(stream::iter(pieces)).into_data_stream();
        let mut form = Form::new(&headers("multipart/form-data; boundary=\"a b\""), body)?;
        let mut file = Vec::new();
        while let Some(piece) = form.next().await {
            file.extend_from_slice(&piece?);
        }
        Ok((file, form.head))
    }

    fn part(head: &str, content: &[u8]) -> Vec<u8> {
        [b"--a b\r\nContent-Disposition: form-data; ", head.as_bytes(), b"\r\n\r\n", content, b"\r\n"].concat()
    }

    #[tokio::test]
    async fn one_file_is_read_however_it_arrives() {
        // Content that looks like a boundary, almost.
        let content = b"solid\r\n--a \r\n--\r\n\r\n--a\r\n-- a b\r\n--a c".repeat(50);
        let head = "name=\"file\"; filename=\"a \\\"b;.stl\"\r\nContent-Type: model/stl";
        for (content, end) in [(&content[..], &b"--a b--\r\n"[..]), (b"", b"--a b--"), (b"x", b"--a b--\r\nepilogue")] {
            let form = [part(head, content), end.to_vec()].concat();
            for size in [1, 2, 7, 64, 100_000] {
                let (file, found) = read(&form, size).await.unwrap();
                assert_eq!(file, content, "{size}");
                assert_eq!(found.file_name.as_deref(), Some("a \"b;.stl"));
                assert_eq!((found.field.as_str(), found.media_type.as_deref()), ("file", Some("model/stl")));
            }
        }
    }

    #[tokio::test]
    async fn other_forms_are_refused_with_what_to_do() {
        let file = part("name=\"file\"; filename=\"a.stl\"", b"x");
        let field = part("name=\"series\"", b"2");
        let end = b"--a b--\r\n".to_vec();
        for (body, words) in [
            (end.clone(), "the form has no file; send one file"),
            ([file.clone(), file.clone(), end.clone()].concat(), "several files; send one file"),
            ([file.clone(), field.clone(), end.clone()].concat(), "the field `series` beside its file"),
            ([field, file.clone(), end].concat(), "the field `series`, which is no file"),
            (file, "ends without its last boundary"),
            (vec![b'x'; 100_000], "no boundary within its first bytes"),
            ([b"--a b\r\n".to_vec(), vec![b'x'; 100_000]].concat(), "header of more than 16 kB"),
            (Vec::new(), "ends without"),
        ] {
            for size in [1000, 1 << 20] {
                let Problem(fault) = read(&body, size).await.unwrap_err();
                assert!(fault.detail.contains(words), "{words}: {fault:?}");
            }
        }
        let empty = || Body::empty().into_data_stream();
        let Problem(fault) = Form::new(&headers("multipart/mixed; boundary=a"), empty()).err().unwrap();
        assert_eq!(fault.kind, FaultKind::UnsupportedFormat);
        let Problem(fault) = Form::new(&headers("multipart/form-data"), empty()).err().unwrap();
        assert!(fault.detail.contains("no boundary"), "{fault:?}");
    }
}
