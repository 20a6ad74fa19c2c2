//! Keys that control a player.

use std::io::Read as _;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::Sender;
use std::thread::JoinHandle;

use feeder_bag_transport::play::{Control, Done};
use rustix::termios::{LocalModes, OptionalActions, SpecialCodeIndex, Termios, isatty, tcgetattr, tcsetattr};

const SECOND_NS: i64 = 1_000_000_000;

/// A terminal that hands over keys at once, until this is dropped.
pub(crate) struct Keyboard {
    before: Termios,
    over: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

/// Listens to the keys of the terminal, if standard input is one.
pub(crate) fn listen(controls: Sender<Control>) -> Option<Keyboard> {
    let stdin = std::io::stdin();
    if !isatty(&stdin) {
        return None;
    }
    let before = tcgetattr(&stdin).ok()?;
    let mut raw = before.clone();
    raw.local_modes.remove(LocalModes::ICANON | LocalModes::ECHO);
    // Reading ends after a tenth of a second without a key.
    raw.special_codes[SpecialCodeIndex::VMIN] = 0;
    raw.special_codes[SpecialCodeIndex::VTIME] = 1;
    tcsetattr(&stdin, OptionalActions::Now, &raw).ok()?;
    let over = Arc::new(AtomicBool::new(false));
    let is_over = Arc::clone(&over);
    let read = move || {
        let mut bytes = [0; 16];
        while !is_over.load(Ordering::Relaxed) {
            let count = std::io::stdin().read(&mut bytes).unwrap_or(0);
            if let Some(control) = control(&bytes[..count])
                && controls.send(control).is_err()
            {
                return;
            }
        }
    };
    let thread = std::thread::Builder::new().name("keys".to_owned()).spawn(read).ok();
    Some(Keyboard { before, over, thread })
}

impl Drop for Keyboard {
    fn drop(&mut self) {
        self.over.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // A thread that panicked has no terminal to give back.
            let _ = thread.join();
        }
        // Nothing is left to do when the terminal is gone.
        let _ = tcsetattr(std::io::stdin(), OptionalActions::Now, &self.before);
    }
}

/// What a key means; keys that send several bytes come together.
fn control(bytes: &[u8]) -> Option<Control> {
    Some(match bytes {
        b" " => Control::TogglePaused(Done::nobody()),
        b"q" => Control::Stop(Done::nobody()),
        b"\x1b[A" => Control::ScaleRate(1.1),
        b"\x1b[B" => Control::ScaleRate(1.0 / 1.1),
        b"\x1b[C" => Control::PlayNext(Done::nobody()),
        b"\x1b[D" => Control::SeekBy(-SECOND_NS),
        b"\x1b[5~" => Control::SeekBy(10 * SECOND_NS),
        b"\x1b[6~" => Control::SeekBy(-10 * SECOND_NS),
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_are_known() {
        assert!(matches!(control(b" "), Some(Control::TogglePaused(_))));
        assert!(matches!(control(b"\x1b[C"), Some(Control::PlayNext(_))));
        assert!(matches!(control(b"\x1b[D"), Some(Control::SeekBy(ns)) if ns == -SECOND_NS));
        assert!(matches!(control(b"\x1b[A"), Some(Control::ScaleRate(factor)) if factor > 1.0));
        assert!(control(b"x").is_none() && control(b"").is_none() && control(b"\x1b[").is_none());
    }
}
