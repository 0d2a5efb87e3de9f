// What is drawn of each series: surfaces in frames, surfaces of points, lines and arrows.

import * as THREE from "three";
import { Motion, rotate, rotateBack } from "view/motion.js";
import { ARROWS, EDGES, FRAMES, LINES, PICKED, POINTS, SHADED } from "view/shaders.js";
import { NONE, Values } from "view/values.js";

/** Colours and words of the series; others are drawn like meshes. Values that jump are not smoothed. */
const STYLES = {
  contact_surfaces: { label: "obstacles", colour: "--obstacle", hidesBacks: true },
  rigid_bodies: { label: "rigid bodies", colour: "--body" },
  shells: { label: "shells", colour: "--beam" },
  floating_bodies: { label: "floating bodies", colour: "--beam" },
  floating_lines: { label: "floating bodies (lines)", colour: "--beam", width: 4 },
  energy_solids: { label: "solids", colour: "--beam" },
  energy_triangles: { label: "membranes", colour: "--beam" },
  energy_lines: { label: "bars", colour: "--beam", width: 4 },
  beam_surfaces: { label: "beams", colour: "--beam" },
  beams: { label: "beams", colour: "--beam", width: 1.5 },
  cables: { label: "cables", colour: "--cable", width: 3, jumps: true },
  joints: { label: "joints", colour: "--joint" },
  joint_rods: { label: "rods of joints", colour: "--joint", width: 2 },
  forces: { label: "forces at joints", colour: "--force", hidden: true },
  moments: { label: "moments at joints", colour: "--moment", hidden: true },
};

export const styleOf = (series) => STYLES[series] ?? { label: series, colour: "--beam" };

/** Make the layers of a description. */
export function makeLayers(scene, origin, reach) {
  const layers = [];
  for (const data of scene.layers) {
    if (data.kind === "frames") layers.push(new FrameLayer(data, origin));
    if (data.kind === "points") layers.push(new PointLayer(data, origin));
    if (data.kind === "lines" || data.lines?.length) layers.push(new LineLayer(data, origin));
    if (data.kind !== "arrows") continue;
    for (const [name, vectors] of Object.entries(data.vectors)) {
      layers.push(new ArrowLayer(data, `${name}s`, vectors, origin, reach));
    }
  }
  return layers.filter((layer) => layer.mesh.geometry.index?.count !== 0);
}

/**
 * What all layers have in common: a mesh, a plain colour, colours by a field.
 *
 * Shaders move between two instants. Each is in a slot, with what was uploaded for it; the second
 * one becomes the first when time goes on, so that one instant is uploaded at a time.
 */
class Layer {
  constructor(data, series, vertexShader, origin) {
    this.data = data;
    this.series = series;
    this.style = styleOf(series);
    this.motion = new Motion(data.motion, origin);
    this.uniforms = {
      mixing: { value: 0 }, offset: { value: new THREE.Vector3(...this.motion.offset) },
      scale: { value: this.motion.step }, colours: { value: null },
      range: { value: new THREE.Vector2(0, 1) }, plain: { value: new THREE.Color() },
      missing: { value: new THREE.Color() }, coloured: { value: false },
      byElement: { value: false }, picked: { value: -1 }, layer: { value: 0 },
    };
    const side = this.style.hidesBacks ? THREE.FrontSide : THREE.DoubleSide;
    const make = (fragmentShader, more = {}) =>
      new THREE.RawShaderMaterial({
        glslVersion: THREE.GLSL3, vertexShader, fragmentShader, uniforms: this.uniforms, side, ...more,
      });
    // edges lie in front of the faces that they belong to
    const behind = { polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1 };
    this.material = make(SHADED, behind);
    this.pickMaterial = make(PICKED);
    this.edgeMaterial = make(EDGES, { transparent: true, depthWrite: false });
    this.slots = [{ key: -1 }, { key: -1 }];
  }

  setMesh(geometry) {
    this.mesh = new THREE.Mesh(geometry, this.material);
    this.mesh.frustumCulled = false;
    this.mesh.visible = !this.style.hidden;
  }

  /** Free what the graphics processor holds. */
  dispose() {
    this.mesh.removeFromParent();
    this.mesh.geometry.dispose();
    this.edges?.geometry.dispose();
    for (const slot of this.slots) slot.table?.dispose();
    for (const material of [this.material, this.pickMaterial, this.edgeMaterial]) material.dispose();
  }

