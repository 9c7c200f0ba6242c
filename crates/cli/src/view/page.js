
// ---- The live picture.

const view = byId("view");
let about, camera, shown, reference;
let stops = 0, exposure = 0, method = 0;

// A line of JSON, then half floats.
async function pictureOf(response) {
  const bytes = new Uint8Array(await response.arrayBuffer());
  const end = bytes.indexOf(10);
  const told = JSON.parse(new TextDecoder().decode(bytes.subarray(0, end)));
  return { ...told, data: floatsOf(bytes.subarray(end + 1), told.scale) };
}

function draw() {
  if (!shown) return;
  const mode = byId("mode").value, measured = mode === "error" && shown.relmse !== null && sameSize(shown, reference);
  const picture = mode === "reference" && reference ? reference : shown;
  const image = painted(picture, reference, measured ? "error" : "picture", exposure * 2 ** stops);
  view.width = about.width;
  view.height = about.height;
  const context = view.getContext("2d");
  context.imageSmoothingEnabled = picture.width < about.width;
  context.drawImage(image, 0, 0, about.width, about.height);
  byId("tag").textContent = mode === "error" && !measured ? "no error: the reference is of another view" : mode === "picture" ? "" : mode;
  byId("exposure-value").textContent = stops;
  // For whoever waits for it, such as a test.
  view.dataset.drawn = `${shown.number} ${shown.wish} ${shown.spp} ${shown.width} ${mode} ${stops}`;
}

const sameSize = (a, b) => Boolean(b) && a.width === b.width && a.height === b.height;

function tell() {
  const parts = [`${shown.spp} of ${shown.of} samples a pixel`, `${shown.seconds.toFixed(1)} s`];
  if (shown.width < about.width) parts[0] = "a first look";
  if (shown.relmse !== null) parts.push(`relmse ${digits(shown.relmse)}`);
  byId("status").className = "small";
  byId("status").textContent = parts.join(", ");
}

async function follow() {
  for (;;) {
    try {
      const response = await fetch(`/picture?after=${shown ? shown.number : 0}`);
      if (response.status === 200) {
        shown = await pictureOf(response);
        exposure = exposure || shown.exposure;
        draw();
        tell();
      }
      await new Promise((resolve) => setTimeout(resolve, 60));
    } catch {
      byId("status").className = "small alarm";
      byId("status").textContent = "The program does not answer; it has ended, perhaps.";
      await new Promise((resolve) => setTimeout(resolve, 1000));
    }
  }
}

// ---- What is wished for: one request at a time, and always the newest.

let wished = false, sending = false;
async function wish() {
  wished = true;
  tellCamera();
  if (sending) return;
  sending = true;
  while (wished) {
    wished = false;
    const body = JSON.stringify({ camera, method });
    try {
      await fetch("/wish", { method: "POST", headers: { "Content-Type": "application/json" }, body });
    } catch {
      break; // follow() says so
    }
  }
  sending = false;
}

function tellCamera() {
  const place = (p, offset) => `(${p.map((x, c) => +(x + offset[c]).toPrecision(7)).join(", ")})`;
  byId("camera").textContent = `camera: (origin: ${place(camera.origin, about.offset)}, target: ${place(camera.target, about.offset)}, ` +
    `up: ${place(camera.up, [0, 0, 0])}, fov_y_deg: ${camera.fov_y_deg}),`;
}

// ---- The camera.

const add = (a, b, s = 1) => a.map((x, c) => x + s * b[c]);
const sub = (a, b) => add(a, b, -1);
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = (a) => add([0, 0, 0], a, 1 / Math.hypot(...a));

// v turned about a unit axis.
function turned(v, axis, angle) {
  const along = add([0, 0, 0], axis, dot(axis, v)), across = sub(v, along);
  return add(add(along, across, Math.cos(angle)), cross(axis, v), Math.sin(angle));
}

