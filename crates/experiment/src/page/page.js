const byId = (id) => document.getElementById(id);
const make = (tag, text, name) => {
  const element = document.createElement(tag);
  if (text !== undefined) element.textContent = text;
  if (name) element.className = name;
  return element;
};

// Three significant digits, as the tables of the program have them.
function digits(value) {
  const size = Math.abs(value);
  if (size === 0) return "0";
  if (size < 1e-3 || size >= 1e5) return value.toExponential(2);
  return value.toFixed(Math.max(0, 2 - Math.floor(Math.log10(size))));
}

// ---- Pictures: half floats in base64, one script each, loaded when first shown.

const pictures = new Map();
const waiting = new Map();

const halves = (() => {
  const table = new Float32Array(65536);
  for (let bits = 0; bits < 65536; bits++) {
    const exponent = (bits >> 10) & 31, fraction = bits & 1023, sign = bits >> 15 ? -1 : 1;
    table[bits] = sign * (exponent === 0 ? fraction * 2 ** -24
      : exponent === 31 ? (fraction ? NaN : Infinity) : (1 + fraction / 1024) * 2 ** (exponent - 15));
  }
  return table;
})();

function bytesOf(base64) {
  const text = atob(base64);
  const bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
  return bytes;
}

// Each file of pictures/ calls this.
function addPicture(key, width, height, scale, colours, flip) {
  const bytes = bytesOf(colours);
  const data = new Float32Array(bytes.length / 2);
  for (let i = 0; i < data.length; i++) data[i] = halves[bytes[2 * i] | (bytes[2 * i + 1] << 8)] * scale;
  pictures.set(key, { width, height, data, flip: flip ? bytesOf(flip) : null });
}

function load(key) {
  if (!waiting.has(key)) {
    waiting.set(key, new Promise((resolve) => {
      const script = document.createElement("script");
      script.src = `pictures/${key}.js`;
      script.onload = () => resolve(pictures.get(key));
      script.onerror = () => resolve(undefined);
      document.head.append(script);
    }));
  }
  return waiting.get(key);
}

// ---- From radiance to display values.

const WHITE = 16;
const encoded = (() => {
  const table = new Uint8ClampedArray(4097);
  for (let i = 0; i <= 4096; i++) {
    const linear = i / 4096;
    table[i] = 255 * (linear <= 0.0031308 ? 12.92 * linear : 1.055 * linear ** (1 / 2.4) - 0.055) + 0.5;
  }
  return table;
})();

function display(value) {
  const c = Math.min(Math.max(value, 0), WHITE);
  return encoded[(4096 * c * (1 + c / (WHITE * WHITE)) / (1 + c)) | 0];
}

// Stops of the colour maps viridis (errors) and magma (FLIP, as its authors show it).
const RAMPS = {
  error: [[68, 1, 84], [70, 50, 127], [54, 92, 141], [39, 127, 142], [31, 161, 135], [74, 194, 109], [159, 218, 58], [253, 231, 37]],
  flip: [[0, 0, 4], [40, 17, 89], [101, 26, 128], [159, 47, 127], [212, 72, 106], [245, 125, 96], [254, 191, 132], [252, 253, 191]],
};

function ramp(name, share) {
  const stops = RAMPS[name], at = Math.min(Math.max(share, 0), 1) * (stops.length - 1);
  const low = Math.min(Math.floor(at), stops.length - 2), rest = at - low;
  return stops[low].map((value, c) => value + rest * (stops[low + 1][c] - value));
}

// Relative error, 0.01 to 1 on a logarithmic scale.
const ERROR_DECADES = 2;
function relativeError(x, r, dark2, i) {
  let sum = 0;
  for (let c = 0; c < 3; c++) {
    const d = x[3 * i + c] - r[3 * i + c], scale = r[3 * i + c] ** 2 + dark2;
    sum += d === 0 ? 0 : d * d / scale;
  }
  return Math.sqrt(sum / 3);
}

function dark2Of(reference) {
  let sum = 0;
  for (const value of reference.data) sum += value;
  return 0.01 * (sum / reference.data.length) ** 2;
}

