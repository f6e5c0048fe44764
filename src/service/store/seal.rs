//! Seals: the last bytes of a stored blob bind its content to its key.
//!
//! A seal shows a changed bit, a missing tail, and the file of another blob.

use bytes::Bytes;
use sha2::{Digest, Sha256};

use super::StoreError;
use super::encryption::{HEADER, key_id};
use super::records::hex;

/// Suffix of the keys of sealed blobs. Blobs of earlier formats of the store have no seal.
pub(super) const SEALED: &str = ".sealed";

/// Length of a seal, bytes.
pub(super) const LENGTH: usize = 32;

/// Id of the key of a blob; `None` for one that is not encrypted.
pub(super) type Encryption = Option<String>;

/// Bytes that are hashed before other tasks get a turn.
const PIECE: usize = 1 << 20;

pub(super) fn is_sealed(key: &str) -> bool {
    key.ends_with(SEALED)
}

/// How the content of a blob is stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Form {
    Plain,
    Encrypted,
}

/// The seal of the blob `key` of which what stands before the seal has the SHA-256 `stored`.
///
/// It tells encrypted content from plain content that looks like it. What is encrypted is checked without its key.
pub(super) fn seal(key: &str, stored: &[u8], form: Form) -> [u8; LENGTH] {
    let hash = match form {
        Form::Plain => Sha256::new(),
        Form::Encrypted => Sha256::new_with_prefix("encrypted "),
    };
    hash.chain_update(key.as_bytes()).chain_update(stored).finalize().into()
}

/// The form in which a seal fits; `None` when it fits in none.
fn form_of(key: &str, stored: &[u8], found: &[u8]) -> Option<Form> {
    [Form::Plain, Form::Encrypted].into_iter().find(|form| found == seal(key, stored, *form))
}

/// Checks the seal of a stored blob; returns what stands before the seal, and its form.
///
/// # Errors
/// [`StoreError::Damaged`].
pub(super) async fn open(key: &str, stored: Bytes) -> Result<(Bytes, Form), StoreError> {
    if !is_sealed(key) {
        return Ok((stored, Form::Plain));
    }
    let damaged = || StoreError::Damaged { key: key.to_owned() };
    let length = stored.len().checked_sub(LENGTH).ok_or_else(damaged)?;
    let content = stored.slice(..length);
    let mut hash = Sha256::new();
    for piece in content.chunks(PIECE) {
        hash.update(piece);
        // A large blob takes long: other tasks get a turn.
        tokio::task::yield_now().await;
    }
    let form = form_of(key, &hash.finalize(), &stored.slice(length..)).ok_or_else(damaged)?;
    Ok((content, form))
}

/// Checks the seal of a blob that is read in pieces.
#[derive(Debug)]
pub(super) struct Check {
    hash: Sha256,
    /// The first bytes, which name the key of encrypted content.
    head: Vec<u8>,
    /// The last bytes so far, which may be the seal.
    tail: Vec<u8>,
}

impl Check {
    pub(super) fn new() -> Self {
        Self { hash: Sha256::new(), head: Vec::new(), tail: Vec::new() }
    }

    pub(super) fn read(&mut self, piece: &[u8]) {
        self.head.extend(piece.iter().take(HEADER.saturating_sub(self.head.len())));
        self.tail.extend_from_slice(piece);
        let content = self.tail.len().saturating_sub(LENGTH);
        self.hash.update(self.tail.drain(..content).as_slice());
    }

    /// The encryption of the blob `key`; `None` unless everything read is that blob. A blob without a seal always passes.
    pub(super) fn finds(self, key: &str) -> Option<Encryption> {
        if !is_sealed(key) {
            return Some(None);
        }
        match form_of(key, &self.hash.finalize(), &self.tail)? {
            Form::Plain => Some(None),
            Form::Encrypted => key_id(&self.head).map(|id| Some(hex(&id))),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sealed(key: &str, content: &[u8]) -> Vec<u8> {
        [content, &seal(key, &Sha256::digest(content), Form::Plain)].concat()
    }

    #[tokio::test]
    async fn every_change_shows_whole_and_in_pieces() {
        const KEY: &str = "a/b.sealed";
        let large = vec![7; PIECE + 5];
        for content in [&b""[..], b"x", &[1; 100], &large] {
            let stored = sealed(KEY, content);
            let check = |stored: &[u8], key: &str| {
                let mut check = Check::new();
                stored.chunks(33).for_each(|piece| check.read(piece));
                check.finds(key).is_some()
            };
            assert_eq!(open(KEY, stored.clone().into()).await.unwrap(), (Bytes::copy_from_slice(content), Form::Plain));
            assert!(check(&stored, KEY));
            let mut faults = vec![stored[..stored.len() - 1].to_vec(), stored[1..].to_vec(), Vec::new()];
            for at in [0, stored.len() / 2, stored.len() - 1] {
                let mut flipped = stored.clone();
                flipped[at] ^= 16;
                faults.push(flipped);
            }
            for fault in faults {
                assert!(!check(&fault, KEY));
                assert!(matches!(open(KEY, fault.into()).await, Err(StoreError::Damaged { key }) if key == KEY));
            }
            assert!(!check(&stored, "a/c.sealed"), "the file of another key");
        }
    }
}
