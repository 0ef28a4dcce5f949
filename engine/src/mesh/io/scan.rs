//! A cursor over the bytes of a file that knows where it is, shared by all readers.

use crate::mesh::error::{FileProblem, MeshError, Place};
use glam::DVec3;
use std::collections::HashMap;
use std::collections::hash_map::Entry;

/// A read position in a file, by lines, by words or by bytes.
pub(crate) struct Cursor<'a> {
    pub file: &'a str,
    pub data: &'a [u8],
    pub position: usize,
    /// Line of the last line or word read, from 1.
    pub line: usize,
    /// Line on which `position` lies.
    next_line: usize,
    /// Errors name byte offsets rather than lines.
    pub binary: bool,
}

impl<'a> Cursor<'a> {
    pub fn new(file: &'a str, data: &'a [u8]) -> Self {
        Cursor { file, data, position: 0, line: 1, next_line: 1, binary: false }
    }

    /// Where the last item was read.
    pub fn place(&self) -> Place {
        if self.binary { Place::Byte(self.position) } else { Place::Line(self.line) }
    }

    pub fn remaining(&self) -> &'a [u8] {
        self.data.get(self.position..).unwrap_or(&[])
    }

    /// The next line without its end, or `None` at the end of the file.
    pub fn next_line(&mut self) -> Option<&'a [u8]> {
        let rest = self.remaining();
        if rest.is_empty() {
            return None;
        }
        self.line = self.next_line;
        let length = rest.iter().position(|&b| b == b'\n');
        if length.is_some() {
            self.next_line += 1;
        }
        let length = length.unwrap_or(rest.len());
        self.position += (length + 1).min(rest.len());
        let line = &rest[..length];
        Some(line.strip_suffix(b"\r").unwrap_or(line))
    }

    /// The next line that is not blank, without surrounding white space.
    pub fn filled_line(&mut self) -> Option<&'a [u8]> {
        loop {
            let line = self.next_line()?.trim_ascii();
            if !line.is_empty() {
                return Some(line);
            }
        }
    }

    /// Like [`Cursor::filled_line`], but the end of the file is an error.
    pub fn expect_line(&mut self, expected: &str) -> Result<&'a [u8], MeshError> {
        self.filled_line().ok_or_else(|| self.end(expected))
    }

    /// The next word, or `None` at the end of the file.
    pub fn word(&mut self) -> Option<&'a [u8]> {
        let rest = self.remaining();
        let start = rest.iter().position(|b| !b.is_ascii_whitespace());
        let skipped = start.unwrap_or(rest.len());
        self.next_line += rest[..skipped].iter().filter(|&&b| b == b'\n').count();
        self.line = self.next_line;
        self.position += skipped;
        start?;
        let rest = self.remaining();
        let length = rest.iter().position(u8::is_ascii_whitespace).unwrap_or(rest.len());
        self.position += length;
        Some(&rest[..length])
    }

    pub fn expect_word(&mut self, expected: &str) -> Result<&'a [u8], MeshError> {
        self.word().ok_or_else(|| self.end(expected))
    }

    /// The next `count` bytes.
    pub fn take(&mut self, count: usize, expected: &str) -> Result<&'a [u8], MeshError> {
        let Some(bytes) = self.remaining().get(..count) else {
            return Err(self.end(&format!("{count} bytes of {expected}")));
        };
        self.position += count;
        Ok(bytes)
    }

    /// Moves behind `bytes` more bytes, counting their line ends.
    pub fn skip_counting(&mut self, bytes: usize) {
        let rest = self.remaining();
        let bytes = bytes.min(rest.len());
        self.next_line += rest[..bytes].iter().filter(|&&b| b == b'\n').count();
        self.line = self.next_line;
        self.position += bytes;
    }

    /// Checks that `count` items of at least `size` bytes can still follow, before room is made.
    pub fn room_for(&self, count: u64, size: u64, what: &str) -> Result<usize, MeshError> {
        let needed = count.checked_mul(size);
        if needed.is_none_or(|needed| needed > self.remaining().len() as u64 + 1) {
            return Err(self.end(&format!("{count} {what}")));
        }
        // Fits: the items lie in a slice in memory.
        Ok(count as usize)
    }

    /// An error where the last item was read.
    pub fn error(&self, problem: FileProblem) -> MeshError {
        MeshError::File { file: self.file.to_owned(), place: self.place(), problem }
    }

    pub fn end(&self, expected: &str) -> MeshError {
        self.error(FileProblem::UnexpectedEnd { expected: expected.to_owned() })
    }

    pub fn invalid(&self, found: &[u8], expected: &str) -> MeshError {
        self.error(FileProblem::invalid(found, expected))
    }

    pub fn unsupported(&self, feature: String, remedy: &'static str) -> MeshError {
        self.error(FileProblem::Unsupported { feature, remedy })
    }

    pub fn mismatch(&self, what: &str, expected: u64, found: u64) -> MeshError {
        self.error(FileProblem::mismatch(what, expected, found))
    }

    pub fn missing(&self, section: &'static str) -> MeshError {
        let place = if self.binary {
            Place::Byte(self.data.len())
        } else {
            Place::Line(line_at(self.data, self.data.len()))
        };
        let problem = FileProblem::MissingSection { section };
        MeshError::File { file: self.file.to_owned(), place, problem }
    }

    pub fn integer(&self, word: &[u8], expected: &str) -> Result<i64, MeshError> {
        parse(word).ok_or_else(|| self.invalid(word, expected))
    }

    pub fn count(&self, word: &[u8], expected: &str) -> Result<u64, MeshError> {
        parse(word).ok_or_else(|| self.invalid(word, expected))
    }

    pub fn real(&self, word: &[u8], expected: &str) -> Result<f64, MeshError> {
        parse(word).ok_or_else(|| self.invalid(word, expected))
    }

    /// Three coordinates from the words of a line.
    pub fn point<'w>(
        &self,
        words: &mut impl Iterator<Item = &'w [u8]>,
    ) -> Result<DVec3, MeshError> {
        let mut point = [0.0; 3];
        for value in &mut point {
            let word = words.next().unwrap_or(b"");
            *value = self.real(word, "a coordinate (three numbers)")?;
        }
        Ok(DVec3::from_array(point))
    }
}

