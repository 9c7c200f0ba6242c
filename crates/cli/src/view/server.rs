//! The page and what it asks for, on this machine only.
//!
//! | request | answer |
//! | --- | --- |
//! | `GET /` | the page |
//! | `GET /state` | what there is to choose, JSON |
//! | `GET /picture?after=N` | the newest picture if its number is above N: a line of JSON, then half floats; else 204 |
//! | `GET /reference` | the reference in the same form |
//! | `POST /wish` | `{"camera": …, "method": …}`, either of them |
//!
//! Other pages in the same browser must not use it: a request by another name than this machine's (DNS rebinding),
//! from another origin, or with a body that a form could send, is refused. No request names a file.

use std::io::{Cursor, Read};
use std::net::{Ipv4Addr, SocketAddr};
use std::str::FromStr;
use std::thread::Scope;

use experiment::{COLOURS, HalfFloats, STYLE, filled};
use film::Image;
use glam::Vec3;
use scene::load::SoundCamera;
use serde::Deserialize;
use serde_json::json;
use tiny_http::{Header, Method, Request, Response, StatusCode};

use super::desk::{Desk, Wish};
use crate::error::CliError;
use crate::job::Job;

/// Requests that are answered at the same time.
const WORKERS: usize = 4;
/// A wish has some 300 bytes.
const LONGEST_BODY: u64 = 4096;

/// What the page is about.
pub(super) struct Page<'a> {
    pub(super) job: &'a Job,
    /// What the coordinates of cameras are relative to.
    pub(super) offset: Vec3,
    pub(super) home: Wish,
    pub(super) methods: Vec<String>,
    pub(super) reference: Option<&'a Image>,
}

/// Answers on a port of this machine.
pub(super) struct Server {
    http: tiny_http::Server,
    port: u16,
}

type Answer = Response<Cursor<Vec<u8>>>;

impl Server {
    /// Takes a port of the loopback address; any free one for 0.
    ///
    /// # Errors
    /// When it is not free.
    pub(super) fn bind(port: u16) -> Result<Self, CliError> {
        let http = tiny_http::Server::http(SocketAddr::from((Ipv4Addr::LOCALHOST, port)));
        let http = http.map_err(|error| {
            CliError::Input(format!(
                "--port {port}: cannot listen there: {error}; expected a free port, or 0 for any"
            ))
        })?;
        let port = http.server_addr().to_ip().map_or(port, |at| at.port());
        Ok(Self { http, port })
    }

    /// Where the page is.
    pub(super) fn url(&self) -> String {
        format!("http://127.0.0.1:{}/", self.port)
    }

    /// Answers from now on, in threads of its own.
    pub(super) fn start<'scope, 'env>(
        &'env self,
        scope: &'scope Scope<'scope, 'env>,
        desk: &'env Desk,
        page: &'env Page<'env>,
    ) {
        for _ in 0..WORKERS {
            scope.spawn(move || {
                for mut request in self.http.incoming_requests() {
                    let answer = self.answer(&mut request, desk, page);
                    // Whoever has gone does not want it any more.
                    let _ = request.respond(guarded(answer));
                }
            });
        }
    }

    fn answer(&self, request: &mut Request, desk: &Desk, page: &Page<'_>) -> Answer {
        if let Err(answer) = self.refuse_strangers(request) {
            return answer;
        }
        let url = request.url().to_owned();
        let (path, query) = url.split_once('?').unwrap_or((&url, ""));
        let method = request.method().clone();
        match (&method, path) {
            (Method::Get, "/") => of_type("text/html; charset=utf-8", html(page)),
            (Method::Get, "/state") => of_type("application/json", state(page).to_string()),
            (Method::Get, "/picture") => picture(query, desk),
            (Method::Get, "/reference") => match page.reference {
                Some(image) => with_pixels(json!({}), image),
                None => refused(404, "there is no reference"),
            },
            (Method::Post, "/wish") => wish(request, desk, page),
            (_, "/" | "/state" | "/picture" | "/reference" | "/wish") => {
                refused(405, "expected GET, or POST for /wish")
            }
            _ => refused(404, "there is nothing of that name"),
        }
    }

    /// Refuses requests that are not made by the page or by someone on this machine.
    fn refuse_strangers(&self, request: &Request) -> Result<(), Answer> {
        let own = ["127.0.0.1", "localhost"].map(|host| format!("{host}:{}", self.port));
        let hosts = values(request, "Host");
        if hosts.len() != 1 || !own.iter().any(|host| hosts[0].eq_ignore_ascii_case(host)) {
            return Err(refused(403, "expected to be called 127.0.0.1 or localhost"));
        }
        let is_own = |origin: &&str| own.iter().any(|host| **origin == format!("http://{host}"));
        if !values(request, "Origin").iter().all(is_own) {
            return Err(refused(403, "a page from elsewhere has no business here"));
        }
        Ok(())
    }
}

