//! Keys: hashes of contents, and of what values are computed from.

use std::fmt;

use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// Part of every key. Raised when recordings may hold values under wrong keys: those of depthloom 0.1 (version 1) can
/// hold the values of another variant.
const KEY_VERSION: u64 = 2;

/// A 128-bit name: a prefix of a BLAKE3 hash, shown as 32 hexadecimal digits.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Key([u8; 16]);

impl Key {
    /// The key of a content.
    pub fn of_content(bytes: &[u8]) -> Self {
        Self::from_hash(&blake3::hash(bytes))
    }

    /// The key of a large content: equal to [`Key::of_content`] of the same bytes.
    ///
    /// # Errors
    /// If the content cannot be read.
    pub fn of_reader(reader: impl std::io::Read) -> std::io::Result<Self> {
        let mut hasher = blake3::Hasher::new();
        hasher.update_reader(reader)?;
        Ok(Self::from_hash(&hasher.finalize()))
    }

    /// A hasher for keys made of several parts; `domain` keeps keys of different meaning apart.
    pub fn build(domain: &str) -> KeyBuilder {
        let builder = KeyBuilder { parts: Vec::with_capacity(256), hasher: None }; // a node with three inputs
        builder.number(KEY_VERSION).text(domain)
    }

    /// As [`Key::build`], for stored digests that are not cache keys and do not depend on their version.
    pub fn digest(domain: &str) -> KeyBuilder {
        KeyBuilder { parts: Vec::with_capacity(128), hasher: None }.text(domain)
    }

    fn from_hash(hash: &blake3::Hash) -> Self {
        let mut bytes = [0; 16];
        bytes.copy_from_slice(&hash.as_bytes()[..16]);
        Self(bytes)
    }

    /// The sixteen bytes.
    pub const fn as_bytes(&self) -> &[u8; 16] {
        &self.0
    }

    /// Reads 32 hexadecimal digits.
    pub fn parse(text: &str) -> Option<Self> {
        if text.len() != 32 || !text.is_ascii() {
            return None;
        }
        let mut bytes = [0; 16];
        for (i, byte) in bytes.iter_mut().enumerate() {
            *byte = u8::from_str_radix(&text[2 * i..2 * i + 2], 16).ok()?;
        }
        Some(Self(bytes))
    }
}

impl From<[u8; 16]> for Key {
    fn from(bytes: [u8; 16]) -> Self {
        Self(bytes)
    }
}

impl fmt::Display for Key {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

impl fmt::Debug for Key {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

impl Serialize for Key {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl<'de> Deserialize<'de> for Key {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let text = String::deserialize(deserializer)?;
        Self::parse(&text).ok_or_else(|| serde::de::Error::custom("a key is 32 hexadecimal digits"))
    }
}

/// Parts from this length on, bytes, are hashed as they come.
const LONG: usize = 4096;

/// Collects the parts of a key; every part is length-prefixed, so that no two lists of parts collide.
///
/// Short parts are hashed together at the end, since a hasher of two kilobytes is expensive to move.
pub struct KeyBuilder {
    /// What is not hashed yet.
    parts: Vec<u8>,
    hasher: Option<Box<blake3::Hasher>>,
}

impl KeyBuilder {
    /// Adds bytes.
    #[must_use]
    pub fn bytes(mut self, bytes: &[u8]) -> Self {
        self.parts.extend_from_slice(&(bytes.len() as u64).to_le_bytes());
        if bytes.len() < LONG {
            self.parts.extend_from_slice(bytes);
        } else {
            self.hasher.get_or_insert_default().update(&self.parts).update(bytes);
            self.parts.clear();
        }
        self
    }

    /// Adds text.
    #[must_use]
    pub fn text(self, text: &str) -> Self {
        self.bytes(text.as_bytes())
    }

    /// Adds a number.
    #[must_use]
    pub fn number(self, number: u64) -> Self {
        self.bytes(&number.to_le_bytes())
    }

    /// Adds another key.
    #[must_use]
    pub fn key(self, key: &Key) -> Self {
        self.bytes(key.as_bytes())
    }

    /// The key of all parts added.
    #[must_use]
    pub fn finish(self) -> Key {
        match self.hasher {
            None => Key::of_content(&self.parts),
            Some(mut hasher) => Key::from_hash(&hasher.update(&self.parts).finalize()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Key;

    #[test]
    fn keys_read_back_from_their_text() {
        let key = Key::of_content(b"depth");
        assert_eq!(Key::parse(&key.to_string()), Some(key));
        assert_eq!(Key::parse("zz"), None);
        assert_eq!(Key::of_reader(&b"depth"[..]).expect("slices can be read"), key);
    }

    #[test]
    fn long_parts_are_hashed_as_short_ones_are() {
        for length in [0, 1, super::LONG - 1, super::LONG, 3 * super::LONG] {
            let long = vec![7; length];
            let parts: [&[u8]; 4] = [b"d", &long, b"ab", &long];
            let all: Vec<u8> =
                parts.iter().flat_map(|part| [&(part.len() as u64).to_le_bytes(), *part].concat()).collect();
            let key = Key::digest("d").bytes(&long).text("ab").bytes(&long).finish();
            assert_eq!(key, Key::of_content(&all), "{length}");
        }
    }

    #[test]
    fn parts_do_not_run_together() {
        assert_ne!(Key::build("d").text("ab").text("c").finish(), Key::build("d").text("a").text("bc").finish());
    }
}
