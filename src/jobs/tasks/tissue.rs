use std::collections::BTreeMap;

use crate::import::volume_mesh;
use crate::jobs::Service;
use crate::mesh::Attachment;
use crate::session::{Fault, FaultKind, Halt, TissueDocument, import_fault};
use crate::simulate::ReadyMesh;
use crate::store::{BlobInfo, PartKind, PartRecord, SessionId, now_rfc3339};

/// Reads, checks and stores an uploaded tissue mesh as a part of the session. The upload's file is removed when it is refused.
///
/// # Errors
/// [`FaultKind::MeshNotUsable`], [`FaultKind::UnsupportedFormat`], or the store's.
pub async fn take_tissue(service: &Service, session: SessionId, upload: BlobInfo) -> Result<TissueDocument, Fault> {
    let checked = check(service, &upload).await;
    let document = match checked {
        Ok(document) => document,
        Err(fault) => {
            service.store.blobs().delete(&upload.key).await;
            return Err(if fault.kind == FaultKind::MeshNotUsable {
                fault.at(PartKind::Tissue.as_str())
            } else {
                fault
            });
        }
    };
    let part = PartRecord {
        kind: PartKind::Tissue,
        key: upload.sha256,
        blob: Some(upload.key),
        bytes: upload.bytes,
        wall_s: 0.0,
        document: serde_json::to_string(&document).unwrap_or_default(),
        updated_at: now_rfc3339(),
    };
    service.store.put_parts(session, &[part]).await?;
    Ok(document)
}

async fn check(service: &Service, upload: &BlobInfo) -> Result<TissueDocument, Fault> {
    let bytes = service.store.blobs().get(&upload.key).await?;
    let limits = service.settings.import;
    let (length, sha256) = (upload.bytes, upload.sha256.clone());
    service
        .compute(move |_, _| {
            let (volume, warnings) =
                volume_mesh(&bytes, &limits).map_err(|e| Halt::from(import_fault(&e, FaultKind::MeshNotUsable)))?;
            drop(bytes);
            let ready =
                ReadyMesh::new(&volume).map_err(|e| Halt::from(Fault::new(FaultKind::MeshNotUsable, e.to_string())))?;
            if let Some(loose) = loose_part(&ready) {
                return Err(Fault::new(FaultKind::MeshNotUsable, loose).into());
            }
            Ok(TissueDocument::new(sha256, length, &volume, &ready, warnings))
        })
        .await
}

/// A connected part that could be shifted as a whole: no job could solve it. What else a part needs to stay (three points that are not
/// on one line) the job tells.
fn loose_part(ready: &ReadyMesh) -> Option<String> {
    const ALL_AXES: u8 = 7;
    let mesh = &ready.mesh;
    let mut parts = Parts { parent: (0..mesh.positions.len() as u32).collect() };
    let cells = mesh.tetrahedra.iter().map(|cell| &cell[..]).chain(mesh.prisms.iter().map(|cell| &cell[..]));
    let mut used = vec![false; mesh.positions.len()];
    for cell in cells {
        for &node in cell {
            used[node as usize] = true;
            parts.join(cell[0], node);
        }
    }
    let mut held = BTreeMap::new();
    for (node, attachment) in mesh.attachment.iter().enumerate().filter(|(node, _)| used[*node]) {
        let axes = match attachment {
            Attachment::Tied(_) | Attachment::Fixed => ALL_AXES,
            Attachment::Free | Attachment::Sliding => ready.boundary.held_axes.get(node).copied().unwrap_or(0),
        };
        let (points, held) = held.entry(parts.root(node as u32)).or_insert((0usize, 0));
        *points += 1;
        *held |= axes;
    }
    let (root, (points, _)) = held.into_iter().find(|(_, (_, axes))| *axes != ALL_AXES)?;
    let [x, y, z] = mesh.positions[root as usize].into();
    Some(format!(
        "the part of {points} points near ({x:.1}, {y:.1}, {z:.1}) mm is tied to no bone and not held along all axes: nothing keeps it in place"
    ))
}

/// Nodes that hang together.
struct Parts {
    parent: Vec<u32>,
}

impl Parts {
    fn root(&mut self, mut node: u32) -> u32 {
        while self.parent[node as usize] != node {
            self.parent[node as usize] = self.parent[self.parent[node as usize] as usize];
            node = self.parent[node as usize];
        }
        node
    }

    fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.root(a), self.root(b));
        self.parent[a.max(b) as usize] = a.min(b);
    }
}
