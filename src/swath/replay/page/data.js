// What the page carries in itself: values and typed arrays, see pack.py.

const ARRAYS = {
  uint8: Uint8Array, int8: Int8Array, uint16: Uint16Array, int16: Int16Array, uint32: Uint32Array,
  float32: Float32Array,
};

async function readData(text) {
  const deflated = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const stream = new Blob([deflated]).stream().pipeThrough(new DecompressionStream("deflate"));
  const plain = new Uint8Array(await new Response(stream).arrayBuffer());
  const length = new DataView(plain.buffer).getUint32(0, true);
  const data = JSON.parse(new TextDecoder().decode(plain.subarray(4, 4 + length)));
  for (const [name, place] of Object.entries(data.arrays)) {
    data[name] = unshuffled(plain.subarray(4 + length + place.at), place);
  }
  return data;
}

// Bytes of equal weight lie together in the file.
function unshuffled(bytes, place) {
  const kind = ARRAYS[place.type];
  const count = place.shape.reduce((a, b) => a * b, 1);
  const size = kind.BYTES_PER_ELEMENT;
  const out = new Uint8Array(count * size);
  for (let k = 0; k < size; k++) {
    const plane = bytes.subarray(k * count, (k + 1) * count);
    for (let i = 0; i < count; i++) out[i * size + k] = plane[i];
  }
  const array = new kind(out.buffer);
  array.shape = place.shape;
  return array;
}

// The index of the last of `count` times at or before t; `none` where there is no such.
function lastAt(times, t, none, count = times.length) {
  let low = none, high = count - 1;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (times[middle] <= t) low = middle; else high = middle - 1;
  }
  return low;
}

// The tracks of a machine: values of its columns at any time.
class Tracks {
  constructor(names, array) {
    this.count = array.shape[1];
    this.columns = Object.fromEntries(
      names.map((name, k) => [name, array.subarray(k * this.count, (k + 1) * this.count)]));
    this.times = this.columns.t_s;
  }

  has(name) { return name in this.columns; }

  row(t) { return lastAt(this.times, t, 0, this.count); }

  // The rows before and after a time, and how far it lies from one to the other, 0 to 1.
  place(t) {
    const i = this.row(t), j = Math.min(i + 1, this.count - 1), span = this.times[j] - this.times[i];
    return [i, j, span > 0 ? Math.min(Math.max((t - this.times[i]) / span, 0), 1) : 0];
  }

  // A value at a time, linear between rows; NaN where the column does not know.
  at(name, t) {
    const values = this.columns[name];
    if (!values) return NaN;
    const [i, j, share] = this.place(t), a = values[i], b = values[j];
    if (Number.isNaN(a) || Number.isNaN(b)) return share < 0.5 ? a : b;
    return a + (b - a) * share;
  }

  angle(name, t) {
    const values = this.columns[name], [i, j, share] = this.place(t), turn = values[j] - values[i];
    return values[i] + share * Math.atan2(Math.sin(turn), Math.cos(turn));
  }

  pose(t) {
    return poseMatrix([this.at("x_m", t), this.at("y_m", t), this.at("z_m", t)],
      this.angle("roll_rad", t), this.angle("pitch_rad", t), this.angle("yaw_rad", t));
  }
}
