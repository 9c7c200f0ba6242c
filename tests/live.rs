//! Pictures that are looked at while they are rendered: in the tev viewer, and on the page of `manylight view`.

mod support;

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::process::{Child, Stdio};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use support::Folder;

/// What a viewer was sent, from the protocol's description: a length that counts itself, a kind, then the fields.
#[derive(Debug, Default)]
struct Viewed {
    name: String,
    width: u32,
    height: u32,
    channels: Vec<String>,
    /// Interleaved.
    pixels: Vec<f32>,
    updates: usize,
}

/// Fields of a packet, little-endian.
struct Fields<'a>(&'a [u8]);

impl Fields<'_> {
    fn bytes<const N: usize>(&mut self) -> [u8; N] {
        let (first, rest) = self.0.split_first_chunk().expect("a field");
        self.0 = rest;
        *first
    }

    fn u32(&mut self) -> u32 {
        u32::from_le_bytes(self.bytes())
    }

    fn u64(&mut self) -> usize {
        u64::from_le_bytes(self.bytes()) as usize
    }

    fn text(&mut self) -> String {
        let end = self.0.iter().position(|&b| b == 0).expect("an end of text");
        let text = String::from_utf8(self.0[..end].to_vec()).expect("UTF-8");
        self.0 = &self.0[end + 1..];
        text
    }

    fn channels(&mut self) -> Vec<String> {
        (0..self.u32()).map(|_| self.text()).collect()
    }
}

impl Viewed {
    /// Takes the next packet; `false` at the end.
    fn take(&mut self, socket: &mut TcpStream) -> bool {
        let mut length = [0; 4];
        if socket.read_exact(&mut length).is_err() {
            return false;
        }
        let mut packet = vec![0; u32::from_le_bytes(length) as usize - 4];
        socket.read_exact(&mut packet).expect("a whole packet");
        let mut fields = Fields(&packet);
        match fields.bytes() {
            [4] => self.create(&mut fields),
            [6] => self.update(&mut fields),
            other => panic!("a packet of kind {other:?}"),
        }
        assert!(fields.0.is_empty(), "{} bytes are left", fields.0.len());
        true
    }

    fn create(&mut self, fields: &mut Fields<'_>) {
        let [_grab_focus] = fields.bytes();
        self.name = fields.text();
        (self.width, self.height) = (fields.u32(), fields.u32());
        self.channels = fields.channels();
        self.pixels = vec![0.0; (3 * self.width * self.height) as usize];
    }

    fn update(&mut self, fields: &mut Fields<'_>) {
        let [_grab_focus] = fields.bytes();
        assert_eq!(fields.text(), self.name, "another picture");
        assert_eq!(fields.channels(), self.channels, "other channels");
        let [x, y, width, height] = [(); 4].map(|()| fields.u32());
        assert!(x + width <= self.width && y + height <= self.height, "size");
        let offsets: Vec<_> = (0..3).map(|_| fields.u64()).collect();
        let strides: Vec<_> = (0..3).map(|_| fields.u64()).collect();
        let count = fields.0.len() / 4;
        let data: Vec<_> = (0..count)
            .map(|_| f32::from_le_bytes(fields.bytes()))
            .collect();
        for i in 0..(width * height) as usize {
            let (column, row) = (
                x as usize + i % width as usize,
                y as usize + i / width as usize,
            );
            for c in 0..3 {
                let at = 3 * (row * self.width as usize + column) + c;
                self.pixels[at] = data[offsets[c] + i * strides[c]];
            }
        }
        self.updates += 1;
    }
}

/// A viewer that takes so many packets and closes; its address and what it was sent.
fn viewer(packets: usize) -> (String, JoinHandle<Viewed>) {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = listener.local_addr().expect("an address").to_string();
    let viewer = std::thread::spawn(move || {
        let (mut socket, _) = listener.accept().expect("a client");
        let mut viewed = Viewed::default();
        for _ in 0..packets {
            if !viewed.take(&mut socket) {
                break;
            }
        }
        viewed
    });
    (address, viewer)
}

