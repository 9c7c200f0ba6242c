// Pictures: half floats in base64, one script each, loaded when first shown.

const pictures = new Map();
const waiting = new Map();

function bytesOf(base64) {
  const text = atob(base64);
  const bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
  return bytes;
}

// Each file of pictures/ calls this.
function addPicture(key, width, height, scale, colours, flip) {
  const data = floatsOf(bytesOf(colours), scale);
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

// The picture as an image of its own size, in the mode that is chosen.
function imageOf(picture, reference) {
  return painted(picture, reference, state.mode, place().exposure * 2 ** state.stops);
}