  /** Show or hide the edges of elements. */
  showEdges(on) {
    if (!this.data.fields.length || !this.edgesAt) return;
    if (on && !this.edges) {
      const geometry = new THREE.BufferGeometry();
      geometry.attributes = this.mesh.geometry.attributes; // shared, also when they change
      geometry.setIndex(new THREE.BufferAttribute(this.edgesAt(), 1));
      this.edges = new THREE.LineSegments(geometry, this.edgeMaterial);
      this.edges.frustumCulled = false;
      this.mesh.add(this.edges);
    }
    if (this.edges) this.edges.visible = on;
  }

  /** Show an instant; `smooth` is false for one colour per element. */
  update(moment, field, smooth) {
    const shown = field && this.values?.has(field) ? field : null;
    this.uniforms.mixing.value = moment.s;
    this.uniforms.coloured.value = shown !== null;
    this.uniforms.byElement.value = !smooth;
    if (this.slots[0].key !== moment.i && this.slots[1].key === moment.i) {
      this.slots.reverse();
      this.bind(...this.slots);
    }
    [moment.i, this.motion.next(moment.i)].forEach((i, k) => {
      const slot = this.slots[k];
      if (slot.key !== i) {
        this.upload(slot, i);
        Object.assign(slot, { key: i, colours: null });
      }
      const colours = shown && `${shown} ${smooth}`;
      if (colours && slot.colours !== colours) {
        this.uploadValues(slot, i, shown, smooth);
        slot.colours = colours;
      }
    });
  }

  uploadValues({ value }, i, field, smooth) {
    this.values.fill(value.array, field, i, smooth);
    value.needsUpdate = true;
  }

  /** Name of the body or joint of an element. */
  name(cell) {
    const body = this.data.bodies ? this.data.bodies[cell] : cell;
    return { name: this.data.names[body] ?? "", kind: this.data.kinds?.[body] ?? "" };
  }
}

function dynamic(array, width, normalized = false) {
  return new THREE.BufferAttribute(array, width, normalized).setUsage(THREE.DynamicDrawUsage);
}

/** Surfaces whose vertices are fixed in frames: beams, rigid bodies, joints, obstacles. */
class FrameLayer extends Layer {
  constructor(data, origin) {
    super(data, data.series, FRAMES, origin);
    this.uniforms.framesA = { value: null };
    this.uniforms.framesB = { value: null };
    this.uniforms.growth = { value: 1 };
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("local", new THREE.BufferAttribute(data.local, 3));
    geometry.setAttribute("normal", new THREE.BufferAttribute(data.normal, 3, true));
    geometry.setAttribute("frame", new THREE.BufferAttribute(data.frame, 1));
    geometry.setAttribute("cell", new THREE.BufferAttribute(data.cell, 1));
    geometry.setIndex(new THREE.BufferAttribute(data.triangles, 1));
    this.setMesh(geometry);
    for (const slot of this.slots) {
      slot.table = this.#table();
      slot.value = dynamic(new Float32Array(data.cell.length).fill(NONE), 1);
    }
    this.bind(...this.slots);
    if (data.lines) {
      const cells = Uint32Array.from(data.lines, (_, c) => c >> 1);
      this.values = new Values(data, this.motion, { cells, points: data.lines }, {
        cells: data.cell, points: data.frame,
      });
    }
  }

  bind(a, b) {
    this.uniforms.framesA.value = a.table;
    this.uniforms.framesB.value = b.table;
    this.mesh.geometry.setAttribute("valueA", a.value).setAttribute("valueB", b.value);
  }

  edgesAt() {
    const { triangles, cell } = this.data;
    return edgesBetween(triangles, triangles, (t) => cell[triangles[3 * t]]);
  }

  upload({ table }, i) {
    const { places, turns, count } = this.motion;
    const out = table.image.data;
    const at = i * count;
    for (let n = 0; n < count; n++) {
      for (let c = 0; c < 3; c++) out[8 * n + c] = places[3 * (at + n) + c];
      for (let c = 0; c < 4; c++) out[8 * n + 4 + c] = turns[4 * (at + n) + c];
    }
    table.needsUpdate = true;
  }

  /** A point that stays where it is in its body. */
  hold(cell, point, moment) {
    const vertex = this.#nearest(cell, point, moment);
    const frame = this.data.frame[vertex];
    const place = this.motion.place(frame, moment, []);
    const local = rotateBack(this.motion.turn(frame, moment, []), point.map((x, c) => x - place[c]));
    const at = (then) => {
      const moved = rotate(this.motion.turn(frame, then, []), local);
      return this.motion.place(frame, then, []).map((x, c) => x + moved[c]);
    };
    return { vertex, at };
  }

