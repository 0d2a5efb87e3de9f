// Motions of points and frames between the instants of a page.

const SCALE = 1 / 32767;

/** Places of points, and rotations of frames, at all instants. */
export class Motion {
  /** `places` (instants, n, 3) about `middle` in units of `half`, `turns` (instants, n, 4). */
  constructor({ places, turns, middle, half }, origin) {
    this.places = places;
    this.turns = turns ?? null;
    this.count = places.shape[1];
    this.instants = places.shape[0];
    this.half = half;
    this.step = half * SCALE;
    this.offset = middle.map((value, k) => value - origin[k]);
  }

  /** Write the place of a point at an instant `i` and a part `s` of the way to the next. */
  place(k, { i, s }, out) {
    const a = 3 * (i * this.count + k);
    const b = 3 * (this.next(i) * this.count + k);
    for (let c = 0; c < 3; c++) {
      const value = (1 - s) * this.places[a + c] + s * this.places[b + c];
      out[c] = this.offset[c] + this.step * value;
    }
    return out;
  }

  /** Write the quaternion of a frame. */
  turn(k, { i, s }, out) {
    const a = 4 * (i * this.count + k);
    const b = 4 * (this.next(i) * this.count + k);
    let square = 0;
    for (let c = 0; c < 4; c++) {
      out[c] = (1 - s) * this.turns[a + c] + s * this.turns[b + c];
      square += out[c] * out[c];
    }
    const scale = 1 / Math.sqrt(square || 1);
    for (let c = 0; c < 4; c++) out[c] *= scale;
    return out;
  }

  next(i) {
    return Math.min(i + 1, this.instants - 1);
  }

  /** How far a point is from where it was at the first instant. */
  displacement(k, i) {
    const a = 3 * k;
    const b = 3 * (i * this.count + k);
    const [x, y, z] = [0, 1, 2].map((c) => this.places[b + c] - this.places[a + c]);
    return this.step * Math.sqrt(x * x + y * y + z * z);
  }

  /** Least and greatest coordinates over the whole motion. */
  bounds() {
    const low = [Infinity, Infinity, Infinity];
    const high = [-Infinity, -Infinity, -Infinity];
    for (let k = 0; k < this.places.length; k += 3) {
      for (let c = 0; c < 3; c++) {
        const value = this.places[k + c];
        if (value < low[c]) low[c] = value;
        if (value > high[c]) high[c] = value;
      }
    }
    const real = (values) => values.map((value, c) => this.offset[c] + this.step * value);
    return [real(low), real(high)];
  }
}

/** Rotate a vector by a unit quaternion (x, y, z, w). */
export function rotate([x, y, z, w], [a, b, c]) {
  const u = y * c - z * b + w * a;
  const v = z * a - x * c + w * b;
  const t = x * b - y * a + w * c;
  return [a + 2 * (y * t - z * v), b + 2 * (z * u - x * t), c + 2 * (x * v - y * u)];
}

/** Rotate a vector back. */
export function rotateBack([x, y, z, w], vector) {
  return rotate([-x, -y, -z, w], vector);
}
