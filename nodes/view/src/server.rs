//! The HTTP side: the page's files, and the door to the WebSocket.

use std::net::{Ipv4Addr, SocketAddr};
use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use axum::extract::ws::WebSocketUpgrade;
use axum::extract::{Path, RawQuery, State};
use axum::http::{HeaderMap, HeaderName, StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use tokio::net::TcpListener;
use tokio::sync::watch;

use crate::assets::{Asset, asset};
use crate::connections::Bounded;
use crate::guard::{Guard, Refusal};
use crate::pump::Pump;
use crate::{DEFAULT_PORT, Place, Shared, ViewError, clockwork, socket};

/// What is read of a message at most, bytes. One longer than a viewer may send is read to its end up to here, so that
/// the viewer hears why it is sent away: a connection closed over unread bytes is reset.
const READ_BYTES_MAX: usize = 256 * 1024;
/// What a viewer may leave unread before it is left alone, bytes: some frames.
const WRITE_BUFFER_BYTES_MAX: usize = 4 * 1024 * 1024;
/// How long viewers may take to hear that the server leaves.
const FAREWELL_LIMIT: Duration = Duration::from_secs(1);

/// The page may load and call nothing but this server.
const HEADERS: [(HeaderName, &str); 4] = [
    (
        header::CONTENT_SECURITY_POLICY,
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; connect-src 'self'; \
         base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    ),
    (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
    (header::REFERRER_POLICY, "no-referrer"),
    (header::CACHE_CONTROL, "no-cache"),
];

/// Listens where it is told to, or by default on this machine alone.
///
/// # Errors
/// An address that cannot be had.
pub(crate) fn bind(place: Place) -> Result<(std::net::TcpListener, SocketAddr), ViewError> {
    let at = |address: SocketAddr| {
        let listener = std::net::TcpListener::bind(address)?;
        listener.set_nonblocking(true)?;
        let address = listener.local_addr()?;
        Ok((listener, address))
    };
    let failed = |address: SocketAddr| move |source| ViewError::Listen { address, source };
    match place {
        Place::At(address) => at(address).map_err(failed(address)),
        Place::Default => {
            let (known, free) = ((Ipv4Addr::LOCALHOST, DEFAULT_PORT).into(), (Ipv4Addr::LOCALHOST, 0).into());
            at(known).or_else(|_| at(free)).map_err(failed(free))
        }
    }
}

/// What every request finds.
#[derive(Clone)]
struct Door {
    shared: Arc<Shared>,
    guard: Arc<Guard>,
    left: watch::Receiver<bool>,
}

impl Door {
    /// Turns somebody away.
    fn refuse(&self, refusal: Refusal) -> Response {
        let (status, reason) = refusal.answer();
        self.shared.turned_away.count(reason.trim_end(), "somebody was turned away");
        (status, HEADERS, reason).into_response()
    }
}

/// A socket to listen at, and who may come in there.
pub(crate) type Page = (std::net::TcpListener, Guard);

/// Shows what is heard until it is told to leave, on a page if there is one.
pub(crate) fn run(page: Option<Page>, shared: &Arc<Shared>, mut left: watch::Receiver<bool>) {
    let runtime = match tokio::runtime::Builder::new_current_thread().enable_all().build() {
        Ok(runtime) => runtime,
        Err(error) => return tracing::error!("view: cannot start: {error}"),
    };
    let served = runtime.block_on(async {
        let pump = tokio::spawn(Pump::new(Arc::clone(shared)).run());
        let clockwork = tokio::spawn(clockwork::follow(Arc::clone(shared)));
        let served = match page {
            Some(page) => serve(page, shared, left).await,
            None => {
                socket::told_to_leave(&mut left).await;
                Ok(())
            }
        };
        pump.abort();
        clockwork.abort();
        served
    });
    if let Err(error) = served {
        tracing::error!("view: {error}");
    }
}

/// Serves the page until it is told to leave.
async fn serve((listener, guard): Page, shared: &Arc<Shared>, left: watch::Receiver<bool>) -> std::io::Result<()> {
    let door = Door { shared: Arc::clone(shared), guard: Arc::new(guard), left: left.clone() };
    let router = Router::new()
        .route(
            "/",
            get(|State(door): State<Door>, headers: HeaderMap| async move { file(&door, &headers, "index.html") }),
        )
        .route("/ws", get(enter))
        .route(
            "/{name}",
            get(|State(door): State<Door>, headers: HeaderMap, Path(name): Path<String>| async move {
                file(&door, &headers, &name)
            }),
        )
        .fallback(|State(door): State<Door>, headers: HeaderMap| async move { file(&door, &headers, "") })
        .with_state(door);
    let (mut told, mut stopped) = (left.clone(), left);
    let leave = async move { socket::told_to_leave(&mut told).await };
    let listener = Bounded::new(TcpListener::from_std(listener)?, Arc::clone(shared));
    let serve = axum::serve(listener, router).with_graceful_shutdown(leave);
    let give_up = async {
        socket::told_to_leave(&mut stopped).await;
        tokio::time::sleep(FAREWELL_LIMIT).await;
    };
    let served = tokio::select! {
        served = serve.into_future() => served,
        // Whoever has sent half a request is not waited for.
        () = give_up => Ok(()),
    };
    let farewells = async {
        while shared.viewers.count() > 0 {
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
    };
    // One that does not listen any more is left alone.
    let _ = tokio::time::timeout(FAREWELL_LIMIT, farewells).await;
    served
}

fn file(door: &Door, headers: &HeaderMap, name: &str) -> Response {
    if let Err(refusal) = door.guard.check_origin(headers) {
        return door.refuse(refusal);
    }
    match asset(name) {
        Some(Asset { content_type, body, .. }) => {
            ([(header::CONTENT_TYPE, *content_type)], HEADERS, *body).into_response()
        }
        None => (StatusCode::NOT_FOUND, HEADERS, "there is no such file\n").into_response(),
    }
}

async fn enter(
    State(door): State<Door>,
    headers: HeaderMap,
    RawQuery(query): RawQuery,
    upgrade: WebSocketUpgrade,
) -> Response {
    let Door { shared, guard, left } = &door;
    let query = query.unwrap_or_default();
    let token = query.split('&').find_map(|pair| pair.strip_prefix("token="));
    if let Err(refusal) = guard.check_origin(&headers).and_then(|()| guard.check_token(token)) {
        return door.refuse(refusal);
    }
    let Some(viewer) = shared.viewers.enter() else { return door.refuse(Refusal::TooManyViewers) };
    let (shared, left) = (Arc::clone(shared), left.clone());
    upgrade
        .max_message_size(READ_BYTES_MAX)
        .max_frame_size(READ_BYTES_MAX)
        .max_write_buffer_size(WRITE_BUFFER_BYTES_MAX)
        .on_upgrade(move |socket| socket::converse(socket, shared, viewer, left))
}