  #nearest(cell, point, moment) {
    let [best, least] = [0, Infinity];
    const { local, frame } = this.data;
    for (let v = 0; v < frame.length; v++) {
      if (this.data.cell[v] !== cell) continue;
      const place = this.motion.place(frame[v], moment, []);
      const arm = rotate(this.motion.turn(frame[v], moment, []), local.subarray(3 * v, 3 * v + 3));
      const distance = Math.hypot(...point.map((x, c) => x - place[c] - arm[c]));
      if (distance < least) [best, least] = [v, distance];
    }
    return best;
  }

  #table() {
    const width = 1024;
    const height = Math.max(1, Math.ceil((2 * this.motion.count) / width));
    const table = new THREE.DataTexture(
      new Int16Array(4 * width * height), width, height, THREE.RGBAIntegerFormat, THREE.ShortType);
    table.internalFormat = "RGBA16I";
    return table;
  }
}

/**
 * Surfaces whose points all move. Every triangle has a vertex of its own, its last one, which tells
 * the shaders the element; the others are those of other triangles, so that there are hardly more
 * vertices than triangles.
 */
class PointLayer extends Layer {
  constructor(data, origin) {
    super(data, data.series, POINTS, origin);
    this.#number();
    const count = this.corner.length;
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("cell", new THREE.BufferAttribute(this.cells, 1));
    geometry.setIndex(new THREE.BufferAttribute(this.index, 1));
    this.setMesh(geometry);
    for (const slot of this.slots) {
      // four parts, of which one is not used: processors read no groups of six bytes
      slot.place = dynamic(new Int16Array(4 * count), 4, true);
      slot.normal = dynamic(new Int8Array(4 * count), 4, true);
      slot.value = dynamic(new Float32Array(count).fill(NONE), 1);
    }
    this.bind(...this.slots);
    this.uniforms.scale.value = this.motion.half; // of numbers from -1 to 1
    this.normals = new Float32Array(3 * data.source.length);
    const cells = Uint32Array.from(data.cells, (_, c) => data.cell[Math.floor(c / 3)]);
    const points = Uint32Array.from(data.cells, (corner) => data.source[corner]);
    this.values = new Values(data, this.motion, { cells, points }, {
      cells: this.cells, points: Uint32Array.from(this.corner, (corner) => data.source[corner]),
    });
  }

  bind(...slots) {
    slots.forEach((slot, k) => {
      for (const name of ["place", "normal", "value"]) {
        this.mesh.geometry.setAttribute(name + "AB"[k], slot[name]);
      }
    });
  }

  edgesAt() {
    const points = Uint32Array.from(this.data.cells, (corner) => this.data.source[corner]);
    return edgesBetween(this.index, points, (t) => this.data.cell[t]);
  }

  /** The vertex of an element that is next to a point. */
  hold(cell, point, moment) {
    let [best, least] = [0, Infinity];
    for (let t = 0; t < this.data.cell.length; t++) {
      if (this.data.cell[t] !== cell) continue;
      for (const vertex of this.index.subarray(3 * t, 3 * t + 3)) {
        const place = this.motion.place(this.values.vertices.points[vertex], moment, []);
        const distance = Math.hypot(...point.map((x, c) => x - place[c]));
        if (distance < least) [best, least] = [vertex, distance];
      }
    }
    const node = this.values.vertices.points[best];
    return { vertex: best, at: (then) => this.motion.place(node, then, []) };
  }

