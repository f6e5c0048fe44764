use std::str::FromStr;

use super::records::{now_rfc3339, sha256_hex};

/// Kind of a part; a session has at most one part of each kind.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum PartKind {
    /// CT volume, stored as NIfTI.
    Ct,
    /// Outer skin surface.
    Skin,
    /// Bone surface.
    Skull,
    /// Surface of the air inside the head.
    Air,
    /// Grid of fat and muscle from the CT.
    SoftTissue,
    /// Post-operative skin surface.
    Target,
    /// Landmarks and planes.
    Landmarks,
    /// Frame of the head that a client set.
    Frame,
    /// Settings of the distance field.
    FieldSettings,
    /// Report of the distance field.
    Field,
    /// Report of the tissue mesh.
    Mesh,
    /// A ready tissue mesh as uploaded.
    Tissue,
    /// Rigid bone of a segment of the uploaded tissue mesh; the segment is below [`PartKind::BONES`].
    Bone(u8),
}

impl PartKind {
    /// Number of segments that may have a bone.
    pub const BONES: u8 = 10;

    /// Every kind but the bones.
    pub const ALL: [Self; 12] = [
        Self::Ct,
        Self::Skin,
        Self::Skull,
        Self::Air,
        Self::SoftTissue,
        Self::Target,
        Self::Landmarks,
        Self::Frame,
        Self::FieldSettings,
        Self::Field,
        Self::Mesh,
        Self::Tissue,
    ];

    /// Name on the wire and in the database.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Ct => "ct",
            Self::Skin => "skin",
            Self::Skull => "skull",
            Self::Air => "air",
            Self::SoftTissue => "soft_tissue",
            Self::Target => "target",
            Self::Landmarks => "landmarks",
            Self::Frame => "frame",
            Self::FieldSettings => "field_settings",
            Self::Field => "field",
            Self::Mesh => "mesh",
            Self::Tissue => "tissue",
            Self::Bone(segment) => BONE_NAMES.get(usize::from(segment)).copied().unwrap_or("bone"),
        }
    }

    /// Segment of a bone; `None` for other kinds.
    #[must_use]
    pub fn segment(self) -> Option<u32> {
        if let Self::Bone(segment) = self { Some(u32::from(segment)) } else { None }
    }

    /// The bone of `segment`; `None` from [`PartKind::BONES`] on.
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

/// The row of a part of a session.
#[derive(Debug, Clone, PartialEq)]
pub struct PartRecord {
    /// Its kind.
    pub kind: PartKind,
    /// Hash of the content (inputs), or key of everything that it was made from (field, mesh).
    pub key: String,
    /// Its blob, if it has one.
    pub blob: Option<String>,
    /// Bytes stored.
    pub bytes: u64,
    /// Computing time, s.
    pub wall_s: f64,
    /// Its report or its content, JSON.
    pub document: String,
    /// When it was stored, RFC 3339.
    pub updated_at: String,
}

impl PartRecord {
    /// A part whose content is its document, stored now.
    #[must_use]
    pub fn of_document(kind: PartKind, document: String) -> Self {
        Self {
            kind,
            key: sha256_hex(document.as_bytes()),
            blob: None,
            bytes: document.len() as u64,
            wall_s: 0.0,
            document,
            updated_at: now_rfc3339(),
        }
    }
}