/// The values of all headers of a name.
fn values<'r>(request: &'r Request, name: &'static str) -> Vec<&'r str> {
    let headers = request.headers().iter();
    headers
        .filter(|header| header.field.equiv(name))
        .map(|header| header.value.as_str())
        .collect()
}

fn html(page: &Page<'_>) -> String {
    filled(include_str!("page.html"), |name| match name {
        "style" => format!("{STYLE}{}", include_str!("page.css")),
        "scripts" => format!("{COLOURS}{}", include_str!("page.js")),
        "title" => page.job.name.replace('&', "&amp;").replace('<', "&lt;"),
        _ => unreachable!("the template has no other gap: {name}"),
    })
}

fn state(page: &Page<'_>) -> serde_json::Value {
    let camera = page.home.camera;
    json!({
        "name": page.job.name,
        "width": page.job.width,
        "height": page.job.height,
        "methods": page.methods,
        "offset": page.offset.to_array(),
        "reference": page.reference.is_some(),
        "camera": {
            "origin": camera.origin.to_array(),
            "target": camera.target.to_array(),
            "up": camera.up.to_array(),
            "fov_y_deg": camera.fov_y_deg,
        },
    })
}

fn picture(query: &str, desk: &Desk) -> Answer {
    let last = match query.strip_prefix("after=").map(u64::from_str) {
        Some(Ok(last)) => last,
        _ if query.is_empty() => 0,
        _ => return refused(400, "expected after=N"),
    };
    match desk.newer_than(last) {
        Some((number, shown)) => {
            let told = json!({
                "number": number,
                "wish": shown.wish,
                "spp": shown.spp,
                "of": shown.of,
                "seconds": shown.seconds,
                "relmse": shown.relmse,
            });
            with_pixels(told, &shown.image)
        }
        None => Response::from_data(Vec::new()).with_status_code(StatusCode(204)),
    }
}

/// A line that tells of the picture, and its pixels.
fn with_pixels(mut told: serde_json::Value, image: &Image) -> Answer {
    let HalfFloats { scale, bytes } = HalfFloats::of(image);
    told["width"] = image.width.into();
    told["height"] = image.height.into();
    told["scale"] = scale.into();
    told["exposure"] = film::auto_exposure(&image.pixels).into();
    let mut body = format!("{told}\n").into_bytes();
    body.extend(bytes);
    of_type("application/octet-stream", body)
}

/// What the page sends; what it leaves out stays as it is.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct WishFields {
    camera: Option<SoundCamera>,
    method: Option<usize>,
}

fn wish(request: &mut Request, desk: &Desk, page: &Page<'_>) -> Answer {
    // A form of another page can send text, but not this.
    if values(request, "Content-Type") != ["application/json"] {
        return refused(415, "expected Content-Type: application/json");
    }
    if request
        .body_length()
        .is_none_or(|length| length as u64 > LONGEST_BODY)
    {
        return refused(413, "expected at most 4096 bytes");
    }
    let mut body = Vec::new();
    let read = request
        .as_reader()
        .take(LONGEST_BODY)
        .read_to_end(&mut body);
    let fields = match read.map(|_| serde_json::from_slice::<WishFields>(&body)) {
        Ok(Ok(fields)) => fields,
        Ok(Err(error)) => return refused(400, &error.to_string()),
        Err(error) => return refused(400, &error.to_string()),
    };
    if let Some(method) = fields.method.filter(|m| *m >= page.methods.len()) {
        let count = page.methods.len();
        return refused(400, &format!("found method {method}; expected 0..{count}"));
    }
    let number = desk.wish(|wish| {
        wish.method = fields.method.unwrap_or(wish.method);
        wish.camera = fields.camera.map_or(wish.camera, |camera| camera.0);
    });
    of_type("application/json", json!({ "wish": number }).to_string())
}

fn of_type(kind: &str, body: impl Into<Vec<u8>>) -> Answer {
    Response::from_data(body).with_header(header("Content-Type", kind))
}

fn refused(code: u16, message: &str) -> Answer {
    of_type("text/plain; charset=utf-8", format!("{message}\n")).with_status_code(StatusCode(code))
}

/// With what tells a browser to keep the page to itself.
fn guarded(answer: Answer) -> Answer {
    let policy = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; connect-src 'self'; \
                  base-uri 'none'; form-action 'none'; frame-ancestors 'none'";
    [
        ("Cache-Control", "no-store"),
        ("Content-Security-Policy", policy),
        ("Cross-Origin-Resource-Policy", "same-origin"),
        ("X-Content-Type-Options", "nosniff"),
    ]
    .into_iter()
    // The length is known, however great it is.
    .fold(
        answer.with_chunked_threshold(usize::MAX),
        |answer, (name, value)| answer.with_header(header(name, value)),
    )
}

fn header(name: &str, value: &str) -> Header {
    Header::from_bytes(name, value).expect("headers here are plain ASCII")
}
