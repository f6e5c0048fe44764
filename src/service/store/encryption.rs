//! Encryption of blobs, and of the database in a backup.
//!
//! What is stored begins with [`MARK`], the id of the key and a salt. From them and the value's name a key for this value alone is
//! derived (HKDF-SHA256), so that no value can take the place of another. Pieces of 64 KiB are encrypted with AES-256-GCM under
//! ascending numbers, and the last one is marked as such, so that a missing end shows: STREAM of Hoang, Reyhanitabar, Rogaway and
//! Vizár, CRYPTO 2015.

use std::fmt;
use std::io::{self, Read, Write};
use std::sync::Arc;

use ring::aead::{AES_256_GCM, Aad, LessSafeKey, Nonce, UnboundKey};
use ring::error::Unspecified;
use ring::hkdf::{HKDF_SHA256, Salt};
use ring::rand::{SecureRandom as _, SystemRandom};
use sha2::{Digest, Sha256};

use super::StoreError;
use super::records::hex;

const MARK: [u8; 8] = *b"PROSENC1";
const ID_LENGTH: usize = 8;
const SALT_LENGTH: usize = 16;
/// Length of what stands before the pieces, bytes.
pub(super) const HEADER: usize = MARK.len() + ID_LENGTH + SALT_LENGTH;
const KEY_LENGTH: usize = 32;
const PIECE: usize = 64 << 10;
const TAG: usize = 16;
/// Bytes between two turns of other tasks.
const TURN: usize = 1 << 20;

/// Keys of 256 bits for blobs and backups: the first encrypts, all decrypt.
///
/// With none, values are stored as they are. `Debug` shows the ids alone, the first 8 bytes of the keys' SHA-256.
#[derive(Clone, Default, PartialEq, Eq)]
pub struct Keyring(Arc<[Key]>);

#[derive(Clone, PartialEq, Eq)]
struct Key {
    id: [u8; ID_LENGTH],
    bytes: [u8; KEY_LENGTH],
}

impl fmt::Debug for Keyring {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_list().entries(self.ids()).finish()
    }
}