// The picture as an image of its own size, in the mode that is chosen.
function imageOf(picture, reference) {
  const { width, height, data } = picture;
  const image = new ImageData(width, height), out = image.data;
  const factor = place().exposure * 2 ** state.stops;
  const dark2 = state.mode === "error" && reference ? dark2Of(reference) : 0;
  for (let i = 0; i < width * height; i++) {
    let rgb;
    if (state.mode === "error" && reference) {
      rgb = ramp("error", 1 + Math.log10(Math.max(relativeError(data, reference.data, dark2, i), 1e-9)) / ERROR_DECADES);
    } else if (state.mode === "flip") {
      rgb = ramp("flip", picture.flip ? picture.flip[i] / 255 : 0);
    } else {
      rgb = [0, 1, 2].map((c) => display(data[3 * i + c] * factor));
    }
    out.set([rgb[0], rgb[1], rgb[2], 255], 4 * i);
  }
  const canvas = document.createElement("canvas");
  canvas.width = width;
  canvas.height = height;
  canvas.getContext("2d").putImageData(image, 0, 0);
  return canvas;
}

// ---- What is chosen.

const state = { place: 0, budget: "", frame: 0, shown: 0, other: -1, split: 0.5, mode: "picture", stops: 0, zoom: 1, x: 0.5, y: 0.5, crops: [] };
const place = () => results.places[state.place];
const views = () => place().frames[state.frame];
// The reference, and then the methods' pictures of the chosen budget.
function choices() {
  const own = views().pictures.filter((p) => p.budget === state.budget);
  return [{ label: "reference", key: views().reference }, ...own];
}

let images = new Map();
const forget = () => { images = new Map(); };

async function imageAt(index) {
  const key = choices()[index].key;
  const [picture, reference] = await Promise.all([load(key), load(views().reference)]);
  if (!picture) return undefined;
  if (!images.has(key)) images.set(key, imageOf(picture, reference));
  return images.get(key);
}

const view = byId("view");
// Where the picture lies in the canvas: pixels per pixel, and its left upper corner.
function frameOf(image) {
  const fit = Math.min(view.width / image.width, view.height / image.height);
  const size = fit * state.zoom;
  const reach = (extent, available, centre) =>
    extent * size <= available ? (available - extent * size) / 2
      : Math.min(0, Math.max(available - extent * size, available / 2 - centre * extent * size));
  return { size, left: reach(image.width, view.width, state.x), top: reach(image.height, view.height, state.y) };
}

let drawing = 0;
async function draw() {
  const turn = ++drawing;
  const list = choices();
  state.shown = Math.min(state.shown, list.length - 1);
  if (state.other >= list.length) state.other = -1;
  const split = state.other >= 0;
  const [image, other] = await Promise.all([imageAt(state.shown), split ? imageAt(state.other) : undefined]);
  if (turn !== drawing) return;
  byId("tag").textContent = describe(list[state.shown], !image);
  byId("other-tag").textContent = split ? describe(list[state.other], !other) : "";
  const context = view.getContext("2d");
  if (image) {
    const wanted = Math.round(view.clientWidth * devicePixelRatio);
    view.width = wanted;
    view.height = Math.round(wanted * image.height / image.width);
  }
  context.imageSmoothingEnabled = false;
  context.fillStyle = "#111";
  context.fillRect(0, 0, view.width, view.height);
  if (image) {
    const { size, left, top } = frameOf(image);
    context.drawImage(image, left, top, image.width * size, image.height * size);
    if (other) {
      const at = Math.round(state.split * view.width);
      context.save();
      context.beginPath();
      context.rect(at, 0, view.width - at, view.height);
      context.clip();
      context.drawImage(other, left, top, image.width * size, image.height * size);
      context.restore();
      context.fillStyle = "#fff";
      context.fillRect(at - devicePixelRatio, 0, 2 * devicePixelRatio, view.height);
    }
    if (size >= 44 * devicePixelRatio) writeValues(context, { size, left, top }, image);
    if (selection) outline(context, image);
  }
  await drawCrops();
  // For whoever waits for it, such as a test.
  view.dataset.drawn = `${list[state.shown].key} ${state.mode} ${state.stops} ${state.zoom.toFixed(2)}`;
}

