//! Where a file's bytes go, and what happens when there is no more room.

use std::fs::File;
use std::io::{self, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use rustix::fs::{FallocateFlags, fallocate};

/// Space that is kept at least, bytes.
const RESERVE_BYTES_MIN: u64 = 1 << 20;
/// A summary tells of every chunk in about so many bytes.
const SUMMARY_BYTES_PER_CHUNK: u64 = 1024;

/// Collects what is written, and hands it to the system when it is flushed: whole, or not at all. Clones are one sink.
#[derive(Clone)]
pub(super) struct Sink(Arc<Mutex<State>>);

struct State {
    file: File,
    /// Bytes that the file has.
    length: u64,
    pending: Vec<u8>,
    reserve_path: PathBuf,
    reserve: Option<File>,
    reserve_bytes: u64,
    chunks: u64,
    is_full: bool,
}

impl Sink {
    /// Creates the file and, beside it, the reserve.
    pub(super) fn create(path: &Path) -> io::Result<Self> {
        let file = File::create_new(path)?;
        let reserve_path = path.with_extension("reserve");
        let mut state = State {
            file,
            length: 0,
            pending: Vec::new(),
            reserve: Some(File::create(&reserve_path)?),
            reserve_path,
            reserve_bytes: 0,
            chunks: 0,
            is_full: false,
        };
        if let Err(error) = state.keep_reserve(RESERVE_BYTES_MIN) {
            state.give_up_reserve();
            return Err(error);
        }
        Ok(Self(Arc::new(Mutex::new(state))))
    }

    /// Whether the medium has no more room: from now on only what closes the file may be written.
    pub(super) fn is_full(&self) -> bool {
        self.lock().is_full
    }

    /// Size of the file when all is written.
    pub(super) fn position(&self) -> u64 {
        let state = self.lock();
        state.length + state.pending.len() as u64
    }

    /// Hands over the rest, waits until the disk has it all, and gives up the reserve.
    pub(super) fn finish(&self) -> io::Result<()> {
        let mut state = self.lock();
        state.give_up_reserve();
        state.commit()?;
        state.file.sync_all()
    }

    pub(super) fn give_up_reserve(&self) {
        self.lock().give_up_reserve();
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl State {
    /// Writes what is pending. When there is no room the reserve makes some, and the sink is full.
    fn commit(&mut self) -> io::Result<()> {
        let pending = std::mem::take(&mut self.pending);
        if pending.is_empty() {
            return Ok(());
        }
        let mut written = self.write(&pending);
        if self.reserve.is_some() && written.as_ref().is_err_and(is_no_room) {
            self.give_up_reserve();
            self.is_full = true;
            written = self.file.set_len(self.length).and_then(|()| self.write(&pending));
        }
        if let Err(error) = written {
            // Half a chunk is of no use: the file ends with a whole one.
            let _ = self.file.set_len(self.length);
            return Err(error);
        }
        self.length += pending.len() as u64;
        self.chunks += 1;
        // Room for another chunk like this one, and for the summary.
        let wanted = RESERVE_BYTES_MIN + 2 * pending.len() as u64 + self.chunks * SUMMARY_BYTES_PER_CHUNK;
        if !self.is_full && wanted > self.reserve_bytes {
            // Twice as much as needed, so that it is not enlarged for every chunk.
            match self.keep_reserve(2 * wanted) {
                Err(error) if is_no_room(&error) => {
                    self.give_up_reserve();
                    self.is_full = true;
                }
                other => other?,
            }
        }
        // The buffer is used again.
        self.pending = pending;
        self.pending.clear();
        Ok(())
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        use std::os::unix::fs::FileExt as _;
        self.file.write_all_at(bytes, self.length)
    }

    fn keep_reserve(&mut self, bytes: u64) -> io::Result<()> {
        if let Some(reserve) = &self.reserve {
            match fallocate(reserve, FallocateFlags::empty(), 0, bytes) {
                // A file system without reservations has to do without: then a full disk costs the last chunk.
                Err(rustix::io::Errno::OPNOTSUPP | rustix::io::Errno::NOSYS) => {}
                other => other?,
            }
            self.reserve_bytes = bytes;
        }
        Ok(())
    }

    fn give_up_reserve(&mut self) {
        if self.reserve.take().is_some() {
            // Nothing depends on it being gone but free space.
            let _ = std::fs::remove_file(&self.reserve_path);
        }
    }
}

impl Drop for State {
    fn drop(&mut self) {
        self.give_up_reserve();
    }
}

/// Whether an error means that there is no room: on the medium, in a quota, or within the largest size of a file.
fn is_no_room(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded | io::ErrorKind::FileTooLarge)
}

impl Write for Sink {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.lock().pending.extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.lock().commit()
    }
}

impl Seek for Sink {
    /// Only tells the position.
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        match to {
            SeekFrom::Current(0) => Ok(self.position()),
            _ => Err(io::Error::other("this sink only appends")),
        }
    }
}