impl Keyring {
    /// Reads keys of 64 hexadecimal digits each.
    ///
    /// # Errors
    /// Which of them is none, without quoting it.
    pub fn new<'a>(keys: impl IntoIterator<Item = &'a str>) -> Result<Self, String> {
        let parse = |(index, text): (usize, &str)| {
            let bytes = from_hex(text.trim()).ok_or_else(|| {
                format!(
                    "key {} does not have {} hexadecimal digits; make one with `prosopon encryption key`",
                    index + 1,
                    2 * KEY_LENGTH
                )
            })?;
            Ok(Key { id: id_of(&bytes), bytes })
        };
        keys.into_iter().enumerate().map(parse).collect::<Result<Vec<Key>, String>>().map(|keys| Self(keys.into()))
    }

    /// Reads the lines of a key file; empty ones and those that begin with `#` are left out.
    ///
    /// # Errors
    /// As [`Keyring::new`]; a file without a key.
    pub fn of_file(text: &str) -> Result<Self, String> {
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        let keys = Self::new(text.lines().map(str::trim).filter(|line| !line.is_empty() && !line.starts_with('#')))?;
        if keys.is_empty() {
            Err("it has no key; make one with `prosopon encryption key`".to_owned())
        } else {
            Ok(keys)
        }
    }

    /// A new key and its id.
    ///
    /// # Errors
    /// When the system gives no random numbers.
    pub fn new_key() -> io::Result<(String, String)> {
        let mut bytes = [0; KEY_LENGTH];
        SystemRandom::new().fill(&mut bytes).map_err(|_| io::Error::other("the system gives no random numbers"))?;
        Ok((hex(&bytes), hex(&id_of(&bytes))))
    }

    /// Whether values are stored as they are.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Ids of the keys, hexadecimal.
    pub fn ids(&self) -> impl Iterator<Item = String> {
        self.0.iter().map(|key| hex(&key.id))
    }

    /// Id of the key that encrypts.
    pub(super) fn first_id(&self) -> Option<[u8; ID_LENGTH]> {
        self.0.first().map(|key| key.id)
    }

    /// Begins to encrypt the value `name`; `None` without a key.
    pub(super) fn encrypt(&self, name: &str) -> Result<Option<Encrypting>, StoreError> {
        let Some(key) = self.0.first() else { return Ok(None) };
        let mut header = [0; HEADER];
        let (mark, rest) = header.split_at_mut(MARK.len());
        let (id, salt) = rest.split_at_mut(ID_LENGTH);
        mark.copy_from_slice(&MARK);
        id.copy_from_slice(&key.id);
        SystemRandom::new().fill(salt).map_err(not_encrypted)?;
        let pieces = Pieces::new(key.of_value(salt, name).map_err(not_encrypted)?, PIECE);
        Ok(Some(Encrypting { header: Some(header), pieces }))
    }

    /// Begins to decrypt the value `name` with this header.
    fn decrypt(&self, name: &str, header: &[u8]) -> Result<Pieces, StoreError> {
        let damaged = || StoreError::Damaged { key: name.to_owned() };
        let id = key_id(header).ok_or_else(damaged)?;
        let salt = header.get(MARK.len() + ID_LENGTH..HEADER).ok_or_else(damaged)?;
        let key = self.0.iter().find(|key| key.id == id).ok_or_else(|| StoreError::KeyUnknown { id: hex(&id) })?;
        Ok(Pieces::new(key.of_value(salt, name).map_err(|_| damaged())?, PIECE + TAG))
    }

    /// The content of the whole encrypted value `name`.
    pub(super) async fn open(&self, name: &str, stored: &[u8]) -> Result<Vec<u8>, StoreError> {
        let damaged = |_| StoreError::Damaged { key: name.to_owned() };
        let (header, rest) = stored.split_at_checked(HEADER).ok_or(Unspecified).map_err(damaged)?;
        let mut pieces = self.decrypt(name, header)?;
        let mut content = Vec::with_capacity(rest.len());
        for part in rest.chunks(TURN) {
            pieces.add(part, &mut content, decrypted).map_err(damaged)?;
            // A large value takes long: other tasks get a turn.
            tokio::task::yield_now().await;
        }
        pieces.end(&mut content, decrypted).map_err(damaged)?;
        Ok(content)
    }

    /// Copies the file `name` encrypted with the first key, which there must be.
    pub(super) fn encrypt_file(&self, name: &str, from: &mut impl Read, to: &mut impl Write) -> Result<(), StoreError> {
        let mut encrypting = self.encrypt(name)?.ok_or(Unspecified).map_err(not_encrypted)?;
        let mut part = vec![0; TURN];
        loop {
            match from.read(&mut part)? {
                0 => break,
                n => to.write_all(&encrypting.add(&part[..n])?)?,
            }
        }
        Ok(to.write_all(&encrypting.end()?)?)
    }

    /// Copies the encrypted file `name` decrypted.
    pub(super) fn decrypt_file(&self, name: &str, from: &mut impl Read, to: &mut impl Write) -> Result<(), StoreError> {
        let damaged = |_| StoreError::Damaged { key: name.to_owned() };
        let mut header = [0; HEADER];
        match from.read_exact(&mut header) {
            Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => return Err(damaged(Unspecified)),
            read => read?,
        }
        let mut pieces = self.decrypt(name, &header)?;
        let (mut part, mut content) = (vec![0; TURN], Vec::new());
        loop {
            let n = from.read(&mut part)?;
            let end = if n == 0 {
                pieces.end(&mut content, decrypted)
            } else {
                pieces.add(&part[..n], &mut content, decrypted)
            };
            end.map_err(damaged)?;
            to.write_all(&content)?;
            content.clear();
            if n == 0 {
                return Ok(());
            }
        }
    }
}

impl Key {
    /// The key of one value.
    fn of_value(&self, salt: &[u8], name: &str) -> Result<LessSafeKey, Unspecified> {
        let of_all = Salt::new(HKDF_SHA256, salt).extract(&self.bytes);
        let info = [b"prosopon value ".as_slice(), name.as_bytes()];
        Ok(LessSafeKey::new(UnboundKey::from(of_all.expand(&info, &AES_256_GCM)?)))
    }
}