/// A name that a file gives. It reaches terminals and tables, so it has no control characters.
pub(crate) fn name(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).replace(char::is_control, " ")
}

/// The words of a line.
pub(crate) fn words(line: &[u8]) -> impl Iterator<Item = &[u8]> {
    line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty())
}

/// A number from a word.
pub(crate) fn parse<T: std::str::FromStr>(word: &[u8]) -> Option<T> {
    std::str::from_utf8(word).ok()?.parse().ok()
}

/// The line, from 1, on which the byte at `position` lies.
pub(crate) fn line_at(data: &[u8], position: usize) -> usize {
    1 + data[..position.min(data.len())].iter().filter(|&&b| b == b'\n').count()
}

/// Vertex numbers of a file and the indices they stand for.
#[derive(Default)]
pub(crate) struct Numbering {
    first: i64,
    len: usize,
    /// Filled only when the numbers are not consecutive.
    map: HashMap<i64, u32>,
}

impl Numbering {
    /// Gives `number` the next index; `false` when it has one already.
    pub fn push(&mut self, number: i64) -> bool {
        if self.len == 0 {
            self.first = number;
        }
        let consecutive = number.checked_sub(self.first) == Some(self.len as i64);
        if self.map.is_empty() && !consecutive {
            self.map = (0..self.len as u32).map(|i| (self.first + i64::from(i), i)).collect();
        }
        let new = if self.map.is_empty() {
            true
        } else if let Entry::Vacant(vacant) = self.map.entry(number) {
            vacant.insert(self.len as u32);
            true
        } else {
            false
        };
        self.len += usize::from(new);
        new
    }

    /// The index of the vertex with that number.
    pub fn index(&self, number: i64) -> Option<u32> {
        if self.map.is_empty() {
            let offset = number.checked_sub(self.first)?;
            u32::try_from(offset).ok().filter(|&i| (i as usize) < self.len)
        } else {
            self.map.get(&number).copied()
        }
    }

    pub fn len(&self) -> usize {
        self.len
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_and_words_know_where_they_are() {
        let mut cursor = Cursor::new("f", b"one\r\n\n  two three\nfour");
        assert_eq!(cursor.next_line(), Some(&b"one"[..]));
        assert_eq!(cursor.word(), Some(&b"two"[..]));
        assert_eq!(cursor.line, 3);
        assert_eq!(cursor.next_line(), Some(&b" three"[..]));
        assert_eq!(cursor.filled_line(), Some(&b"four"[..]));
        assert_eq!(cursor.line, 4);
        assert_eq!(cursor.next_line(), None);
        assert_eq!(cursor.word(), None);
    }

    #[test]
    fn numbering_of_any_kind() {
        for numbers in [vec![1, 2, 3], vec![7, 3, 100], vec![0, 1, 5], vec![i64::MIN, i64::MAX, 0]]
        {
            let mut numbering = Numbering::default();
            for &number in &numbers {
                assert!(numbering.push(number));
            }
            for (i, &number) in numbers.iter().enumerate() {
                assert_eq!(numbering.index(number), Some(i as u32));
                assert!(!numbering.push(number));
            }
            assert_eq!(numbering.len(), 3);
            assert_eq!(numbering.index(50), None);
        }
    }

    #[test]
    fn a_repeated_number_keeps_the_first_index() {
        let mut numbering = Numbering::default();
        assert!(numbering.push(4) && !numbering.push(4) && numbering.push(5));
        assert_eq!((numbering.index(4), numbering.index(5)), (Some(0), Some(1)));
    }

    #[test]
    fn counts_without_data_are_refused() {
        let cursor = Cursor::new("f", b"12345678");
        assert!(cursor.room_for(1, 8, "numbers").is_ok());
        assert!(cursor.room_for(u64::MAX, 8, "numbers").is_err());
        assert!(cursor.room_for(2, 8, "numbers").is_err());
    }
}