function describe(choice, missing) {
  if (missing) return `${choice.label}: no picture`;
  return choice.relmse === undefined || choice.relmse === null ? choice.label : `${choice.label}: relmse ${digits(choice.relmse)}`;
}

// Numbers in the pixels, once they are large enough.
function writeValues(context, { size, left, top }, image) {
  const picture = pictures.get(choices()[state.shown].key);
  context.font = `${10 * devicePixelRatio}px system-ui, sans-serif`;
  context.textAlign = "center";
  const first = (start) => Math.max(0, Math.floor(-start / size));
  const last = (start, extent, available) => Math.min(extent, Math.ceil((available - start) / size));
  for (let y = first(top); y < last(top, image.height, view.height); y++) {
    for (let x = first(left); x < last(left, image.width, view.width); x++) {
      for (let c = 0; c < 3; c++) {
        const text = digits(picture.data[3 * (y * image.width + x) + c]);
        const px = left + (x + 0.5) * size, py = top + (y + 0.5) * size + (12 * c - 8) * devicePixelRatio;
        context.lineWidth = 2 * devicePixelRatio;
        context.strokeStyle = "#000";
        context.strokeText(text, px, py);
        context.fillStyle = ["#ff9c9c", "#9cff9c", "#a9c4ff"][c];
        context.fillText(text, px, py);
      }
    }
  }
}

// ---- Parts of the picture, enlarged, of all methods side by side.

async function drawCrops() {
  const list = choices();
  const all = await Promise.all(list.map((_, index) => (state.crops.length ? imageAt(index) : undefined)));
  const rows = state.crops.map((crop) => {
    const strip = make("div", undefined, "strip");
    all.forEach((image, index) => {
      if (!image) return;
      const figure = make("figure"), canvas = make("canvas");
      const [x, y] = [Math.round(crop[0] * image.width), Math.round(crop[1] * image.height)];
      canvas.width = Math.max(1, Math.round(crop[2] * image.width));
      canvas.height = Math.max(1, Math.round(crop[3] * image.height));
      canvas.getContext("2d").drawImage(image, -x, -y);
      canvas.title = "Click to show this picture";
      canvas.onclick = () => { state.shown = index; update(); };
      figure.append(canvas, make("figcaption", list[index].label));
      strip.append(figure);
    });
    return strip;
  });
  byId("crops").replaceChildren(...rows);
}

// ---- Pointer: move, zoom, split, select, read.

let selection = null, drag = null;
const position = (event) => {
  const box = view.getBoundingClientRect();
  return [(event.clientX - box.left) * view.width / box.width, (event.clientY - box.top) * view.height / box.height];
};

function outline(context, image) {
  const { size, left, top } = frameOf(image);
  const [x, y, w, h] = selection;
  context.strokeStyle = "#ff0";
  context.lineWidth = 2;
  context.strokeRect(left + x * image.width * size, top + y * image.height * size, w * image.width * size, h * image.height * size);
}

view.addEventListener("pointerdown", (event) => {
  const at = position(event);
  const onSplit = state.other >= 0 && Math.abs(at[0] - state.split * view.width) < 12 * devicePixelRatio;
  drag = { at, x: state.x, y: state.y, kind: event.shiftKey ? "select" : onSplit ? "split" : "move" };
  view.setPointerCapture(event.pointerId);
});

