//! The terminal from its opening to its end: keys, signals, and what is drawn ten times a second.

use std::io::{self, IsTerminal as _, Write as _, stderr, stdin, stdout};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use feeder_view::Watch;
use ratatui::crossterm::event::{self, Event, KeyCode, KeyEventKind, KeyModifiers};
use signal_hook::consts::SIGTSTP;

use crate::draw::{Palette, draw};
use crate::held::Held;
use crate::picture::Picture;
use crate::stderr::Led;

/// Between two pictures.
const BEAT: Duration = Duration::from_millis(100);
/// The DDS library's threads end when a process that was stopped goes on, as the system interrupts their waiting.
const NEVER_STOPS: &str = "it cannot be stopped for a while, as it would not hear the graph again: q ends it";

/// Why there is no screen.
#[derive(Debug, thiserror::Error)]
pub enum ScreenError {
    /// The terminal does not do as it is asked.
    #[error("cannot draw on the terminal")]
    Terminal(#[from] io::Error),
}

/// Whether there is a terminal that can be drawn on, with somebody at its keys: standard input and output are one, it
/// can do more than lines, and this process is in its foreground.
#[must_use]
pub fn is_possible() -> bool {
    let is_able = std::env::var_os("TERM").is_some_and(|name| !name.is_empty() && name != "dumb");
    let in_front = || rustix::termios::tcgetpgrp(stdout()).is_ok_and(|group| group == rustix::process::getpgrp());
    is_able && stdin().is_terminal() && stdout().is_terminal() && in_front()
}

/// A terminal that shows a run, until it is closed or dropped.
pub struct Screen {
    picture: Arc<Mutex<Picture>>,
    leave: Arc<AtomicBool>,
    drawing: Option<JoinHandle<io::Result<()>>>,
    stderr: Option<Led>,
    /// Standard error goes elsewhere, where the lines of the log belong as well.
    elsewhere: bool,
}

fn lock(picture: &Mutex<Picture>) -> MutexGuard<'_, Picture> {
    picture.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Screen {
    /// Takes the terminal and shows what `watch` sees. `note` stands at the bottom. When somebody wants it to end, by a
    /// key, `quit` is set.
    ///
    /// # Errors
    /// A terminal that cannot be drawn on. It is as it was.
    pub fn open(watch: Watch, note: &str, quit: Arc<AtomicBool>) -> Result<Self, ScreenError> {
        let picture = Arc::new(Mutex::new(Picture::new(note)));
        let leave = Arc::new(AtomicBool::new(false));
        let stopped = Arc::new(AtomicBool::new(false));
        signal_hook::flag::register(SIGTSTP, Arc::clone(&stopped))?;
        let elsewhere = !stderr().is_terminal();
        let lines = Arc::clone(&picture);
        let led = Led::away(move |line| lock(&lines).line(line))?;
        let drawing = Held::take().and_then(|held| {
            let drawing = Drawing { held, watch, quit, stopped, palette: Palette::from_env() };
            let (picture, leave) = (Arc::clone(&picture), Arc::clone(&leave));
            std::thread::Builder::new().name("screen".to_owned()).spawn(move || drawing.run(&picture, &leave))
        });
        let mut screen = Self { picture, leave, drawing: None, stderr: led, elsewhere };
        screen.drawing = Some(drawing?);
        Ok(screen)
    }

    /// Shows a line of the log.
    pub fn line(&self, line: &str) {
        if self.elsewhere {
            eprintln!("{line}");
        }
        lock(&self.picture).line(line);
    }

    /// Whether it is still drawn: not so when the terminal is gone.
    #[must_use]
    pub fn is_open(&self) -> bool {
        self.drawing.as_ref().is_some_and(|drawing| !drawing.is_finished())
    }

    /// Gives the terminal back, and writes there what was logged meanwhile.
    pub fn close(&mut self) {
        self.leave.store(true, Ordering::Relaxed);
        let Some(drawing) = self.drawing.take() else { return };
        // One that panicked has said so, and gave the terminal back on its way.
        let drawn = drawing.join().unwrap_or(Ok(()));
        if let Some(led) = self.stderr.take() {
            led.back();
        }
        let mut terminal = stderr().lock();
        if !self.elsewhere {
            for line in std::mem::take(&mut lock(&self.picture).lines) {
                // Nobody reads it any more.
                let _ = writeln!(terminal, "{line}");
            }
        }
        if let Err(error) = drawn {
            let _ = writeln!(terminal, "the terminal cannot be drawn on: {error}");
        }
    }
}

impl Drop for Screen {
    fn drop(&mut self) {
        self.close();
        if let Some(led) = self.stderr.take() {
            led.back();
        }
    }
}

/// What draws.
struct Drawing {
    held: Held,
    watch: Watch,
    quit: Arc<AtomicBool>,
    /// Somebody wants this process to stop for a while.
    stopped: Arc<AtomicBool>,
    palette: Palette,
}

impl Drawing {
    fn run(mut self, picture: &Mutex<Picture>, leave: &AtomicBool) -> io::Result<()> {
        while !leave.load(Ordering::Relaxed) {
            {
                let mut picture = lock(picture);
                if self.stopped.swap(false, Ordering::Relaxed) {
                    picture.say(NEVER_STOPS);
                }
                picture.take(self.watch.look());
                self.held.draw(|frame| draw(frame, &picture, self.palette))?;
            }
            let mut patience = BEAT;
            while event::poll(patience)? {
                self.hear(&event::read()?, picture)?;
                patience = Duration::ZERO;
            }
        }
        Ok(())
    }

    fn hear(&mut self, event: &Event, picture: &Mutex<Picture>) -> io::Result<()> {
        let Event::Key(key) = event else { return Ok(()) };
        if key.kind == KeyEventKind::Release {
            return Ok(());
        }
        let with_control = key.modifiers.contains(KeyModifiers::CONTROL);
        match key.code {
            KeyCode::Char('c' | '\\') if with_control => self.quit.store(true, Ordering::Relaxed),
            KeyCode::Char('q') | KeyCode::Esc => self.quit.store(true, Ordering::Relaxed),
            KeyCode::Char('z') if with_control => self.stopped.store(true, Ordering::Relaxed),
            KeyCode::Char('l') if with_control => self.held.begin_anew()?,
            KeyCode::Tab | KeyCode::Right => self.watch.turn_to(lock(picture).turn(true)),
            KeyCode::BackTab | KeyCode::Left => self.watch.turn_to(lock(picture).turn(false)),
            _ => {}
        }
        Ok(())
    }
}
