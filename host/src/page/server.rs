//! What the page's server answers.

use std::collections::HashMap;
use std::convert::Infallible;
use std::sync::Arc;
use std::sync::mpsc::Sender;

use axum::Router;
use axum::extract::{Json, Query, Request, State};
use axum::http::{HeaderName, StatusCode, header};
use axum::middleware::{self, Next};
use axum::response::sse::{Event, KeepAlive, Sse};
use axum::response::{Html, IntoResponse, Response};
use axum::routing::{get, post};
use futures_util::stream::{self, Stream};
use tokio::sync::watch;

use crate::walk::Wish;

/// Nothing but what stands in the page itself.
const POLICY: &str = "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; connect-src 'self'; \
img-src data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// What the answers need.
#[derive(Clone)]
pub(super) struct Desk {
    views: watch::Receiver<String>,
    wishes: Option<Sender<Wish>>,
    token: Option<Arc<str>>,
}

impl Desk {
    /// The last of `views` is shown; what is wished goes to `wishes`, if anything can be.
    pub(super) fn new(
        views: watch::Receiver<String>,
        wishes: Option<Sender<Wish>>,
        token: Option<String>,
    ) -> Self {
        Self {
            views,
            wishes,
            token: token.map(Arc::from),
        }
    }
}

/// Answers until the program ends.
pub(super) async fn serve(listener: std::net::TcpListener, desk: Desk) -> std::io::Result<()> {
    let listener = tokio::net::TcpListener::from_std(listener)?;
    let router = Router::new()
        .route("/", get(page))
        .route("/events", get(events))
        .route("/wish", post(wish))
        .layer(middleware::from_fn_with_state(desk.clone(), admit))
        .with_state(desk);
    axum::serve(listener, router).await
}

/// With a token whoever has it; without one whoever means this machine by name, so that no page of another host reads along
/// under a name of its own that points here.
async fn admit(
    State(desk): State<Desk>,
    Query(query): Query<HashMap<String, String>>,
    request: Request,
    next: Next,
) -> Response {
    let admitted = match &desk.token {
        Some(token) => query.get("token").is_some_and(|given| **given == **token),
        None => {
            let host = request.headers().get(header::HOST);
            let host = host.and_then(|host| host.to_str().ok()).unwrap_or("");
            let name = host.rsplit_once(':').map_or(host, |(name, _)| name);
            ["localhost", "127.0.0.1", "[::1]"].contains(&name)
        }
    };
    match admitted {
        true => next.run(request).await,
        false => (
            StatusCode::FORBIDDEN,
            "the address that vre printed is needed, token and all\n",
        )
            .into_response(),
    }
}

async fn page() -> impl IntoResponse {
    let headers: [(HeaderName, &str); 3] = [
        (header::CONTENT_SECURITY_POLICY, POLICY),
        (header::CACHE_CONTROL, "no-store"),
        (header::REFERRER_POLICY, "no-referrer"),
    ];
    (headers, Html(html()))
}

/// The page in one piece.
fn html() -> String {
    include_str!("page.html")
        .replace("{{uplot_css}}", include_str!("uplot/uPlot.min.css"))
        .replace("{{css}}", include_str!("page.css"))
        .replace("{{uplot_js}}", include_str!("uplot/uPlot.iife.min.js"))
        .replace("{{js}}", include_str!("page.js"))
}

/// The view as it is, then each one that follows; of a slow page's some are left out, never the last.
async fn events(State(desk): State<Desk>) -> Sse<impl Stream<Item = Result<Event, Infallible>>> {
    let mut views = desk.views;
    views.mark_changed();
    let events = stream::unfold(views, |mut views| async move {
        views.changed().await.ok()?;
        let text = views.borrow_and_update().clone();
        let event = match text.is_empty() {
            true => Event::default().comment("nothing yet"),
            false => Event::default().data(text),
        };
        Some((Ok(event), views))
    });
    Sse::new(events).keep_alive(KeepAlive::default())
}

async fn wish(State(desk): State<Desk>, Json(wish): Json<Wish>) -> StatusCode {
    match desk.wishes {
        None => StatusCode::FORBIDDEN,
        Some(wishes) => match wishes.send(wish) {
            Ok(()) => StatusCode::NO_CONTENT,
            Err(_) => StatusCode::GONE,
        },
    }
}