view.addEventListener("pointermove", async (event) => {
  const at = position(event);
  const picture = pictures.get(choices()[state.shown].key);
  if (!picture) return;
  const { size, left, top } = frameOf(picture);
  if (!drag) return probe(at, picture, size, left, top);
  if (drag.kind === "split") {
    state.split = Math.min(Math.max(at[0] / view.width, 0), 1);
    byId("split").value = state.split;
  } else if (drag.kind === "select") {
    const share = ([x, y]) => [
      Math.min(Math.max((x - left) / (picture.width * size), 0), 1),
      Math.min(Math.max((y - top) / (picture.height * size), 0), 1),
    ];
    const [a, b] = [share(drag.at), share(at)];
    selection = [Math.min(a[0], b[0]), Math.min(a[1], b[1]), Math.abs(a[0] - b[0]), Math.abs(a[1] - b[1])];
  } else {
    state.x = drag.x - (at[0] - drag.at[0]) / (picture.width * size);
    state.y = drag.y - (at[1] - drag.at[1]) / (picture.height * size);
    keepInside();
  }
  draw();
});

view.addEventListener("pointerup", () => {
  if (selection && selection[2] > 0.005 && selection[3] > 0.005) state.crops = [...state.crops, selection];
  selection = null;
  drag = null;
  draw();
});

function keepInside() {
  const margin = 0.5 / state.zoom;
  const within = (value) => Math.min(Math.max(value, Math.min(margin, 0.5)), Math.max(1 - margin, 0.5));
  state.x = within(state.x);
  state.y = within(state.y);
}

function probe([px, py], picture, size, left, top) {
  const x = Math.floor((px - left) / size), y = Math.floor((py - top) / size);
  if (x < 0 || y < 0 || x >= picture.width || y >= picture.height) return;
  const i = y * picture.width + x;
  const values = (p) => [0, 1, 2].map((c) => digits(p.data[3 * i + c])).join(" ");
  const reference = pictures.get(views().reference);
  let text = `x ${x}, y ${y}: ${values(picture)}`;
  if (reference && reference !== picture) {
    text += `; reference ${values(reference)}; relative error ${digits(relativeError(picture.data, reference.data, dark2Of(reference), i))}`;
    if (picture.flip) text += `; FLIP ${digits(picture.flip[i] / 255)}`;
  }
  byId("probe").textContent = text;
}

function zoomBy(factor, at) {
  const picture = pictures.get(choices()[state.shown].key);
  if (!picture) return;
  const before = frameOf(picture), [px, py] = at ?? [view.width / 2, view.height / 2];
  const [u, v] = [(px - before.left) / before.size, (py - before.top) / before.size];
  state.zoom = Math.min(Math.max(state.zoom * factor, 1), 200);
  const { size } = frameOf(picture);
  // The point under the pointer stays where it is.
  state.x = (u + (view.width / 2 - px) / size) / picture.width;
  state.y = (v + (view.height / 2 - py) / size) / picture.height;
  keepInside();
  draw();
}

view.addEventListener("wheel", (event) => {
  event.preventDefault();
  zoomBy(event.deltaY < 0 ? 1.25 : 0.8, position(event));
}, { passive: false });

// ---- Controls and keys.

function update() {
  byId("choices").replaceChildren(...choices().map((choice, index) => {
    const button = make("button", `${index} ${choice.label}`);
    button.setAttribute("aria-pressed", String(index === state.shown));
    button.onclick = () => { state.shown = index; update(); };
    return button;
  }));
  const none = make("option", "nothing");
  none.value = -1;
  byId("other").replaceChildren(none, ...choices().map((choice, index) => {
    const option = make("option", choice.label);
    option.value = index;
    return option;
  }));
  if (state.other >= choices().length) state.other = -1;
  byId("other").value = state.other;
  byId("split-label").hidden = state.other < 0;
  byId("mode").value = state.mode;
  byId("exposure").value = state.stops;
  byId("exposure-value").textContent = state.stops > 0 ? `+${state.stops}` : state.stops;
  showScale();
  showReference();
  draw();
}

function showScale() {
  const canvas = byId("scale"), coloured = state.mode !== "picture";
  canvas.hidden = !coloured;
  byId("scale-low").textContent = { picture: "", error: "1 %", flip: "0" }[state.mode];
  byId("scale-high").textContent = { picture: "", error: "100 % of the reference", flip: "1 HDR-FLIP" }[state.mode];
  if (!coloured) return;
  const context = canvas.getContext("2d");
  for (let x = 0; x < canvas.width; x++) {
    context.fillStyle = `rgb(${ramp(state.mode, x / canvas.width).join(" ")})`;
    context.fillRect(x, 0, 1, canvas.height);
  }
}

