//! Connections, so many and no more, none of which stays that has nothing to say.

use std::io;
use std::net::SocketAddr;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll, ready};
use std::time::Duration;

use axum::serve::Listener;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tokio::time::{Instant, Sleep, sleep};

use crate::Shared;

/// Most connections at a time: what as many browsers as may look open to load the page.
pub(crate) const CONNECTIONS_MAX: usize = 128;
/// A connection on which nothing could be answered for so long is closed: half a request, or one that is kept for
/// later. A conversation says something every five seconds.
const SILENCE_MAX: Duration = Duration::from_secs(10);

/// Takes connections while there is room, and closes the others.
pub(crate) struct Bounded {
    listener: TcpListener,
    places: Arc<Semaphore>,
    shared: Arc<Shared>,
    silence_max: Duration,
}

impl Bounded {
    pub(crate) fn new(listener: TcpListener, shared: Arc<Shared>) -> Self {
        Self { listener, places: Arc::new(Semaphore::new(CONNECTIONS_MAX)), shared, silence_max: SILENCE_MAX }
    }
}

impl Listener for Bounded {
    type Io = Held<TcpStream>;
    type Addr = SocketAddr;

    async fn accept(&mut self) -> (Self::Io, SocketAddr) {
        loop {
            // Takes care of errors itself.
            let (stream, from) = Listener::accept(&mut self.listener).await;
            match Arc::clone(&self.places).try_acquire_owned() {
                Ok(place) => return (Held::new(stream, place, self.silence_max), from),
                Err(_) => {
                    self.shared.turned_away.count("there are as many connections as may be", "one more was closed");
                }
            }
        }
    }

    fn local_addr(&self) -> io::Result<SocketAddr> {
        self.listener.local_addr()
    }
}

/// A connection, its place among the others, and how long it may still be silent.
pub(crate) struct Held<S> {
    stream: S,
    _place: OwnedSemaphorePermit,
    silence_max: Duration,
    silence: Pin<Box<Sleep>>,
}

impl<S> Held<S> {
    fn new(stream: S, place: OwnedSemaphorePermit, silence_max: Duration) -> Self {
        Self { stream, _place: place, silence_max, silence: Box::pin(sleep(silence_max)) }
    }

    /// Waits for the end of its patience.
    fn poll_patience<T>(&mut self, context: &mut Context<'_>) -> Poll<io::Result<T>> {
        ready!(self.silence.as_mut().poll(context));
        Poll::Ready(Err(io::ErrorKind::TimedOut.into()))
    }
}

impl<S: AsyncRead + Unpin> AsyncRead for Held<S> {
    fn poll_read(self: Pin<&mut Self>, context: &mut Context<'_>, bytes: &mut ReadBuf<'_>) -> Poll<io::Result<()>> {
        let held = self.get_mut();
        // Somebody who sends byte by byte is heard no longer than somebody who sends nothing.
        if let Poll::Ready(end) = held.poll_patience(context) {
            return Poll::Ready(end);
        }
        Pin::new(&mut held.stream).poll_read(context, bytes)
    }
}

impl<S: AsyncWrite + Unpin> AsyncWrite for Held<S> {
    fn poll_write(self: Pin<&mut Self>, context: &mut Context<'_>, bytes: &[u8]) -> Poll<io::Result<usize>> {
        let held = self.get_mut();
        match Pin::new(&mut held.stream).poll_write(context, bytes) {
            Poll::Ready(written) => {
                held.silence.as_mut().reset(Instant::now() + held.silence_max);
                Poll::Ready(written)
            }
            Poll::Pending => held.poll_patience(context),
        }
    }

    fn poll_flush(self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.get_mut().stream).poll_flush(context)
    }

    fn poll_shutdown(self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.get_mut().stream).poll_shutdown(context)
    }
}

#[cfg(test)]
mod tests {
    use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _, duplex};

    use super::*;

    /// A connection of little patience, and the other end of it.
    fn held() -> (Held<tokio::io::DuplexStream>, tokio::io::DuplexStream) {
        let place = Arc::new(Semaphore::new(1)).try_acquire_owned().unwrap();
        let (here, there) = duplex(64);
        (Held::new(here, place, Duration::from_millis(50)), there)
    }

    #[tokio::test]
    async fn whoever_is_not_answered_loses_the_connection() {
        let (mut silent, _there) = held();
        assert_eq!(silent.read_u8().await.unwrap_err().kind(), io::ErrorKind::TimedOut);
        let (mut dripping, mut there) = held();
        let drip = tokio::spawn(async move {
            while there.write_u8(b'G').await.is_ok() {
                tokio::task::yield_now().await;
            }
        });
        let error = loop {
            if let Err(error) = dripping.read_u8().await {
                break error;
            }
        };
        assert_eq!(error.kind(), io::ErrorKind::TimedOut);
        drop(dripping);
        drip.await.unwrap();
    }

    #[tokio::test]
    async fn whoever_does_not_take_the_answer_loses_the_connection() {
        let (mut held, _there) = held();
        assert_eq!(held.write_all(&[0; 65]).await.unwrap_err().kind(), io::ErrorKind::TimedOut);
    }

    #[tokio::test]
    async fn whoever_is_answered_keeps_it() {
        let (mut held, mut there) = held();
        held.silence_max = Duration::from_secs(3600);
        let before = held.silence.deadline();
        held.write_u8(b'.').await.unwrap();
        assert!(held.silence.deadline() > before + Duration::from_secs(3000));
        there.write_u8(b'G').await.unwrap();
        assert_eq!(held.read_u8().await.unwrap(), b'G');
    }
}
