//! Standard error while the screen is drawn: whatever writes there, this process or a library, writes a line of the
//! screen and does not tear it.

use std::io::{BufRead as _, BufReader, IsTerminal as _, Write as _, stderr};
use std::os::fd::{AsFd as _, OwnedFd};
use std::thread::JoinHandle;

/// Standard error, led elsewhere until it is given back.
pub(crate) struct Led {
    terminal: OwnedFd,
    reader: JoinHandle<()>,
}

impl Led {
    /// Hands every line to `line` from now on; where standard error is no terminal it is left alone.
    ///
    /// # Errors
    /// What the system says when there is no pipe.
    pub(crate) fn away(mut line: impl FnMut(&str) + Send + 'static) -> std::io::Result<Option<Self>> {
        if !stderr().is_terminal() {
            return Ok(None);
        }
        let terminal = stderr().as_fd().try_clone_to_owned()?;
        let (lines, inlet) = std::io::pipe()?;
        let read = move || {
            for bytes in BufReader::new(lines).split(b'\n').map_while(Result::ok) {
                line(&String::from_utf8_lossy(&bytes));
            }
        };
        let reader = std::thread::Builder::new().name("stderr".to_owned()).spawn(read)?;
        // Only now, as nobody would read it before.
        rustix::stdio::dup2_stderr(&inlet)?;
        Ok(Some(Self { terminal, reader }))
    }

    /// Gives it back. All that was written has been handed over.
    pub(crate) fn back(self) {
        let _ = stderr().flush();
        // Closes the last way into the pipe, so that its reader comes to the end.
        if rustix::stdio::dup2_stderr(&self.terminal).is_ok() {
            let _ = self.reader.join();
        }
    }
}
