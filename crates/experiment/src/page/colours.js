// Linear radiance as a browser gets and shows it: what all pages with pictures share.

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

// ---- Half floats, little-endian.

const halves = (() => {
  const table = new Float32Array(65536);
  for (let bits = 0; bits < 65536; bits++) {
    const exponent = (bits >> 10) & 31, fraction = bits & 1023, sign = bits >> 15 ? -1 : 1;
    table[bits] = sign * (exponent === 0 ? fraction * 2 ** -24
      : exponent === 31 ? (fraction ? NaN : Infinity) : (1 + fraction / 1024) * 2 ** (exponent - 15));
  }
  return table;
})();

// The numbers in `bytes`, times `scale`.
function floatsOf(bytes, scale) {
  const data = new Float32Array(bytes.length / 2);
  for (let i = 0; i < data.length; i++) data[i] = halves[bytes[2 * i] | (bytes[2 * i + 1] << 8)] * scale;
  return data;
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

// The picture as a canvas of its own size: its colours times `factor`, its relative error against the reference, or FLIP.
function painted(picture, reference, mode, factor) {
  const { width, height, data } = picture;
  const image = new ImageData(width, height), out = image.data;
  const dark2 = mode === "error" && reference ? dark2Of(reference) : 0;
  for (let i = 0; i < width * height; i++) {
    let rgb;
    if (mode === "error" && reference) {
      rgb = ramp("error", 1 + Math.log10(Math.max(relativeError(data, reference.data, dark2, i), 1e-9)) / ERROR_DECADES);
    } else if (mode === "flip") {
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