#[test]
fn tev_is_shown_the_picture_after_every_pass() {
    let folder = Folder::with_room();
    let (address, viewer) = viewer(usize::MAX);
    folder
        .run(&format!("render room.ron --spp 4 --tev {address}"))
        .fine();
    let viewed = viewer.join().expect("sound packets");
    assert_eq!((viewed.width, viewed.height), (32, 18), "size");
    assert_eq!(viewed.channels, ["R", "G", "B"], "channels");
    assert_eq!(viewed.name, "room", "name");
    assert_eq!(viewed.updates, 3, "passes of 1, 1 and 2 samples");
    let picture = folder.picture("out/room.exr");
    let values = picture.radiance.iter().flat_map(|rgb| rgb.to_array());
    assert_eq!(
        viewed.pixels,
        values.collect::<Vec<_>>(),
        "the last picture shown is not the one that was written"
    );
}

#[test]
fn a_viewer_that_is_not_there_is_an_error_at_once() {
    let folder = Folder::with_room();
    // Nobody listens there any more.
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = listener.local_addr().expect("an address");
    drop(listener);
    let ran = folder.run(&format!("render room.ron --tev {address}"));
    ran.exits(2)
        .says(&["--tev", &address.to_string(), "expected HOST:PORT"]);
    assert!(!folder.exists("out/room.exr"), "nothing is rendered");
    let ran = folder.run("render room.ron --tev nonsense");
    ran.exits(2).says(&["--tev nonsense", "expected HOST:PORT"]);
}

#[test]
fn a_viewer_that_goes_costs_one_warning_and_no_bit() {
    let folder = Folder::with_room();
    folder.run("render room.ron --spp 64 --name alone").fine();
    let (address, viewer) = viewer(1);
    let line = format!("render room.ron --spp 64 --tev {address} --name seen");
    let ran = folder.run(&line).fine();
    viewer.join().expect("a sound packet");
    assert_eq!(ran.stderr.matches("warning").count(), 1, "{}", ran.stderr);
    assert!(ran.stderr.contains("is gone"), "{}", ran.stderr);
    assert!(
        folder.read("out/seen.exr") == folder.read("out/alone.exr"),
        "being looked at changed the picture"
    );
}

/// `manylight view`, ended when it is dropped.
struct Page {
    process: Child,
    /// `127.0.0.1:PORT`.
    host: String,
}

impl Drop for Page {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

struct Reply {
    code: u16,
    head: String,
    body: Vec<u8>,
}

impl Reply {
    fn json(&self) -> Value {
        serde_json::from_slice(&self.body).expect("JSON")
    }
}

/// A picture as the page gets it.
struct Picture {
    told: Value,
    pixels: Vec<f32>,
}

impl Page {
    fn open(folder: &Folder, flags: &str) -> Self {
        let mut command = folder.command(&format!("view room.ron --port 0 --quiet {flags}"));
        let mut process = command.stdout(Stdio::piped()).spawn().expect("starts");
        let stdout = process.stdout.take().expect("a pipe");
        let mut url = String::new();
        BufReader::new(stdout).read_line(&mut url).expect("a line");
        let host = url
            .trim()
            .strip_prefix("http://")
            .map(|u| u.trim_end_matches('/'));
        let host = host
            .unwrap_or_else(|| panic!("no address: {url:?}"))
            .to_owned();
        Self { process, host }
    }

    /// Sends `request`, whose lines may hold `HOST`, with `body`.
    fn send(&self, request: &str, body: &str) -> Reply {
        let mut socket = TcpStream::connect(&self.host).expect("it listens");
        let request = request.replace("HOST", &self.host);
        let length = body.len();
        write!(
            socket,
            "{request}\r\nConnection: close\r\nContent-Length: {length}\r\n\r\n{body}"
        )
        .expect("sends");
        let mut reply = Vec::new();
        socket.read_to_end(&mut reply).expect("an answer");
        let end = reply
            .windows(4)
            .position(|w| w == b"\r\n\r\n")
            .expect("a head");
        let head = String::from_utf8(reply[..end].to_vec()).expect("text");
        let code = head.split(' ').nth(1).and_then(|code| code.parse().ok());
        Reply {
            code: code.expect("a status"),
            head,
            body: reply[end + 4..].to_vec(),
        }
    }

    fn get(&self, path: &str) -> Reply {
        self.send(&format!("GET {path} HTTP/1.1\r\nHost: HOST"), "")
    }

    fn wish(&self, wish: &Value) -> Reply {
        let head = "POST /wish HTTP/1.1\r\nHost: HOST\r\nContent-Type: application/json";
        self.send(head, &wish.to_string())
    }