  /** Corners (of normals) and elements of the vertices, and vertices of the triangles. */
  #number() {
    const { cells, cell } = this.data;
    const [corner, element] = [[], []];
    const first = new Map();
    for (let t = 0; t < cell.length; t++) {
      corner.push(cells[3 * t + 2]);
      element.push(cell[t]);
      if (!first.has(cells[3 * t + 2])) first.set(cells[3 * t + 2], t);
    }
    this.index = new Uint32Array(cells.length);
    for (let c = 0; c < cells.length; c++) {
      if (c % 3 === 2) {
        this.index[c] = (c - 2) / 3;
        continue;
      }
      if (!first.has(cells[c])) {
        first.set(cells[c], corner.length);
        corner.push(cells[c]);
        element.push(cell[Math.floor(c / 3)]);
      }
      this.index[c] = first.get(cells[c]);
    }
    this.corner = Uint32Array.from(corner);
    this.cells = Uint32Array.from(element);
  }

  upload({ place, normal }, i) {
    const { places, count } = this.motion;
    const { cells, source } = this.data;
    const start = 3 * i * count;
    const sums = this.normals.fill(0);
    for (let t = 0; t < cells.length; t += 3) {
      const a = start + 3 * source[cells[t]];
      const b = start + 3 * source[cells[t + 1]];
      const c = start + 3 * source[cells[t + 2]];
      const ux = places[b] - places[a], uy = places[b + 1] - places[a + 1], uz = places[b + 2] - places[a + 2];
      const vx = places[c] - places[a], vy = places[c + 1] - places[a + 1], vz = places[c + 2] - places[a + 2];
      const nx = uy * vz - uz * vy, ny = uz * vx - ux * vz, nz = ux * vy - uy * vx;
      for (let k = 0; k < 3; k++) {
        const at = 3 * cells[t + k];
        sums[at] += nx;
        sums[at + 1] += ny;
        sums[at + 2] += nz;
      }
    }
    for (let n = 0; n < sums.length; n += 3) {
      const square = sums[n] * sums[n] + sums[n + 1] * sums[n + 1] + sums[n + 2] * sums[n + 2];
      const scale = 1 / Math.sqrt(square || 1);
      sums[n] *= scale;
      sums[n + 1] *= scale;
      sums[n + 2] *= scale;
    }
    const [x, n] = [place.array, normal.array];
    for (let v = 0, at = 0; v < this.corner.length; v++, at++) {
      let of = 3 * this.corner[v];
      let from = start + 3 * source[this.corner[v]];
      for (let k = 0; k < 3; k++, at++, of++, from++) {
        x[at] = places[from];
        n[at] = 127 * sums[of];
      }
    }
    place.needsUpdate = normal.needsUpdate = true;
  }
}

/** Lines between points: beams without sections, beams too slender to be seen, cables, rods of joints. */
class LineLayer extends Layer {
  constructor(data, origin) {
    super(data, data.series, LINES, origin);
    const inside = data.kind === "frames"; // lines in the middle of surfaces
    this.ends = inside ? data.lines : data.cells;
    const count = this.ends.length / 2;
    const geometry = new THREE.InstancedBufferGeometry();
    const side = new Float32Array([0, -1, 0, 1, 1, -1, 1, 1]);
    geometry.setAttribute("side", new THREE.BufferAttribute(side, 2));
    geometry.setIndex([0, 2, 1, 1, 2, 3]);
    geometry.instanceCount = count;
    const add = (name, array, width) =>
      geometry.setAttribute(name, new THREE.InstancedBufferAttribute(array, width).setUsage(THREE.DynamicDrawUsage));
    for (const name of ["startPlace", "endPlace"]) add(name, new Float32Array(3 * count), 3);
    for (const name of ["startValue", "endValue"]) add(name, new Float32Array(count).fill(NONE), 1);
    const cells = Uint32Array.from({ length: count }, (_, k) => k);
    add("cell", cells, 1);
    this.uniforms.window = { value: new THREE.Vector2(1, 1) };
    this.uniforms.width = { value: inside && data.triangles.length ? 1.5 : Math.max(this.style.width ?? 2, inside ? 4 : 0) };
    this.setMesh(geometry);
    const both = Uint32Array.from(this.ends, (_, c) => c >> 1);
    const values = { ...data, stress: null };
    this.values = new Values(values, this.motion, { cells: both, points: this.ends }, {
      cells: both, points: this.ends,
    });
    this.atEnds = new Float32Array(2 * count);
  }

  update(moment, field, smooth) {
    super.update(moment, field, smooth);
    const { startPlace, endPlace } = this.mesh.geometry.attributes;
    const place = [0, 0, 0];
    for (let c = 0; c < this.ends.length; c++) {
      this.motion.place(this.ends[c], moment, place);
      (c % 2 ? endPlace : startPlace).array.set(place, 3 * (c >> 1));
    }
    startPlace.needsUpdate = endPlace.needsUpdate = true;
  }

  bind() {}

  upload() {} // places are those between two instants already

  uploadValues(slot, i, field, smooth) {
    if (slot !== this.slots[0]) return;
    const { startValue, endValue } = this.mesh.geometry.attributes;
    this.values.fill(this.atEnds, field, i, smooth && !this.style.jumps);
    for (let c = 0; c < this.atEnds.length; c++) (c % 2 ? endValue : startValue).array[c >> 1] = this.atEnds[c];
    startValue.needsUpdate = endValue.needsUpdate = true;
  }

