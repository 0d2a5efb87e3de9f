// Values of fields at vertices, elements and points.

import { MISSING } from "view/arrays.js";

/** What vertices get that have no value; shaders know it. */
export const NONE = 1e30;

const RESULTANTS = ["N", "Q2", "Q3", "T", "M2", "M3"];
const STRESSES = ["von_mises", "axial_stress", "shear_stress"];

/** The fields of one layer, over all instants. */
export class Values {
  /**
   * @param data description of the layer.
   * @param motion of its points or frames.
   * @param corners pairs of elements and their points: `cells` (c) and `points` (c).
   * @param vertices of the surface: `cells` (v), `points` (v).
   */
  constructor(data, motion, corners, vertices) {
    this.data = data;
    this.motion = motion;
    this.vertices = vertices;
    this.fields = new Map(data.fields.map((field) => [field.name, field]));
    this.stress = data.stress && RESULTANTS.every((name) => this.fields.has(name));
    this.#join(corners);
  }

  /** Names and units of all fields. */
  list() {
    const own = [...this.fields.values()].map(({ name, unit }) => [name, unit]);
    const stresses = this.stress ? STRESSES.map((name) => [name, "Pa"]) : [];
    return [...own, ...stresses, ["displacement", "m"]];
  }

  has(name) {
    return this.list().some(([known]) => known === name);
  }

  /** Write the values of a field at all vertices at an instant; `smooth` between elements. */
  fill(out, name, i, smooth) {
    const { cells, points } = this.vertices;
    if (name === "displacement") {
      for (let v = 0; v < out.length; v++) out[v] = this.motion.displacement(points[v], i);
      return;
    }
    if (this.#isStress(name)) {
      this.#fillStress(out, name, i, smooth);
      return;
    }
    const field = this.fields.get(name);
    const means = field.of === "cell" && smooth;
    const from = means ? this.#means(field, i) : row(field, i);
    const at = means ? this.groups : field.of === "cell" ? cells : points;
    for (let v = 0; v < out.length; v++) out[v] = from[at[v]];
  }

  /** Value at a vertex: that of its element, not a mean. */
  at(name, i, vertex, cell = this.vertices.cells[vertex]) {
    if (name === "displacement") return this.motion.displacement(this.vertices.points[vertex], i);
    if (this.#isStress(name)) {
      const resultants = RESULTANTS.map((known) => one(this.fields.get(known), i, cell));
      return this.#stressOf(name, vertex, resultants);
    }
    const field = this.fields.get(name);
    return one(field, i, field.of === "cell" ? cell : this.vertices.points[vertex]);
  }

  /** Least and greatest value over the whole motion. */
  range(name) {
    const field = this.#isStress(name) ? null : this.fields.get(name);
    if (field) return [field.low, field.high];
    const out = new Float32Array(this.vertices.cells.length);
    let [low, high] = [Infinity, -Infinity];
    const stride = Math.max(1, Math.ceil((this.motion.instants * out.length) / 2e7));
    for (let i = 0; i < this.motion.instants; i += stride) {
      this.fill(out, name, i, false);
      for (const value of out) {
        if (value >= NONE) continue;
        if (value < low) low = value;
        if (value > high) high = value;
      }
    }
    return low <= high ? [low, high] : [0, 0];
  }

  #isStress(name) {
    return this.stress && STRESSES.includes(name) && !this.fields.has(name);
  }

  /** Groups of corners that share a mean: those of one body at one point. */
  #join({ cells, points }) {
    const bodies = this.data.bodies;
    const numbers = new Map();
    const group = (cell, point) => {
      const key = point * (this.data.names.length + 1) + (bodies ? bodies[cell] : 0);
      if (!numbers.has(key)) numbers.set(key, numbers.size);
      return numbers.get(key);
    };
    this.corners = { cells, groups: Uint32Array.from(cells, (cell, c) => group(cell, points[c])) };
    const at = this.vertices;
    this.groups = Uint32Array.from(at.cells, (cell, v) => group(cell, at.points[v]));
    this.sums = new Float32Array(numbers.size);
    this.counts = new Float32Array(numbers.size);
  }

  #means(field, i) {
    const { cells, groups } = this.corners;
    const { sums, counts } = this;
    const values = row(field, i);
    sums.fill(0);
    counts.fill(0);
    for (let c = 0; c < cells.length; c++) {
      const value = values[cells[c]];
      if (value >= NONE) continue;
      sums[groups[c]] += value;
      counts[groups[c]] += 1;
    }
    for (let g = 0; g < sums.length; g++) sums[g] = counts[g] ? sums[g] / counts[g] : NONE;
    return sums;
  }

  #fillStress(out, name, i, smooth) {
    const { cells } = this.vertices;
    const at = smooth ? this.groups : cells;
    const every = RESULTANTS.map((known) => {
      const field = this.fields.get(known);
      return smooth ? this.#means(field, i).slice() : row(field, i);
    });
    const resultants = new Float32Array(6);
    for (let v = 0; v < out.length; v++) {
      for (let k = 0; k < 6; k++) resultants[k] = every[k][at[v]];
      out[v] = this.#stressOf(name, v, resultants);
    }
  }

  #stressOf(name, vertex, resultants) {
    const { factors, row } = this.data.stress;
    const start = 12 * row[vertex];
    let [axial, shear] = [0, 0];
    for (let k = 0; k < 6; k++) {
      axial += factors[start + k] * resultants[k];
      shear += factors[start + 6 + k] * resultants[k];
    }
    if (!(Math.abs(axial) < NONE)) return NONE;
    if (name === "axial_stress") return axial;
    return name === "shear_stress" ? shear : Math.sqrt(axial * axial + 3 * shear * shear);
  }
}

/** Values at an instant. */
function row({ values, low, high }, i) {
  const count = values.shape[1];
  const [start, step] = [i * count, (high - low) / 65534];
  const out = new Float32Array(count);
  for (let k = 0; k < count; k++) {
    const value = values[start + k];
    out[k] = value === MISSING ? NONE : low + (value + 32767) * step;
  }
  return out;
}

function one({ values, low, high }, i, k) {
  const value = values[i * values.shape[1] + k];
  return value === MISSING ? NONE : low + ((value + 32767) / 65534) * (high - low);
}
