// The comparer: what is chosen, drawn, and done with pointer and keys.

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