  hold(cell, point, moment) {
    const distances = [0, 1].map((end) => {
      const place = this.motion.place(this.ends[2 * cell + end], moment, []);
      return Math.hypot(...point.map((x, c) => x - place[c]));
    });
    const vertex = 2 * cell + (distances[1] < distances[0] ? 1 : 0);
    return { vertex, at: (then) => this.motion.place(this.ends[vertex], then, []) };
  }
}

/** Arrows of forces or moments; the longest of the motion is a sixth as long as it is large. */
class ArrowLayer extends Layer {
  constructor(data, series, vectors, origin, reach) {
    super({ ...data, fields: [] }, series, ARROWS, origin);
    this.vectors = new Motion(vectors, [0, 0, 0]);
    const geometry = new THREE.InstancedBufferGeometry();
    const { local, normal, index } = arrow(20);
    geometry.setAttribute("local", new THREE.BufferAttribute(local, 3));
    geometry.setAttribute("normal", new THREE.BufferAttribute(normal, 3));
    geometry.setIndex(index);
    const count = this.motion.count;
    geometry.instanceCount = count;
    for (const name of ["place", "vector"]) {
      const array = new Float32Array(3 * count);
      geometry.setAttribute(name, new THREE.InstancedBufferAttribute(array, 3).setUsage(THREE.DynamicDrawUsage));
    }
    this.longest = this.#longest();
    this.factor = this.longest > 0 ? reach / 6 / this.longest : 0;
    this.uniforms.thickness = { value: reach / 300 };
    this.setMesh(geometry);
  }

  update(moment, field, smooth) {
    super.update(moment, field, smooth);
    const { place, vector } = this.mesh.geometry.attributes;
    const one = [0, 0, 0];
    for (let k = 0; k < this.motion.count; k++) {
      place.array.set(this.motion.place(k, moment, one), 3 * k);
      this.vectors.place(k, moment, one).forEach((value, c) => (vector.array[3 * k + c] = value * this.factor));
    }
    place.needsUpdate = vector.needsUpdate = true;
  }

  bind() {}

  upload() {}

  #longest() {
    let longest = 0;
    const vector = [0, 0, 0];
    for (let i = 0; i < this.vectors.instants; i++) {
      for (let k = 0; k < this.vectors.count; k++) {
        longest = Math.max(longest, Math.hypot(...this.vectors.place(k, { i, s: 0 }, vector)));
      }
    }
    return longest;
  }
}

/** Edges (pairs of vertices) of triangles that do not lie inside one element. */
function edgesBetween(vertices, points, cellOf) {
  const found = new Map();
  for (let t = 0; t < vertices.length / 3; t++) {
    for (let k = 0; k < 3; k++) {
      const [a, b] = [3 * t + k, 3 * t + ((k + 1) % 3)];
      const [low, high] = points[a] < points[b] ? [points[a], points[b]] : [points[b], points[a]];
      const key = low * 2 ** 26 + high;
      const other = found.get(key);
      const inside = other && other.cell === cellOf(t);
      found.set(key, { cell: cellOf(t), ends: inside ? null : [vertices[a], vertices[b]] });
    }
  }
  const ends = [...found.values()].map((edge) => edge.ends).filter(Boolean);
  return Uint32Array.from(ends.flat());
}

/** A shaft from z = 0 to 1 and a head from 1 to 2; the shader gives them their lengths. */
function arrow(sides) {
  const [local, normal, index] = [[], [], []];
  const ring = (radius, z, rise, outward) => {
    const first = local.length / 3;
    for (let k = 0; k <= sides; k++) {
      const [x, y] = [Math.cos((2 * Math.PI * k) / sides), Math.sin((2 * Math.PI * k) / sides)];
      local.push(radius * x, radius * y, z);
      normal.push(outward * x, outward * y, rise);
    }
    return first;
  };
  const strip = (a, b) => {
    for (let k = 0; k < sides; k++) index.push(a + k, a + k + 1, b + k + 1, a + k, b + k + 1, b + k);
  };
  strip(ring(1, 0, 0, 1), ring(1, 1, 0, 1));
  strip(ring(0, 1, -1, 0), ring(2.6, 1, -1, 0));
  strip(ring(2.6, 1, 0.3, 1), ring(0.001, 2, 0.3, 1));
  return { local: new Float32Array(local), normal: new Float32Array(normal), index };
}
