//! The text before the nodes.

use std::str::FromStr;

use super::OctomapError;

pub(super) const BINARY_FIRST_LINE: &str = "# Octomap OcTree binary file";
pub(super) const FULL_FIRST_LINE: &str = "# Octomap OcTree file";

/// Hostile files can hold megabytes without a space; messages quote at most this much of them.
const MAX_QUOTED_BYTES: usize = 60;

/// What an OctoMap file says about itself.
#[derive(Debug, Clone, PartialEq)]
pub struct OctomapHeader {
    /// Type of the tree, e.g. `OcTree` or `ColorOcTree`.
    pub id: String,
    /// Nodes including the root and inner nodes (`size`).
    pub node_count: u64,
    /// Side of the smallest cells in metres (`res`).
    pub voxel_size_m: f64,
    /// `.bt`: two bits per child. Otherwise `.ot`: the full value of each node.
    pub binary: bool,
}

impl OctomapHeader {
    /// Returns the header and the position of the first node.
    ///
    /// Like the library's reader it goes by words: fields may come in any order and on any line,
    /// with `#` comments between them. Unlike it, a repeated field or an unknown keyword is an
    /// error: either could change the meaning.
    pub(super) fn parse(data: &[u8]) -> Result<(Self, usize), OctomapError> {
        let mut words = Words { data, position: 0 };
        let binary = is_binary(words.rest_of_line())?;
        let (mut id, mut size, mut res) = (None, None, None);
        loop {
            let keyword = words.next().ok_or(OctomapError::MissingField { field: "data" })?;
            let (field, value) = match keyword {
                b"data" => break,
                b"id" => ("id", &mut id),
                b"size" => ("size", &mut size),
                b"res" => ("res", &mut res),
                _ if keyword.starts_with(b"#") => {
                    words.rest_of_line();
                    continue;
                }
                _ => {
                    return Err(OctomapError::UnknownKeyword { keyword: quoted(keyword) });
                }
            };
            if value.is_some() {
                return Err(OctomapError::RepeatedField { field });
            }
            *value = words.next();
        }
        words.rest_of_line();
        let header = Self {
            id: parse_field("id", id, "a name", |_| true)?,
            node_count: parse_field("size", size, "a whole number", |_| true)?,
            voxel_size_m: parse_field("res", res, "finite and above 0", is_voxel_size)?,
            binary,
        };
        Ok((header, words.position))
    }

    pub(super) fn to_text(&self) -> String {
        let Self { id, node_count, voxel_size_m, binary } = self;
        let first_line = if *binary { BINARY_FIRST_LINE } else { FULL_FIRST_LINE };
        format!("{first_line}\nid {id}\nsize {node_count}\nres {voxel_size_m}\ndata\n")
    }
}

pub(super) fn is_voxel_size(metres: &f64) -> bool {
    metres.is_finite() && *metres > 0.0
}

fn is_binary(first_line: &[u8]) -> Result<bool, OctomapError> {
    if first_line.starts_with(BINARY_FIRST_LINE.as_bytes()) {
        Ok(true)
    } else if first_line.starts_with(FULL_FIRST_LINE.as_bytes()) {
        Ok(false)
    } else {
        Err(OctomapError::FirstLine { found: quoted(first_line) })
    }
}

fn parse_field<T: FromStr>(
    field: &'static str,
    word: Option<&[u8]>,
    expected: &'static str,
    is_valid: impl Fn(&T) -> bool,
) -> Result<T, OctomapError> {
    let word = word.ok_or(OctomapError::MissingField { field })?;
    let value = str::from_utf8(word).ok().and_then(|text| text.parse().ok());
    value.filter(is_valid).ok_or_else(|| {
        let found = quoted(word);
        OctomapError::InvalidField { field, found, expected }
    })
}

pub(super) fn quoted(bytes: &[u8]) -> String {
    String::from_utf8_lossy(&bytes[..bytes.len().min(MAX_QUOTED_BYTES)]).into_owned()
}

/// Words and lines of the header, from the front.
struct Words<'a> {
    data: &'a [u8],
    position: usize,
}

impl<'a> Words<'a> {
    fn next(&mut self) -> Option<&'a [u8]> {
        let rest = &self.data[self.position..];
        let start = rest.iter().position(|byte| !byte.is_ascii_whitespace())?;
        let word = rest[start..].split(u8::is_ascii_whitespace).next()?;
        self.position += start + word.len();
        Some(word)
    }

    /// Up to the line feed, which is consumed and not returned.
    fn rest_of_line(&mut self) -> &'a [u8] {
        let rest = &self.data[self.position..];
        let length = rest.iter().position(|&byte| byte == b'\n');
        self.position += length.map_or(rest.len(), |length| length + 1);
        &rest[..length.unwrap_or(rest.len())]
    }
}
