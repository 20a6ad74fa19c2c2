//! The terminal while it is ours: raw, on its other screen, without a cursor.

use std::io::{self, Stdout, stdout};

use ratatui::backend::CrosstermBackend;
use ratatui::crossterm::cursor::{Hide, Show};
use ratatui::crossterm::execute;
use ratatui::crossterm::terminal::{
    Clear, ClearType, EnterAlternateScreen, LeaveAlternateScreen, disable_raw_mode, enable_raw_mode, size,
};
use ratatui::layout::Rect;
use ratatui::{Frame, Terminal, TerminalOptions, Viewport};

/// The terminal, ours until dropped: by a panic too.
pub(crate) struct Held {
    terminal: Terminal<CrosstermBackend<Stdout>>,
    size: (u16, u16),
}

/// A terminal of which nothing is known to be drawn. Its size is watched here, as the library would ask the terminal
/// for its cursor, and fail where that does not answer.
fn blank((columns, rows): (u16, u16)) -> io::Result<Terminal<CrosstermBackend<Stdout>>> {
    let viewport = Viewport::Fixed(Rect::new(0, 0, columns, rows));
    Terminal::with_options(CrosstermBackend::new(stdout()), TerminalOptions { viewport })
}

impl Held {
    /// Takes it.
    pub(crate) fn take() -> io::Result<Self> {
        let size = size()?;
        let mut held = Self { terminal: blank(size)?, size };
        enable_raw_mode()?;
        execute!(stdout(), EnterAlternateScreen, Hide)?;
        held.begin_anew()?;
        Ok(held)
    }

    /// Draws everything anew the next time.
    pub(crate) fn begin_anew(&mut self) -> io::Result<()> {
        execute!(stdout(), Clear(ClearType::All))?;
        self.size = size()?;
        self.terminal = blank(self.size)?;
        Ok(())
    }

    /// Draws what has changed.
    pub(crate) fn draw(&mut self, draw: impl FnOnce(&mut Frame<'_>)) -> io::Result<()> {
        if size()? != self.size {
            self.begin_anew()?;
        }
        self.terminal.draw(draw)?;
        Ok(())
    }
}

impl Drop for Held {
    /// Gives it back as it was.
    fn drop(&mut self) {
        // One that is gone needs nothing.
        let _ = execute!(stdout(), LeaveAlternateScreen, Show);
        let _ = disable_raw_mode();
    }
}
