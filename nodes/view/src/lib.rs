//! See it live: a server that hears a running graph as any viewer does and shows it on a page.
//!
//! It is an ordinary participant outside the loop, so that a run comes out the same with and without it: it hears the
//! public topics, most of them only while somebody looks, and calls the same services as any client. What it hears is
//! kept as it came ([`heard`](self)), read thirty times a second, and put on a board from which every viewer takes the
//! newest when it has time; nothing queues for a viewer, and no viewer is waited for.
//!
//! Over HTTP it serves the page, whose files are in the executable, and the WebSocket `/ws` on which everything else
//! goes: messages in JSON, each with a `type`, and pictures with a header in JSON. A server that can be reached from
//! other machines asks for a token. Without a place to listen at there is no server, and who looks does so from within
//! this process ([`Watch`]).

mod assets;
mod board;
mod clockwork;
mod connections;
mod control_table;
mod controls;
mod description;
mod events;
mod frame;
mod guard;
mod heard;
mod mismatch;
mod motion;
mod numbers;
mod pictures;
mod pump;
mod server;
mod socket;
mod status;
mod story;
mod viewers;
mod watcher;

use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, channel};
use std::thread::JoinHandle;

use feeder_runtime::dds::{DdsError, Domain, NodeName, Participant};
use feeder_scenario::plan::RunPlan;
use tokio::sync::watch;

use crate::board::Board;
use crate::clockwork::Clockwork;
use crate::controls::Clients;
use crate::description::Description;
use crate::events::Events;
use crate::guard::{Guard, TurnedAway};
use crate::heard::{Ears, Heard};
use crate::viewers::{Interest, Viewers};

pub use crate::description::{DescriptionError, Source};
pub use crate::watcher::{Sight, Watch};

/// Where the page is unless told otherwise.
pub const DEFAULT_PORT: u16 = 8080;

/// Where a server listens.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// On this machine alone, at [`DEFAULT_PORT`], or a free port where that is taken.
    Default,
    /// There and nowhere else.
    At(SocketAddr),
}

impl std::str::FromStr for Place {
    type Err = String;

    /// Reads `ADDRESS:PORT`, an address alone or a port alone.
    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let alone = |ip: IpAddr| SocketAddr::new(ip, DEFAULT_PORT);
        let port = |port: u16| SocketAddr::from((Ipv4Addr::LOCALHOST, port));
        text.parse()
            .or_else(|_| text.parse().map(alone))
            .or_else(|_| text.parse().map(port))
            .map(Self::At)
            .map_err(|_| format!("{text:?} is no address:port, no IP address and no port, 0 to 65535"))
    }
}

/// What is shown, and to whom.
#[derive(Clone, Debug)]
pub struct Settings {
    /// Where the server listens, if there is to be one. Beyond loopback a token is asked for.
    pub place: Option<Place>,
    /// Refuse every control.
    pub read_only: bool,
    /// Where what is shown comes from.
    pub source: Source,
    /// What the scenario is called.
    pub scenario: String,
    /// The DDS domain.
    pub domain: Domain,
}

