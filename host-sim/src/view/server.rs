//! The page, served to browsers on this machine alone.
//!
//! Who may see and command the board is whoever may open a connection to this machine's own
//! address. So that a page of some other site cannot do it through the browser, requests must name
//! this machine as their host, which keeps out names that an attacker lets point here, and a
//! WebSocket must come from the page itself.

use std::net::{IpAddr, SocketAddr, TcpListener};
use std::sync::Arc;
use std::time::Duration;

use anyhow::{Context, Result, ensure};
use axum::Router;
use axum::extract::ws::{Message, WebSocket, WebSocketUpgrade};
use axum::extract::{Request as HttpRequest, State};
use axum::http::header::{
    CACHE_CONTROL, CONTENT_SECURITY_POLICY, CONTENT_TYPE, HOST, HeaderName, HeaderValue, ORIGIN,
    REFERRER_POLICY, X_CONTENT_TYPE_OPTIONS,
};
use axum::http::uri::Authority;
use axum::http::{HeaderMap, StatusCode};
use axum::middleware::{self, Next};
use axum::response::{IntoResponse, Response};
use axum::routing::get;

use super::hub::{Hub, Seat};
use super::request::Request;
use crate::pictures::colour_map;

/// Largest message of a client, bytes.
const REQUEST_BYTES_MAX: usize = 4096;
/// For how long a client may take nothing before it is left alone.
const SEND_WAIT: Duration = Duration::from_secs(10);

/// Nothing but the page's own files, and the connection to where they came from.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; \
                      connect-src 'self'; base-uri 'none'; form-action 'none'; \
                      frame-ancestors 'none'";

/// The files of the page: path, type and content.
const FILES: [(&str, &str, &str); 9] = [
    (
        "/",
        "text/html; charset=utf-8",
        include_str!("page/index.html"),
    ),
    (
        "/style.css",
        "text/css; charset=utf-8",
        include_str!("page/style.css"),
    ),
    ("/main.js", SCRIPT, include_str!("page/main.js")),
    ("/connection.js", SCRIPT, include_str!("page/connection.js")),
    ("/pictures.js", SCRIPT, include_str!("page/pictures.js")),
    ("/cloud.js", SCRIPT, include_str!("page/cloud.js")),
    ("/plan.js", SCRIPT, include_str!("page/plan.js")),
    ("/board.js", SCRIPT, include_str!("page/board.js")),
    ("/icon.svg", "image/svg+xml", include_str!("page/icon.svg")),
];

const SCRIPT: &str = "text/javascript; charset=utf-8";

/// Opens the address that the page is to be at; port 0 takes a free one.
///
/// # Errors
/// Fails with one line when it is not an address of this machine alone, or cannot be opened.
pub fn listen(address: SocketAddr) -> Result<TcpListener> {
    ensure!(
        address.ip().is_loopback(),
        "--listen {address}: only this machine may command the board: use 127.0.0.1 or [::1]"
    );
    TcpListener::bind(address).with_context(|| format!("--listen {address}"))
}

/// Serves the page until the process ends.
///
/// # Errors
/// Fails with one line when the operating system refuses.
pub fn serve(listener: TcpListener, hub: Arc<Hub>) -> Result<()> {
    listener.set_nonblocking(true)?;
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_io()
        .enable_time()
        .build()?;
    runtime.block_on(async {
        let listener = tokio::net::TcpListener::from_std(listener)?;
        axum::serve(listener, router(hub)).await?;
        Ok(())
    })
}

fn router(hub: Arc<Hub>) -> Router {
    let mut router = Router::new().route("/live", get(live)).route(
        "/colours",
        get(|| async { typed("application/octet-stream", colour_map()) }),
    );
    for (path, kind, content) in FILES {
        router = router.route(path, get(move || async move { typed(kind, content) }));
    }
    router.with_state(hub).layer(middleware::from_fn(guard))
}

fn typed(kind: &'static str, content: impl IntoResponse) -> Response {
    ([(CONTENT_TYPE, kind)], content).into_response()
}

