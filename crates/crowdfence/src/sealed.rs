//! The frame of our binary formats: which kind, which version, how long, and whole. All numbers are little-endian.
//!
//! ```text
//! magic            8 bytes
//! version          u32
//! payload length   u64
//! payload
//! checksum         u32      CRC-32 of everything before it
//! ```

use crate::error::{Error, Result};

/// Magic, version and payload length.
const HEAD_BYTES: usize = 8 + 4 + 8;
const CHECKSUM_BYTES: usize = 4;

/// One kind of content.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Kind {
    pub magic: &'static [u8; 8],
    /// In messages: "crowd map".
    pub name: &'static str,
    /// The newest version, which is written; older ones from 1 on are read.
    pub version: u32,
}

impl Kind {
    pub fn seal(&self, payload: Writer) -> Vec<u8> {
        let mut file = Writer::default();
        file.bytes(self.magic);
        file.u32(self.version);
        file.u64(payload.0.len() as u64);
        file.bytes(&payload.0);
        let checksum = crc32fast::hash(&file.0);
        file.u32(checksum);
        file.0
    }

    /// The version and the payload of bytes that are whole.
    pub fn open<'a>(&self, data: &'a [u8]) -> Result<(u32, Reader<'a>)> {
        let name = self.name;
        if data.len() < HEAD_BYTES + CHECKSUM_BYTES {
            return Err(Error::NotOfKind { name, why: "the file is too short".into() });
        }
        if &data[..8] != self.magic {
            let magic = String::from_utf8_lossy(self.magic);
            return Err(Error::NotOfKind { name, why: format!("it does not begin with {magic}") });
        }
        let version = u32::from_le_bytes(data[8..12].try_into().expect("4 bytes"));
        if !(1..=self.version).contains(&version) {
            return Err(Error::FormatVersion { name, version, supported: self.version });
        }
        let length = u64::from_le_bytes(data[12..HEAD_BYTES].try_into().expect("8 bytes"));
        let damaged = |offset, what| Error::Damaged { name, offset, what };
        if length != (data.len() - HEAD_BYTES - CHECKSUM_BYTES) as u64 {
            return Err(damaged(data.len(), "the file is shorter or longer than its header says"));
        }
        let (content, checksum) = data.split_at(data.len() - CHECKSUM_BYTES);
        if crc32fast::hash(content).to_le_bytes() != checksum {
            return Err(damaged(content.len(), "the checksum does not match"));
        }
        Ok((version, Reader { name, data: content, at: HEAD_BYTES }))
    }
}

#[derive(Debug, Default)]
pub(crate) struct Writer(Vec<u8>);

impl Writer {
    pub fn bytes(&mut self, bytes: &[u8]) {
        self.0.extend(bytes);
    }

    pub fn u8(&mut self, value: u8) {
        self.0.push(value);
    }

    pub fn u32(&mut self, value: u32) {
        self.bytes(&value.to_le_bytes());
    }

    pub fn u64(&mut self, value: u64) {
        self.bytes(&value.to_le_bytes());
    }

    pub fn i64(&mut self, value: i64) {
        self.bytes(&value.to_le_bytes());
    }

    pub fn f32(&mut self, value: f32) {
        self.bytes(&value.to_le_bytes());
    }

    pub fn f64(&mut self, value: f64) {
        self.bytes(&value.to_le_bytes());
    }

    /// u32 length, then UTF-8.
    pub fn text(&mut self, text: &str) {
        self.u32(text.len() as u32);
        self.bytes(text.as_bytes());
    }
}

/// Reads a payload from front to back; whatever is wrong is damage at a byte of the file.
#[derive(Debug)]
pub(crate) struct Reader<'a> {
    name: &'static str,
    data: &'a [u8],
    at: usize,
}

impl<'a> Reader<'a> {
    pub fn damaged(&self, what: &'static str) -> Error {
        Error::Damaged { name: self.name, offset: self.at, what }
    }

    pub fn take(&mut self, count: usize) -> Result<&'a [u8]> {
        let rest = &self.data[self.at..];
        if rest.len() < count {
            return Err(self.damaged("the payload ends early"));
        }
        self.at += count;
        Ok(&rest[..count])
    }

    /// `count` numbers of N bytes each.
    pub fn numbers<T, const N: usize>(&mut self, count: usize, from: fn([u8; N]) -> T) -> Result<Vec<T>> {
        let bytes = self.take(count.saturating_mul(N))?;
        Ok(bytes.chunks_exact(N).map(|number| from(number.try_into().expect("N bytes"))).collect())
    }

    fn number<T, const N: usize>(&mut self, from: fn([u8; N]) -> T) -> Result<T> {
        Ok(from(self.take(N)?.try_into().expect("N bytes")))
    }

    pub fn u8(&mut self) -> Result<u8> {
        self.number(u8::from_le_bytes)
    }

    pub fn u32(&mut self) -> Result<u32> {
        self.number(u32::from_le_bytes)
    }

    pub fn u64(&mut self) -> Result<u64> {
        self.number(u64::from_le_bytes)
    }

    pub fn i64(&mut self) -> Result<i64> {
        self.number(i64::from_le_bytes)
    }

    pub fn f32(&mut self) -> Result<f32> {
        self.number(f32::from_le_bytes)
    }

    pub fn f64(&mut self) -> Result<f64> {
        self.number(f64::from_le_bytes)
    }

    pub fn text(&mut self) -> Result<String> {
        let length = self.u32()? as usize;
        let text = std::str::from_utf8(self.take(length)?);
        text.map(str::to_owned).map_err(|_| self.damaged("a name that is not UTF-8"))
    }

    /// One of a few alternatives, numbered from 0.
    pub fn choice<T: Copy>(&mut self, alternatives: &[T]) -> Result<T> {
        let number = usize::from(self.u8()?);
        alternatives.get(number).copied().ok_or_else(|| self.damaged("an alternative that does not exist"))
    }

    /// To be called last.
    pub fn end(&self) -> Result<()> {
        if self.at == self.data.len() { Ok(()) } else { Err(self.damaged("bytes after the end")) }
    }
}
