//! A file seen through a window: small reads one after the other cost few system calls.

use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt as _;

const WINDOW_BYTES: usize = 64 * 1024;

pub(super) struct FileWindow<'a> {
    file: &'a File,
    length: u64,
    start: u64,
    bytes: Vec<u8>,
}

impl<'a> FileWindow<'a> {
    pub(super) fn new(file: &'a File, length: u64) -> Self {
        Self { file, length, start: 0, bytes: Vec::new() }
    }

    /// Up to `count` bytes from `offset`, fewer at the end of the file.
    pub(super) fn at(&mut self, offset: u64, count: usize) -> io::Result<&[u8]> {
        let available = usize::try_from(self.length.saturating_sub(offset)).unwrap_or(usize::MAX);
        let count = count.min(available);
        let inside = offset.checked_sub(self.start).and_then(|from| usize::try_from(from).ok());
        let from = match inside.filter(|from| from.checked_add(count).is_some_and(|end| end <= self.bytes.len())) {
            Some(from) => from,
            None => {
                self.bytes.resize(count.max(WINDOW_BYTES).min(available), 0);
                self.file.read_exact_at(&mut self.bytes, offset)?;
                self.start = offset;
                0
            }
        };
        Ok(&self.bytes[from..from + count])
    }
}