/// The id of the key in the header of an encrypted value; `None` when it is none.
pub(super) fn key_id(stored: &[u8]) -> Option<[u8; ID_LENGTH]> {
    stored.strip_prefix(&MARK)?.first_chunk().copied()
}

/// A value that is being encrypted.
pub(super) struct Encrypting {
    /// Until it is handed out.
    header: Option<[u8; HEADER]>,
    pieces: Pieces,
}

impl Encrypting {
    /// What is to be stored after `content` has followed.
    pub(super) fn add(&mut self, content: &[u8]) -> Result<Vec<u8>, StoreError> {
        let mut out: Vec<u8> = self.header.take().into_iter().flatten().collect();
        self.pieces.add(content, &mut out, encrypted).map_err(not_encrypted)?;
        Ok(out)
    }

    /// What is to be stored at the end.
    pub(super) fn end(mut self) -> Result<Vec<u8>, StoreError> {
        let mut out: Vec<u8> = self.header.take().into_iter().flatten().collect();
        self.pieces.end(&mut out, encrypted).map_err(not_encrypted)?;
        Ok(out)
    }
}

/// Splits bytes into numbered pieces.
struct Pieces {
    key: LessSafeKey,
    number: u64,
    /// Bytes that wait for more: the last piece is treated differently.
    held: Vec<u8>,
    length: usize,
}

type Change = fn(&LessSafeKey, Nonce, &mut Vec<u8>) -> Result<(), Unspecified>;

impl Pieces {
    fn new(key: LessSafeKey, length: usize) -> Self {
        Self { key, number: 0, held: Vec::with_capacity(length + TAG), length }
    }

    fn add(&mut self, mut bytes: &[u8], out: &mut Vec<u8>, change: Change) -> Result<(), Unspecified> {
        while self.held.len() + bytes.len() > self.length {
            let (now, later) = bytes.split_at(self.length - self.held.len());
            self.held.extend_from_slice(now);
            self.hand_on(false, out, change)?;
            bytes = later;
        }
        self.held.extend_from_slice(bytes);
        Ok(())
    }

    fn end(&mut self, out: &mut Vec<u8>, change: Change) -> Result<(), Unspecified> {
        self.hand_on(true, out, change)
    }

    fn hand_on(&mut self, is_last: bool, out: &mut Vec<u8>, change: Change) -> Result<(), Unspecified> {
        let mut nonce = [u8::from(is_last), 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0];
        nonce[4..].copy_from_slice(&self.number.to_be_bytes());
        change(&self.key, Nonce::assume_unique_for_key(nonce), &mut self.held)?;
        out.append(&mut self.held);
        self.number += 1;
        Ok(())
    }
}

fn encrypted(key: &LessSafeKey, nonce: Nonce, piece: &mut Vec<u8>) -> Result<(), Unspecified> {
    key.seal_in_place_append_tag(nonce, Aad::empty(), piece)
}

fn decrypted(key: &LessSafeKey, nonce: Nonce, piece: &mut Vec<u8>) -> Result<(), Unspecified> {
    let length = key.open_in_place(nonce, Aad::empty(), piece)?.len();
    piece.truncate(length);
    Ok(())
}

fn not_encrypted(_: Unspecified) -> StoreError {
    StoreError::Record { detail: "a value cannot be encrypted".to_owned() }
}

fn id_of(key: &[u8; KEY_LENGTH]) -> [u8; ID_LENGTH] {
    let mut id = [0; ID_LENGTH];
    id.iter_mut().zip(Sha256::digest(key)).for_each(|(to, from)| *to = from);
    id
}

