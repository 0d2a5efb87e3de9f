// Arrays of the page: the other side of packing.py.

/** Stands for a value that is not known. */
export const MISSING = -32768;

const TYPES = {
  float32: Float32Array,
  float64: Float64Array,
  int8: Int8Array,
  int16: Int16Array,
  uint32: Uint32Array,
};

/** Bytes of the elements with data, which are removed. */
export function readData() {
  const pieces = [...document.querySelectorAll("[data-arrays]")].map((element) => {
    const text = element.textContent;
    element.remove();
    return Uint8Array.fromBase64?.(text) ?? Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  });
  if (pieces.length === 1) return pieces[0];
  const all = new Uint8Array(pieces.reduce((sum, piece) => sum + piece.length, 0));
  let at = 0;
  for (const piece of pieces) {
    all.set(piece, at);
    at += piece.length;
  }
  return all;
}

/** Replace every reference to an array in a description by the array, which has its `shape`. */
export async function unpack(description, data) {
  const open = [];
  const visit = (value) => {
    if (value === null || typeof value !== "object") return;
    for (const [key, inner] of Object.entries(value)) {
      if (inner && typeof inner === "object" && "at" in inner && "bytes" in inner) {
        open.push(read(inner, data).then((array) => (value[key] = array)));
      } else {
        visit(inner);
      }
    }
  };
  visit(description);
  await Promise.all(open);
  return description;
}

async function read(reference, data) {
  const packed = data.subarray(reference.at, reference.at + reference.bytes);
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  const raw = await new Response(stream).arrayBuffer();
  const array = reference.order
    ? undifferenced(new Uint8Array(raw), reference)
    : new TYPES[reference.type](raw);
  array.shape = reference.shape;
  return array;
}

/** Numbers of 16 bits whose differences with time come as planes of low and high bytes. */
function undifferenced(planes, { shape, order }) {
  const size = planes.length / 2;
  const row = shape[0] ? size / shape[0] : 0;
  const out = new Int16Array(size);
  for (let k = 0; k < size; k++) {
    const folded = planes[k] | (planes[size + k] << 8);
    let value = (folded >>> 1) ^ -(folded & 1);
    if (k >= row) value += order === 2 ? 2 * out[k - row] : out[k - row];
    if (order === 2 && k >= 2 * row) value -= out[k - 2 * row];
    out[k] = value;
  }
  return out;
}
