use std::str::FromStr;

use super::records::{parse_id, to_i64, to_u64};
use super::{SessionId, Store, StoreError};

/// What a session holds one of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum PartKind {
    /// CT volume as uploaded.
    Ct,
    /// Outer skin.
    Skin,
    /// Bone.
    Skull,
    /// Air inside the head.
    Air,
    /// Post-operative skin.
    Target,
    /// Landmarks and planes.
    Landmarks,
    /// Settings of the distance field.
    FieldSettings,
    /// Report of the distance field.
    Field,
    /// Report of the tissue mesh.
    Mesh,
    /// A ready tissue mesh as uploaded.
    Tissue,
    /// Rigid bone of a segment of the ready mesh, below [`PartKind::BONES`].
    Bone(u8),
}

impl PartKind {
    /// Segments that may have a bone.
    pub const BONES: u8 = 10;

    /// Every kind but the bones.
    pub const ALL: [Self; 10] = [
        Self::Ct,
        Self::Skin,
        Self::Skull,
        Self::Air,
        Self::Target,
        Self::Landmarks,
        Self::FieldSettings,
        Self::Field,
        Self::Mesh,
        Self::Tissue,
    ];

    /// Its name on the wire and in the database.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Ct => "ct",
            Self::Skin => "skin",
            Self::Skull => "skull",
            Self::Air => "air",
            Self::Target => "target",
            Self::Landmarks => "landmarks",
            Self::FieldSettings => "field_settings",
            Self::Field => "field",
            Self::Mesh => "mesh",
            Self::Tissue => "tissue",
            Self::Bone(segment) => BONE_NAMES.get(usize::from(segment)).copied().unwrap_or("bone"),
        }
    }

    /// Whose bone it is, if it is one.
    #[must_use]
    pub fn segment(self) -> Option<u32> {
        if let Self::Bone(segment) = self { Some(u32::from(segment)) } else { None }
    }

    /// The bone of `segment`, if it may have one.
    #[must_use]
    pub fn bone(segment: u32) -> Option<Self> {
        u8::try_from(segment).ok().filter(|s| *s < Self::BONES).map(Self::Bone)
    }
}

const BONE_NAMES: [&str; PartKind::BONES as usize] =
    ["bone_0", "bone_1", "bone_2", "bone_3", "bone_4", "bone_5", "bone_6", "bone_7", "bone_8", "bone_9"];

impl FromStr for PartKind {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        let bones = (0..Self::BONES).map(Self::Bone);
        Self::ALL.into_iter().chain(bones).find(|k| k.as_str() == text).ok_or_else(|| format!("`{text}` is not a part"))
    }
}

/// One part of a session.
#[derive(Debug, Clone, PartialEq)]
pub struct PartRecord {
    /// Which.
    pub kind: PartKind,
    /// Hash of what it is (inputs) or what it was made from (field, mesh).
    pub key: String,
    /// Blob, where it has one.
    pub blob: Option<String>,
    /// Bytes stored.
    pub bytes: u64,
    /// Time that it took to make, s.
    pub wall_s: f64,
    /// Report or content, JSON.
    pub document: String,
    /// When it was stored, RFC 3339.
    pub updated_at: String,
}

type Row = (String, String, Option<String>, i64, f64, String, String);
const COLUMNS: &str = "SELECT kind, key, blob, bytes, wall_s, document, updated_at FROM parts WHERE session = ?";

fn record((kind, key, blob, bytes, wall_s, document, updated_at): Row) -> Result<PartRecord, StoreError> {
    Ok(PartRecord {
        kind: kind.parse().map_err(StoreError::record)?,
        key,
        blob,
        bytes: to_u64(bytes),
        wall_s,
        document,
        updated_at,
    })
}

impl Store {
    /// Stores parts in one transaction, each in place of the one before, and removes the blobs that they replace; on
    /// failure those that they name.
    ///
    /// # Errors
    /// [`StoreError::SessionGone`] when the session is not there, [`StoreError::Database`].
    pub async fn put_parts(&self, session: SessionId, parts: &[PartRecord]) -> Result<(), StoreError> {
        let put = self.put_part_rows(session, parts).await;
        let unnamed = match &put {
            Ok(replaced) => replaced.clone(),
            Err(_) => parts.iter().filter_map(|p| p.blob.clone()).collect(),
        };
        for blob in unnamed {
            self.blobs().delete(&blob).await;
        }
        put.map(|_| ())
    }

    /// Returns the blobs that are not named any more.
    async fn put_part_rows(&self, session: SessionId, parts: &[PartRecord]) -> Result<Vec<String>, StoreError> {
        let mut transaction = self.writer.begin().await?;
        let mut replaced = Vec::new();
        for part in parts {
            let old: Option<Option<String>> =
                sqlx::query_scalar("SELECT blob FROM parts WHERE session = ? AND kind = ?")
                    .bind(session.to_string())
                    .bind(part.kind.as_str())
                    .fetch_optional(&mut *transaction)
                    .await?;
            replaced.extend(old.flatten().filter(|old| Some(old) != part.blob.as_ref()));
            sqlx::query(
                "INSERT OR REPLACE INTO parts (session, kind, key, blob, bytes, wall_s, document, updated_at)
                 VALUES (?, ?, ?, ?, ?, ?, ?, ?)",
            )
            .bind(session.to_string())
            .bind(part.kind.as_str())
            .bind(&part.key)
            .bind(&part.blob)
            .bind(to_i64(part.bytes))
            .bind(part.wall_s)
            .bind(&part.document)
            .bind(&part.updated_at)
            .execute(&mut *transaction)
            .await
            .map_err(gone_if_orphan)?;
        }
        transaction.commit().await?;
        Ok(replaced)
    }

    /// Removes a part; true when it was there.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn delete_part(&self, session: SessionId, kind: PartKind) -> Result<bool, StoreError> {
        let blob: Option<Option<String>> =
            sqlx::query_scalar("DELETE FROM parts WHERE session = ? AND kind = ? RETURNING blob")
                .bind(session.to_string())
                .bind(kind.as_str())
                .fetch_optional(&self.writer)
                .await?;
        if let Some(blob) = blob.as_ref().and_then(Option::as_ref) {
            self.blobs().delete(blob).await;
        }
        Ok(blob.is_some())
    }

    /// All parts of a session.
    ///
    /// # Errors
    /// [`StoreError::Database`], [`StoreError::Record`].
    pub async fn parts(&self, session: SessionId) -> Result<Vec<PartRecord>, StoreError> {
        let rows = sqlx::query_as::<_, Row>(COLUMNS).bind(session.to_string()).fetch_all(&self.reader).await?;
        rows.into_iter().map(record).collect()
    }

    /// One part of a session, if it is there.
    ///
    /// # Errors
    /// [`StoreError::Database`], [`StoreError::Record`].
    pub async fn part(&self, session: SessionId, kind: PartKind) -> Result<Option<PartRecord>, StoreError> {
        Ok(self.parts(session).await?.into_iter().find(|p| p.kind == kind))
    }
}

/// A row whose session is gone breaks the foreign key.
pub(super) fn gone_if_orphan(error: sqlx::Error) -> StoreError {
    let orphan = error.as_database_error().is_some_and(sqlx::error::DatabaseError::is_foreign_key_violation);
    if orphan { StoreError::SessionGone } else { StoreError::Database(error) }
}

/// Reads an id column of a row that must name a session.
pub(super) fn session_of(text: &str) -> Result<SessionId, StoreError> {
    parse_id(text)
}