fn from_hex(text: &str) -> Option<[u8; KEY_LENGTH]> {
    let mut bytes = [0; KEY_LENGTH];
    let digits = text.as_bytes();
    if digits.len() != 2 * KEY_LENGTH {
        return None;
    }
    for (byte, pair) in bytes.iter_mut().zip(digits.chunks_exact(2)) {
        let [high, low] = [pair.first()?, pair.get(1)?].map(|d| char::from(*d).to_digit(16));
        *byte = u8::try_from(high? * 16 + low?).ok()?;
    }
    Some(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn keys(bytes: &[u8]) -> Keyring {
        let texts: Vec<String> = bytes.iter().map(|byte| hex(&[*byte; KEY_LENGTH])).collect();
        Keyring::new(texts.iter().map(String::as_str)).unwrap()
    }

    fn stored(keys: &Keyring, name: &str, content: &[u8], part: usize) -> Vec<u8> {
        let mut encrypting = keys.encrypt(name).unwrap().unwrap();
        let mut out = Vec::new();
        content.chunks(part).for_each(|part| out.extend(encrypting.add(part).unwrap()));
        out.extend(encrypting.end().unwrap());
        out
    }

    #[tokio::test]
    async fn values_come_back_and_every_change_shows() {
        let ring = keys(&[1]);
        for length in [0, 1, PIECE - 1, PIECE, PIECE + 1, 3 * PIECE, TURN + 7] {
            let content: Vec<u8> = (0..length).map(|i| i as u8).collect();
            let made = stored(&ring, "a", &content, 10_000);
            assert_eq!(made.len(), HEADER + length + TAG * length.div_ceil(PIECE).max(1));
            assert_eq!(ring.open("a", &made).await.unwrap(), content, "{length}");
            let mut file = Vec::new();
            ring.encrypt_file("a", &mut content.as_slice(), &mut file).unwrap();
            let mut back = Vec::new();
            ring.decrypt_file("a", &mut file.as_slice(), &mut back).unwrap();
            assert_eq!(back, content);

            let is_damaged = async |made: &[u8], name: &str| matches!(ring.open(name, made).await, Err(StoreError::Damaged { key }) if key == name);
            assert!(is_damaged(&made, "b").await, "the value of another name");
            for at in [0, MARK.len() + ID_LENGTH, HEADER, made.len() / 2 + HEADER / 2, made.len() - 1] {
                let mut changed = made.clone();
                changed[at] ^= 4;
                assert!(is_damaged(&changed, "a").await, "{length} {at}");
            }
            // A value that is cut off, also where a piece ends, and one with a piece twice.
            for end in [0, HEADER, HEADER + PIECE + TAG, made.len() - 1] {
                assert!(end >= made.len() || is_damaged(&made[..end], "a").await, "{length} {end}");
            }
            assert!(is_damaged(&[made.as_slice(), &made[HEADER..]].concat(), "a").await);
        }
    }

    #[tokio::test]
    async fn all_keys_decrypt_and_the_first_encrypts() {
        let (old, both, new) = (keys(&[1]), keys(&[2, 1]), keys(&[2]));
        let [before, after] = [stored(&old, "a", b"x", 9), stored(&both, "a", b"x", 9)];
        assert_eq!(both.open("a", &before).await.unwrap(), b"x");
        assert_eq!(new.open("a", &after).await.unwrap(), b"x");
        let unknown = new.open("a", &before).await.unwrap_err();
        let id = old.ids().next().unwrap();
        assert!(matches!(&unknown, StoreError::KeyUnknown { id: found } if *found == id), "{unknown}");
        assert_ne!(stored(&new, "a", b"x", 9), after, "the same value twice");
        assert!(keys(&[]).encrypt("a").unwrap().is_none());
    }

    #[test]
    fn keys_are_read_and_never_shown() {
        let (key, id) = Keyring::new_key().unwrap();
        let ring = Keyring::of_file(&format!("# new\n\n {key} \n{}\n", "ab".repeat(32))).unwrap();
        assert_eq!(ring.ids().collect::<Vec<_>>()[0], id);
        assert!(!format!("{ring:?}").contains(&key[..20]) && format!("{ring:?}").contains(&id));
        assert!(Keyring::of_file("# none").is_err());
        for text in ["", "ab", &"g".repeat(64), &"é".repeat(32)] {
            assert!(Keyring::new([text]).unwrap_err().starts_with("key 1 does not have 64"), "{text}");
        }
    }
}