    /// The first picture that `is_wanted`.
    #[track_caller]
    fn picture(&self, is_wanted: impl Fn(&Value) -> bool) -> Picture {
        let begun = Instant::now();
        let mut last = 0;
        while begun.elapsed() < Duration::from_secs(120) {
            let reply = self.get(&format!("/picture?after={last}"));
            if reply.code == 204 {
                std::thread::sleep(Duration::from_millis(5));
                continue;
            }
            assert_eq!(reply.code, 200, "{}", reply.head);
            let end = reply.body.iter().position(|&b| b == b'\n').expect("a line");
            let told: Value = serde_json::from_slice(&reply.body[..end]).expect("JSON");
            last = told["number"].as_u64().expect("a number");
            let scale = told["scale"].as_f64().expect("a number") as f32;
            let (halves, _) = reply.body[end + 1..].as_chunks();
            let pixels: Vec<f32> = halves.iter().map(|&h| scale * half(h)).collect();
            let extent = |name: &str| told[name].as_u64().expect("a number") as usize;
            assert_eq!(
                pixels.len(),
                3 * extent("width") * extent("height"),
                "{told}"
            );
            if is_wanted(&told) {
                return Picture { told, pixels };
            }
        }
        panic!("no such picture in two minutes");
    }
}

/// A finite half float that is not negative.
fn half(bytes: [u8; 2]) -> f32 {
    let bits = u16::from_le_bytes(bytes);
    let (exponent, fraction) = (i32::from(bits >> 10), f32::from(bits & 1023));
    assert!(exponent < 31, "neither negative nor infinite: {bits:x}");
    match exponent {
        0 => fraction * 2_f32.powi(-24),
        _ => (1.0 + fraction / 1024.0) * 2_f32.powi(exponent - 15),
    }
}

#[test]
fn the_page_shows_what_render_writes_and_follows_wishes() {
    let folder = Folder::with_room();
    folder.run("render room.ron").fine();
    let page = Page::open(&folder, "--reference out/room.exr");

    let html = page.get("/");
    let text = String::from_utf8(html.body.clone()).expect("text");
    assert!(html.head.contains("text/html"), "{}", html.head);
    assert!(
        text.contains("<title>room</title>") && !text.contains("{{"),
        "the page"
    );
    for outside in ["http://", "https://", "src="] {
        assert!(!text.contains(outside), "the page asks for {outside}");
    }

    let state = page.get("/state").json();
    assert_eq!(state["width"], 32, "{state}");
    assert_eq!(state["reference"], true, "{state}");
    let methods = state["methods"].as_array().expect("a list");
    assert_eq!(methods[0], "stochastic-lightcuts (of the run)", "{state}");
    assert!(methods.len() > 5, "{state}");

    // All samples of the run: what `render` wrote, in half floats.
    let done = |told: &Value, wish: u64| told["wish"] == wish && told["spp"] == 3;
    let finished = page.picture(|told| done(told, 1));
    let written = folder.picture("out/room.exr").radiance;
    let written: Vec<f32> = written.iter().flat_map(|rgb| rgb.to_array()).collect();
    for (found, expected) in finished.pixels.iter().zip(&written) {
        assert!(
            (found - expected).abs() <= 1e-3 * expected,
            "{found}, not {expected}"
        );
    }
    assert_eq!(finished.told["relmse"], 0.0, "it is the reference");

    // Another method of the same scene: much the same picture, with an error.
    let method = methods.iter().position(|m| m == "all-lights");
    let reply = page.wish(&json!({ "method": method }));
    assert_eq!(
        (reply.code, reply.json()),
        (200, json!({ "wish": 2 })),
        "a wish"
    );
    let other = page.picture(|told| done(told, 2));
    let sum = |p: &Picture| p.pixels.iter().sum::<f32>();
    let ratio = sum(&other) / sum(&finished);
    assert!((0.8..1.25).contains(&ratio), "same room: {ratio}");
    assert!(other.told["relmse"].as_f64() > Some(0.0), "{}", other.told);

    // Another place: a first look, and no error, for the reference is of another view.
    let mut camera = state["camera"].clone();
    camera["origin"] = json!([1.2, 1.5, 1.0]);
    let reply = page.wish(&json!({ "camera": camera }));
    assert_eq!(reply.json(), json!({ "wish": 3 }), "a wish");
    let moved = page.picture(|told| done(told, 3));
    assert!(moved.told["relmse"].is_null(), "{}", moved.told);
    assert!(moved.pixels != other.pixels, "the camera moved");
    // Back again: to the bit what was there.
    page.wish(&json!({ "camera": state["camera"], "method": 0 }));
    let back = page.picture(|told| done(told, 4));
    assert!(back.pixels == finished.pixels, "the same view and method");
}

#[test]
fn a_wish_ends_the_pass_under_way() {
    let folder = Folder::with_room();
    // Passes of minutes.
    let slow = "--size 1024x576 --spp 4096 --set lights.count=300 --method all-lights";
    let page = Page::open(&folder, slow);
    page.picture(|told| told["width"] == 256);
    let wished = Instant::now();
    let camera = page.get("/state").json()["camera"].clone();
    let mut camera = camera;
    camera["fov_y_deg"] = json!(50);
    page.wish(&json!({ "camera": camera, "method": 1 }));
    page.picture(|told| told["wish"] == 2);
    let seconds = wished.elapsed().as_secs_f64();
    assert!(seconds < 20.0, "{seconds} s until the wish showed");
}

#[test]
fn strangers_and_nonsense_are_refused() {
    let folder = Folder::with_room();
    let page = Page::open(&folder, "");
    let code = |request: &str, body: &str| page.send(request, body).code;
    let json = "Content-Type: application/json";
    // Another name of this machine (DNS rebinding), no name, and a page from elsewhere.
    assert_eq!(
        code("GET / HTTP/1.1\r\nHost: evil.example", ""),
        403,
        "name"
    );
    assert_eq!(code("GET / HTTP/1.1", ""), 403, "no name");
    let port = page.host.split(':').nth(1).expect("a port");
    let local = format!("GET / HTTP/1.1\r\nHost: localhost:{port}");
    assert_eq!(code(&local, ""), 200, "another name that is fine");
    let elsewhere = "Host: HOST\r\nOrigin: http://evil.example";
    let request = format!("POST /wish HTTP/1.1\r\n{elsewhere}\r\n{json}");
    assert_eq!(code(&request, "{\"method\": 1}"), 403, "origin");
    let form = "POST /wish HTTP/1.1\r\nHost: HOST\r\nContent-Type: text/plain";
    assert_eq!(code(form, "{\"method\": 1}"), 415, "what a form can send");

    for path in [
        "/room.ron",
        "/../room.ron",
        "/scene/scene.ron",
        "//etc/passwd",
        "/state/",
    ] {
        assert_eq!(page.get(path).code, 404, "{path}");
    }
    assert_eq!(page.get("/reference").code, 404, "there is none");
    assert_eq!(page.get("/picture?after=x").code, 400, "a number");
    assert_eq!(page.get("/wish").code, 405, "a wish has to be sent");
    for wish in [
        json!({ "method": 99 }),
        json!({ "method": -1 }),
        json!({ "scene": "/etc/passwd" }),
        json!({ "camera": { "origin": [0, 0, 0], "target": [0, 0, 0], "up": [0, 1, 0], "fov_y_deg": 60 } }),
        json!({ "camera": { "origin": [0, 0, 0], "target": [0, 0, 1], "up": [0, 1, 0], "fov_y_deg": 180 } }),
        json!({ "camera": { "origin": [1e30, 0, 0], "target": [0, 0, 1], "up": [0, 1, 0], "fov_y_deg": 60 } }),
    ] {
        let reply = page.wish(&wish);
        let text = String::from_utf8_lossy(&reply.body).into_owned();
        assert_eq!(reply.code, 400, "{wish}: {text}");
    }
    let long = format!("{{\"method\": 1{}}}", " ".repeat(5000));
    let request = format!("POST /wish HTTP/1.1\r\nHost: HOST\r\n{json}");
    assert_eq!(code(&request, &long), 413, "too long");
    assert_eq!(code(&request, "{"), 400, "no JSON");
    let state = page.get("/state");
    assert!(
        state.head.contains("Content-Security-Policy"),
        "{}",
        state.head
    );
    // None of that was a wish.
    let done = page.picture(|told| told["spp"] == 3);
    assert_eq!(done.told["wish"], 1, "{}", done.told);

    let ran = folder.run(&format!("view room.ron --port {port}"));
    ran.exits(2)
        .says(&[&format!("--port {port}"), "expected a free port"]);
}