/// Why there is nothing to see.
#[derive(Debug, thiserror::Error)]
pub enum ViewError {
    /// The plan describes nothing that can be shown.
    #[error(transparent)]
    Description(#[from] DescriptionError),
    /// The address cannot be had.
    #[error("cannot listen at {address}")]
    Listen {
        /// The address.
        address: SocketAddr,
        /// Why not.
        source: std::io::Error,
    },
    /// The graph cannot be heard.
    #[error(transparent)]
    Dds(#[from] DdsError),
    /// A thread cannot be started.
    #[error("cannot start the server")]
    Start(#[source] std::io::Error),
}

/// What all parts of the server share.
struct Shared {
    cell: Description,
    heard: Heard,
    board: Board,
    events: Events,
    viewers: Viewers,
    turned_away: TurnedAway,
    clients: Clients,
    clockwork: Clockwork,
}

/// A server, or nobody but those who look from within this process. Dropped, it closes all conversations and leaves.
pub struct View {
    /// The page's, if there is one.
    url: Option<String>,
    address: Option<SocketAddr>,
    leave: watch::Sender<bool>,
    threads: Vec<JoinHandle<()>>,
    shared: Arc<Shared>,
}

impl View {
    /// Shows the run that `plan` describes.
    ///
    /// # Errors
    /// [`ViewError`] when the address is taken or the graph cannot be heard.
    pub fn start(plan: &RunPlan, settings: &Settings) -> Result<Self, ViewError> {
        let cell = Description::new(plan, &settings.scenario)?;
        let bound = settings.place.map(server::bind).transpose()?;
        let participant = Participant::secluded(&settings.domain, &NodeName::new("/", "feeder_view")?)?;
        let heard = Heard::new(&cell);
        let ears = Ears::open(&participant, &cell, &heard)?;
        let (changes, interests) = channel();
        let clients = Clients::open(&participant, &cell)?;
        participant.meet_others();
        let clockwork = Clockwork::new(&cell, settings.source, settings.read_only);
        let board = Board::new(&cell, clockwork.hello(&cell));
        let page = bound.map(|(listener, address)| {
            let token = (!address.ip().is_loopback()).then(|| format!("{:032x}", rand::random::<u128>()));
            (listener, Guard::new(address, token))
        });
        let url = page.as_ref().map(|(_, guard)| guard.url());
        let address = page.as_ref().map(|(_, guard)| guard.address());
        let viewers = Viewers::new(changes);
        let events = Events::default();
        let shared = Arc::new(Shared {
            cell,
            heard,
            board,
            events,
            viewers,
            turned_away: TurnedAway::default(),
            clients,
            clockwork,
        });
        let leave = watch::Sender::new(false);
        let run = {
            let (shared, left) = (Arc::clone(&shared), leave.subscribe());
            move || server::run(page, &shared, left)
        };
        let left = leave.subscribe();
        let threads = vec![
            std::thread::Builder::new().name("view".to_owned()).spawn(run).map_err(ViewError::Start)?,
            std::thread::Builder::new()
                .name("view topics".to_owned())
                .spawn(move || listen(ears, &interests, &left))
                .map_err(ViewError::Start)?,
        ];
        Ok(Self { url, address, leave, threads, shared })
    }

    /// The address of the page, with the token if there is one.
    #[must_use]
    pub fn url(&self) -> Option<&str> {
        self.url.as_deref()
    }

    /// Where the server listens, if there is one.
    #[must_use]
    pub fn address(&self) -> Option<SocketAddr> {
        self.address
    }

    /// How many look.
    #[must_use]
    pub fn viewers(&self) -> usize {
        self.shared.viewers.count()
    }
}

impl Drop for View {
    fn drop(&mut self) {
        self.leave.send_replace(true);
        for thread in self.threads.drain(..) {
            // A thread that panicked has said so.
            let _ = thread.join();
        }
    }
}

/// Opens and closes topics as those who look come and go.
fn listen(mut ears: Ears, interests: &Receiver<Interest>, left: &watch::Receiver<bool>) {
    const LOOK: std::time::Duration = std::time::Duration::from_millis(200);
    while !*left.borrow() {
        let Ok(interest) = interests.recv_timeout(LOOK) else { continue };
        // Those who come and go in one go are one change.
        let interest = interests.try_iter().last().unwrap_or(interest);
        if let Err(error) = ears.follow(&interest) {
            tracing::warn!("the view cannot hear all there is: {error}");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_read_as_people_write_them() {
        let at = |text: &str| Place::At(text.parse().unwrap());
        assert_eq!("0.0.0.0:9000".parse(), Ok(at("0.0.0.0:9000")));
        assert_eq!("192.168.1.5".parse(), Ok(at("192.168.1.5:8080")));
        assert_eq!("::1".parse(), Ok(at("[::1]:8080")));
        assert_eq!("9000".parse(), Ok(at("127.0.0.1:9000")));
        for wrong in ["", "65536", "localhost:80", "1.2.3.4:"] {
            assert!(wrong.parse::<Place>().unwrap_err().contains("no address"), "{wrong}");
        }
    }
}