function showReference() {
  const r = results.references.find((one) => one.key === views().reference);
  if (!r) {
    byId("reference").textContent = "There is no reference.";
    return;
  }
  let text = `Reference: ${r.method}, ${r.spp} spp, seed ${r.seed}, ${digits(r.seconds)} s, relative standard error ${digits(r.standard_error)}`;
  if (r.standard_error > r.asked) text += ` (asked for ${r.asked}, a limit came first)`;
  if (r.under_test) text += "; its method is one of those compared, for no other serves";
  if (r.commit !== results.machine.commit) text += `; made by version ${r.version}, commit ${r.commit}`;
  byId("reference").textContent = `${text}.`;
}

const setStops = (value) => { state.stops = Math.min(Math.max(value, -8), 8); forget(); update(); };
const setMode = (mode) => { state.mode = mode; forget(); update(); };
const fit = () => { state.zoom = 1; state.x = state.y = 0.5; draw(); };
const toggleSplit = () => { state.other = state.other >= 0 ? -1 : state.shown === 0 ? Math.min(1, choices().length - 1) : 0; update(); };

document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey || /^(INPUT|SELECT)$/.test(event.target.tagName)) return;
  const count = choices().length;
  const show = (index) => { state.shown = (index + count) % count; update(); };
  const keys = {
    ArrowLeft: () => show(state.shown - 1), ArrowRight: () => show(state.shown + 1),
    e: () => setStops(state.stops + 0.5), E: () => setStops(state.stops - 0.5),
    m: () => setMode({ picture: "error", error: "flip", flip: "picture" }[state.mode]),
    s: toggleSplit, f: fit, "+": () => zoomBy(1.5), "=": () => zoomBy(1.5), "-": () => zoomBy(1 / 1.5),
  };
  if (/^[0-9]$/.test(event.key)) {
    if (Number(event.key) < count) show(Number(event.key));
  } else if (keys[event.key]) {
    keys[event.key]();
  } else {
    return;
  }
  event.preventDefault();
});

byId("exposure").oninput = (event) => setStops(Number(event.target.value));
byId("mode").onchange = (event) => setMode(event.target.value);
byId("other").onchange = (event) => { state.other = Number(event.target.value); update(); };
byId("split").oninput = (event) => { state.split = Number(event.target.value); draw(); };
byId("budget").onchange = (event) => { state.budget = event.target.value; forget(); update(); };
byId("frame").oninput = (event) => { state.frame = Number(event.target.value); forget(); update(); };
byId("in").onclick = () => zoomBy(1.5);
byId("out").onclick = () => zoomBy(1 / 1.5);
byId("fit").onclick = fit;
byId("place").onchange = (event) => choosePlace(Number(event.target.value));
addEventListener("resize", () => draw());

function choosePlace(index) {
  state.place = index;
  state.frame = 0;
  state.crops = [...place().crops];
  const frames = place().frames.length;
  byId("frame-label").hidden = frames < 2;
  byId("frame").max = frames - 1;
  byId("frame").value = 0;
  const budgets = [...new Set(views().pictures.map((p) => p.budget))];
  byId("budget").replaceChildren(...budgets.map((budget) => make("option", budget)));
  if (!budgets.includes(state.budget)) state.budget = budgets[budgets.length - 1] ?? "";
  byId("budget").value = state.budget;
  state.shown = Math.min(1, choices().length - 1);
  state.other = -1;
  state.zoom = 1;
  state.x = state.y = 0.5;
  forget();
  update();
}

// ---- Tables, plots and words.