/// Refuses requests to other hosts than this machine, and says what browsers may do with the
/// answer.
async fn guard(request: HttpRequest, next: Next) -> Response {
    let mut response = if is_own_host(request.headers()) {
        next.run(request).await
    } else {
        StatusCode::FORBIDDEN.into_response()
    };
    for (name, value) in [
        (CONTENT_SECURITY_POLICY, POLICY),
        (X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (REFERRER_POLICY, "no-referrer"),
        (CACHE_CONTROL, "no-store"),
        (
            HeaderName::from_static("cross-origin-resource-policy"),
            "same-origin",
        ),
    ] {
        response
            .headers_mut()
            .insert(name, HeaderValue::from_static(value));
    }
    response
}

/// The host and port of a request, if they name this machine by a name that no one else can give.
fn own_host(headers: &HeaderMap) -> Option<Authority> {
    let mut hosts = headers.get_all(HOST).iter();
    let host = hosts.next()?.to_str().ok()?;
    let authority: Authority = host.parse().ok()?;
    let name = authority.host();
    let bare = name
        .strip_prefix('[')
        .and_then(|name| name.strip_suffix(']'));
    let is_own = name.eq_ignore_ascii_case("localhost")
        || bare
            .unwrap_or(name)
            .parse::<IpAddr>()
            .is_ok_and(|ip| ip.is_loopback());
    (is_own && hosts.next().is_none() && !host.contains('@')).then_some(authority)
}

fn is_own_host(headers: &HeaderMap) -> bool {
    own_host(headers).is_some()
}

/// Whether a WebSocket comes from the page, or from no page at all: browsers always state the
/// origin.
fn is_own_origin(headers: &HeaderMap) -> bool {
    let mut origins = headers.get_all(ORIGIN).iter();
    let Some(origin) = origins.next() else {
        return true;
    };
    let own = own_host(headers).map(|host| format!("http://{host}"));
    origins.next().is_none() && own.is_some_and(|own| origin.as_bytes() == own.as_bytes())
}

async fn live(
    State(hub): State<Arc<Hub>>,
    headers: HeaderMap,
    upgrade: WebSocketUpgrade,
) -> Response {
    if !is_own_origin(&headers) {
        return StatusCode::FORBIDDEN.into_response();
    }
    upgrade
        .max_message_size(REQUEST_BYTES_MAX)
        .max_frame_size(REQUEST_BYTES_MAX)
        .on_upgrade(async move |socket| {
            if let Some(seat) = hub.join() {
                attend(socket, seat).await;
            }
        })
}

/// Sends a client what is new and takes its requests, until it goes, sends what is no request, or
/// takes nothing for too long.
async fn attend(mut socket: WebSocket, mut seat: Seat<'_>) {
    seat.frame.mark_changed();
    seat.status.mark_changed();
    loop {
        let message = tokio::select! {
            received = socket.recv() => {
                match received {
                    Some(Ok(message)) if is_taken(&seat, &message) => continue,
                    _ => return,
                }
            }
            changed = seat.status.changed() => match changed {
                Ok(()) => Message::Text(seat.status.borrow_and_update().clone()),
                Err(_) => return,
            },
            changed = seat.frame.changed() => match changed {
                Ok(()) => Message::Binary(seat.frame.borrow_and_update().clone()),
                Err(_) => return,
            },
        };
        let is_empty = match &message {
            Message::Text(text) => text.is_empty(),
            Message::Binary(bytes) => bytes.is_empty(),
            _ => false,
        };
        if is_empty {
            continue;
        }
        let sent = tokio::time::timeout(SEND_WAIT, socket.send(message)).await;
        if !sent.is_ok_and(|sent| sent.is_ok()) {
            return;
        }
    }
}

/// Does what a client asks for. Returns whether it may go on.
fn is_taken(seat: &Seat<'_>, message: &Message) -> bool {
    match message {
        Message::Text(text) => match serde_json::from_str(text) {
            Ok(Request::Show(shown)) => {
                seat.show(shown.into_iter().collect());
                true
            }
            // Whoever sends commands faster than a board takes them is left alone.
            Ok(Request::Board(command)) => seat.command(command),
            Err(_) => false,
        },
        Message::Ping(_) | Message::Pong(_) => true,
        Message::Binary(_) | Message::Close(_) => false,
    }
}
