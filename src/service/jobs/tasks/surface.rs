use std::time::Instant;

use super::checks::surface_warnings;
use crate::Service;
use prosopon_contract::{Fault, FaultKind, Halt, OriginKind, SurfaceDocument, SurfaceOrigin, import_fault};
use prosopon_formats::import::{ImportError, SurfaceFormat, detect_surface, surface};
use prosopon_session::{PreparedSurface, surface_part};
use prosopon_store::{BlobInfo, PartKind, SessionId};

/// Reads, measures and stores an uploaded surface as a part of the session.
///
/// `hint` is the format that the sender names; it counts only when the bytes do not show the format. The upload's blob is removed
/// in any case.
///
/// # Errors
/// [`FaultKind::SurfaceNotUsable`], [`FaultKind::UnsupportedFormat`], or the store's.
pub async fn take_surface(
    service: &Service,
    session: SessionId,
    kind: PartKind,
    upload: BlobInfo,
    hint: Option<SurfaceFormat>,
) -> Result<SurfaceDocument, Fault> {
    let result = take(service, session, kind, &upload, hint).await;
    service.store.blobs().delete(&upload.key).await;
    result.map_err(|fault| if fault.kind == FaultKind::SurfaceNotUsable { fault.at(kind.as_str()) } else { fault })
}

async fn take(
    service: &Service,
    session: SessionId,
    kind: PartKind,
    upload: &BlobInfo,
    hint: Option<SurfaceFormat>,
) -> Result<SurfaceDocument, Fault> {
    let started = Instant::now();
    let bytes = service.store.blobs().get(&upload.key).await?;
    let limits = service.settings.import;
    let (length, sha256) = (upload.bytes, upload.sha256.clone());
    let prepared = service
        .compute(move |_, _| {
            let refused = |e: ImportError| Halt::from(import_fault(&e, FaultKind::SurfaceNotUsable));
            let format = detect_surface(&bytes).or(hint).or_else(|| cut_off_stl(&bytes, limits.max_triangles));
            let format = match format {
                Some(format) => format,
                None if bytes.is_empty() => return Err(refused(ImportError::Empty)),
                None => return Err(refused(ImportError::UnknownFormat { expected: "STL, PLY, OBJ and VTP" })),
            };
            let (mesh, warnings) = surface(&bytes, format, &limits).map_err(refused)?;
            drop(bytes);
            let origin =
                SurfaceOrigin { kind: OriginKind::Upload, format: format.name().to_owned(), bytes: length, sha256 };
            Ok(PreparedSurface::new(&mesh, origin, warnings)?)
        })
        .await?;
    let wall_s = started.elapsed().as_secs_f64();
    let (part, mut document) = surface_part(&service.store, session, kind, prepared, wall_s).await?;
    service.store.put_parts(session, &[part]).await?;
    // Only in the answer: other parts may be replaced.
    if kind != PartKind::Air {
        document.findings.extend(surface_warnings(service, session, kind).await?);
    }
    Ok(document)
}

/// Recognises a truncated binary STL file by a plausible number of triangles.
///
/// Reading it as STL then reports what is missing.
#[must_use]
pub fn cut_off_stl(bytes: &[u8], max_triangles: usize) -> Option<SurfaceFormat> {
    let count = u32::from_le_bytes(*bytes.get(80..84)?.first_chunk::<4>()?) as usize;
    (1..=max_triangles).contains(&count).then_some(SurfaceFormat::Stl)
}