const spread = (value) => {
  const cell = make("td", value ? digits(value.median) : "–");
  cell.dataset.value = value ? value.median : "";
  if (value && value.low < value.high) cell.append(make("span", ` ${digits(value.low)}…${digits(value.high)}`, "range"));
  return cell;
};
const percent = (value) => (100 * value).toFixed(2);
const estimate = (value, half, shown, unit, alarm) => {
  const known = value && half;
  const cell = make("td", known ? `${shown(value.median)} ± ${shown(half.median)}${unit}` : "–");
  cell.dataset.value = known ? value.median : "";
  if (alarm) {
    cell.classList.add("alarm");
    cell.title = "The method is unbiased and yet differs from the reference by more than chance allows: one of them is wrong.";
  }
  return cell;
};
const text = (value) => {
  const cell = make("td", value, "text");
  cell.dataset.value = value;
  return cell;
};

function table(target, heads, rows) {
  const head = make("tr");
  heads.forEach((name, column) => {
    const th = make("th", name, rows.length && rows[0][column].className.includes("text") ? "text" : undefined);
    let rising = true;
    th.onclick = () => {
      const value = (row) => row.children[column].dataset.value;
      const body = target.tBodies[0];
      const sorted = [...body.rows].sort((a, b) => {
        const [x, y] = [value(a), value(b)];
        if (x === "" || y === "") return (x === "") - (y === "");
        const order = isNaN(x) || isNaN(y) ? x.localeCompare(y) : x - y;
        return rising ? order : -order;
      });
      rising = !rising;
      body.append(...sorted);
    };
    head.append(th);
  });
  const body = make("tbody");
  rows.forEach((cells) => {
    const row = make("tr");
    row.append(...cells);
    body.append(row);
  });
  const thead = make("thead");
  thead.append(head);
  target.replaceChildren(thead, body);
}

function begin() {
  byId("title").textContent = results.title;
  byId("about").textContent = results.about;
  byId("quick").hidden = !results.quick;
  const m = results.machine;
  byId("origin").textContent = `${m.cpu}, ${m.threads} threads; version ${m.version}, commit ${m.commit}.`;
  table(byId("figures"),
    ["scene", "lights", "method", "budget", "spp", "time [s]", "CPU [s]", "Mrays", "relmse", "mape", "HDR-FLIP", "FLIP", "bias", "local bias", "relmse × CPU s"],
    results.series.map((s) => [
      text(s.scene), text(s.lights), text(s.label), text(s.budget), spread(s.spp), spread(s.seconds), spread(s.cpu_seconds),
      spread(s.mrays), spread(s.relmse), spread(s.mape), spread(s.hdr_flip), spread(s.flip),
      estimate(s.bias, s.bias_95, percent, " %", s.suspicious), estimate(s.local_bias, s.local_bias_95, digits, ""), spread(s.product),
    ]));
  byId("failed").hidden = results.failures.length === 0;
  byId("failures").replaceChildren(...results.failures.map((message) => make("li", message)));
  byId("plots").append(...results.plots.map((plot) => {
    const figure = make("figure"), image = make("img"), link = make("a", "PNG");
    image.src = `plots/${plot.name}.svg`;
    image.alt = plot.caption;
    image.loading = "lazy";
    link.href = `plots/${plot.name}.png`;
    const caption = make("figcaption", `${plot.caption} `);
    caption.append(link);
    figure.append(image, caption);
    return figure;
  }));
  byId("animation").hidden = results.animations.length === 0;
  table(byId("flicker"), ["scene", "lights", "method", "budget", "per pixel", "blocks of 8 × 8"],
    results.animations.map((a) => [text(a.scene), text(a.lights), text(a.label), text(a.budget),
      spread({ median: a.pixel }), spread({ median: a.block })]));
  byId("previews").append(...results.animations.map((a) => {
    const figure = make("figure"), image = make("img");
    image.src = `animations/${a.preview}`;
    image.alt = `${a.scene}, ${a.lights}, ${a.label}, ${a.budget}: animated`;
    figure.append(image, make("figcaption", `${a.label}, ${a.budget}`));
    return figure;
  }));
  byId("comparer").hidden = results.places.length === 0;
  if (results.places.length) {
    byId("place").replaceChildren(...results.places.map((p, index) => {
      const option = make("option", `${p.scene}, ${p.lights}`);
      option.value = index;
      return option;
    }));
    choosePlace(0);
  }
}

begin();