// v turned about the camera's up, and up or down, but never over the pole.
function swung(v, yaw, pitch) {
  const up = unit(camera.up), level = turned(v, up, yaw);
  const side = unit(cross(level, up)), tilted = turned(level, side, pitch);
  return Math.abs(dot(unit(tilted), up)) < 0.998 ? tilted : level;
}

const orbit = (yaw, pitch) => {
  camera.origin = sub(camera.target, swung(sub(camera.target, camera.origin), yaw, pitch));
};
const look = (yaw, pitch) => {
  camera.target = add(camera.origin, swung(sub(camera.target, camera.origin), yaw, pitch));
};
function pan(x, y) {
  const to = sub(camera.target, camera.origin), right = unit(cross(to, camera.up)), up = unit(cross(right, to));
  const size = 2 * Math.hypot(...to) * Math.tan(camera.fov_y_deg * Math.PI / 360);
  const step = add(add([0, 0, 0], right, -x * size), up, y * size);
  camera.origin = add(camera.origin, step);
  camera.target = add(camera.target, step);
}
const dolly = (factor) => { camera.origin = add(camera.target, sub(camera.origin, camera.target), factor); };

let drag = null;
view.addEventListener("pointerdown", (event) => {
  drag = { x: event.clientX, y: event.clientY, kind: event.shiftKey || event.button > 0 ? pan : event.altKey ? look : orbit };
  view.setPointerCapture(event.pointerId);
});
view.addEventListener("pointermove", (event) => {
  if (!drag) return;
  const size = view.clientHeight, x = (event.clientX - drag.x) / size, y = (event.clientY - drag.y) / size;
  [drag.x, drag.y] = [event.clientX, event.clientY];
  if (drag.kind === pan) pan(x, y);
  else if (drag.kind === look) look(x, y);
  else orbit(-3 * x, -3 * y);
  wish();
});
view.addEventListener("pointerup", () => { drag = null; });
view.addEventListener("pointercancel", () => { drag = null; });
view.addEventListener("contextmenu", (event) => event.preventDefault());
view.addEventListener("wheel", (event) => {
  event.preventDefault();
  dolly(Math.exp(Math.sign(event.deltaY) * Math.min(Math.abs(event.deltaY), 200) / 500));
  wish();
}, { passive: false });

// ---- Keys and controls.

function expose(by) {
  stops = Math.min(Math.max(stops + by, -8), 8);
  byId("exposure").value = stops;
  draw();
}
function goHome() {
  camera = structuredClone(about.camera);
  wish();
}
const KEYS = {
  ArrowLeft: () => orbit(0.1, 0), ArrowRight: () => orbit(-0.1, 0), ArrowUp: () => orbit(0, -0.1), ArrowDown: () => orbit(0, 0.1),
  w: () => dolly(0.9), s: () => dolly(1 / 0.9),
};
document.addEventListener("keydown", (event) => {
  if (["SELECT", "INPUT"].includes(event.target.tagName) || event.ctrlKey || event.metaKey || !about) return;
  if (event.key === "e") expose(0.5);
  else if (event.key === "E") expose(-0.5);
  else if (event.key === "h") goHome();
  else if (KEYS[event.key]) {
    event.preventDefault();
    KEYS[event.key]();
    wish();
  }
});
byId("exposure").addEventListener("input", (event) => { stops = +event.target.value; draw(); });
byId("auto").addEventListener("click", () => { exposure = shown ? shown.exposure : 0; expose(-stops); });
byId("home").addEventListener("click", goHome);
byId("mode").addEventListener("change", draw);
byId("method").addEventListener("change", (event) => { method = +event.target.value; wish(); });

async function begin() {
  about = await (await fetch("/state")).json();
  camera = structuredClone(about.camera);
  byId("name").textContent = about.name;
  about.methods.forEach((name, index) => byId("method").append(new Option(name, index)));
  byId("mode-label").hidden = !about.reference;
  if (about.reference) reference = await pictureOf(await fetch("/reference"));
  tellCamera();
  follow();
}
begin();
