use axum::body::{Body, BodyDataStream, Bytes};
use axum::http::{HeaderMap, header};
use futures::StreamExt;
use prosopon_contract::FaultKind;

use super::Problem;
use super::form::{Form, OVERHEAD, is_multipart};

/// The file of an upload: the body as it is, or the one file of a form.
pub(super) struct UploadBody {
    pieces: Pieces,
    media_type: Option<String>,
}

enum Pieces {
    Plain(BodyDataStream),
    Form(Box<Form>),
}

impl UploadBody {
    pub(super) fn new(headers: &HeaderMap, body: Body) -> Result<Self, Problem> {
        let body = body.into_data_stream();
        if is_multipart(headers) {
            return Ok(Self { pieces: Pieces::Form(Box::new(Form::new(headers, body)?)), media_type: None });
        }
        let media_type = headers.get(header::CONTENT_TYPE).and_then(|kind| Some(kind.to_str().ok()?.to_owned()));
        Ok(Self { pieces: Pieces::Plain(body), media_type })
    }

    /// Bytes of the body that are not of the file, at most.
    pub(super) fn overhead(&self) -> u64 {
        match self.pieces {
            Pieces::Plain(_) => 0,
            Pieces::Form(_) => OVERHEAD,
        }
    }

    /// The next bytes of the file.
    pub(super) async fn next(&mut self) -> Option<Result<Bytes, Problem>> {
        match &mut self.pieces {
            Pieces::Plain(body) => {
                let broken = |_| Problem::new(FaultKind::MalformedRequest, "the upload broke off; send it again");
                Some(body.next().await?.map_err(broken))
            }
            Pieces::Form(form) => form.next().await,
        }
    }

    /// Media type of the file, of a form's part once bytes of it have come; a hint.
    pub(super) fn media_type(&self) -> Option<&str> {
        match &self.pieces {
            Pieces::Plain(_) => self.media_type.as_deref(),
            Pieces::Form(form) => form.head.media_type.as_deref(),
        }
    }

    /// Name of the file in a form; a hint.
    pub(super) fn file_name(&self) -> Option<&str> {
        match &self.pieces {
            Pieces::Plain(_) => None,
            Pieces::Form(form) => form.head.file_name.as_deref(),
        }
    }
}
