// The page: puts everything together and runs.

import { readData, unpack } from "view/arrays.js";
import { measured, shown } from "view/colours.js";
import { makeLayers } from "view/layers.js";
import { Motion, rotate } from "view/motion.js";
import { Colours, connectTheme, fillLayers, fillViews, paintLayers, sizeJoints, words } from "view/panel.js";
import { Picker } from "view/picking.js";
import { Plots } from "view/plots.js";
import { Stage } from "view/stage.js";
import { Timeline } from "view/timeline.js";
import { NONE } from "view/values.js";
import { watch } from "view/live.js";

const find = (id) => document.getElementById(id);

export async function start() {
  const element = find("scene");
  const scene = await unpack(JSON.parse(element.textContent), readData());
  element.remove();
  const page = new Page(scene);
  window.flexfem = page; // for tests, and for the curious
  page.run();
  if (document.documentElement.dataset.source === "live") watch(page);
}

class Page {
  constructor(scene) {
    this.scene = scene;
    this.#showWords();
    const { origin, box, reach, cloud } = surroundings(scene.layers);
    Object.assign(this, { origin, frames: [] });
    this.timeline = new Timeline(scene.times, scene.clock);
    this.stage = new Stage(find("canvas"), box, cloud);
    this.#setLayers(reach);
    this.colours = new Colours(this.layers, () => this.changed());
    this.plots = new Plots(scene.history, this.timeline);
    fillViews(this.stage);
    this.stage.showGrid(find("grid").checked);
    connectTheme(() => this.paint());
    this.colours.choose(this.colours.usual);
    this.timeline.onChange(() => this.changed());
    this.#connect();
    this.#readAddress();
  }

  /** Show a later state of the same run: time, colours, view and plots stay. */
  replace(scene) {
    this.scene = scene;
    this.#showWords();
    const { box, reach, cloud } = surroundings(scene.layers, this.origin);
    this.layers.forEach((layer) => layer.dispose());
    this.choose(null);
    this.stage.surround(box, cloud);
    this.stage.showGrid(find("grid").checked);
    this.#setLayers(reach);
    this.colours.replace(this.layers);
    this.paint();
    this.plots.setHistory(scene.history);
    this.timeline.extend(scene.times);
  }

  /** Colours of light or dark. */
  paint() {
    paintLayers(this.layers);
    this.stage.paint();
    this.plots.draw();
  }

  #setLayers(reach) {
    this.layers = makeLayers(this.scene, this.origin, reach);
    this.layers.forEach((layer) => this.stage.scene.add(layer.mesh));
    this.layers.forEach((layer) => layer.showEdges(find("edges").checked));
    this.picker = new Picker(this.stage, this.layers);
    fillLayers(this.layers, () => this.changed());
    sizeJoints(this.layers);
  }

  /** Something that is shown has changed. */
  changed() {
    this.stale = true;
    this.stage.invalidate();
  }

  run() {
    const frame = (wall) => {
      const begin = performance.now();
      this.timeline.tick(wall);
      this.draw();
      if (this.timeline.playing) this.frames.push(performance.now() - begin);
      requestAnimationFrame(frame);
    };
    this.draw();
    requestAnimationFrame(frame);
  }

  draw() {
    if (this.stale) {
      this.stale = false;
      const moment = this.timeline.moment();
      for (const layer of this.layers) {
        if (layer.mesh.visible) layer.update(moment, this.colours.field, this.colours.smooth);
        layer.uniforms.window?.value.set(...this.stage.window);
      }
      this.#showCard();
      if (!find("plots").hidden) this.plots.draw();
    }
    if (this.stage.render()) this.#placeMark();
  }

  /** Choose the element under a place of the canvas, or nothing. */
  pick(x, y) {
    this.draw();
    this.choose(this.picker.at(x, y));
    return this.picked;
  }

  /** Choose what the picker has found, or nothing. */
  choose(found) {
    for (const layer of this.layers) layer.uniforms.picked.value = -1;
    this.picked = null;
    if (found) {
      const held = found.layer.hold(found.cell, found.point, this.timeline.moment());
      this.picked = { ...found, ...held };
      found.layer.uniforms.picked.value = found.cell;
      find("side").hidden = false;
    }
    this.changed();
  }

  /** Title, status and notes. */
  #showWords() {
    const { title, status, notes } = this.scene;
    find("title").textContent = title;
    find("status").textContent = status === "ok" ? "" : status;
    find("notes").hidden = !notes.length;
    const items = notes.map((note) => Object.assign(document.createElement("li"), { textContent: note }));
    find("notes-list").replaceChildren(...items);
  }

  /** Name, place and values of what is chosen. */
  #showCard() {
    find("chosen").hidden = !this.picked;
    if (!this.picked) return;
    const { layer, cell, vertex, at } = this.picked;
    const { name, kind } = layer.name(cell);
    const moment = this.timeline.moment();
    const rows = [[kind || layer.style.label, name]];
    if (layer.values) rows.push(["element", String(cell)]);
    at(moment).forEach((value, c) => rows.push(["xyz"[c], `${shown(value + this.origin[c])} m`]));
    const nearest = moment.s > 0.5 ? layer.motion.next(moment.i) : moment.i;
    for (const [field, unit] of this.#listed(layer)) {
      const value = layer.values.at(field, nearest, vertex, cell);
      rows.push([words(field), value >= NONE ? "not known" : measured(value, unit)]);
    }
    const parts = rows.flatMap(([term, text]) => [
      Object.assign(document.createElement("dt"), { textContent: term }),
      Object.assign(document.createElement("dd"), { textContent: text }),
    ]);
    find("card").replaceChildren(...parts);
    find("plot-chosen").hidden = !layer.values?.has(this.colours.field);
  }

  /** The field that colours show first, then the others. */
  #listed(layer) {
    const every = layer.values?.list() ?? [];
    const first = every.filter(([name]) => name === this.colours.field);
    return [...first, ...every.filter(([name]) => name !== this.colours.field)];
  }

  /** A plot of the field that colours show, where it was clicked. */
  #plotChosen() {
    const { layer, vertex, cell } = this.picked;
    const field = this.colours.field;
    const values = Float32Array.from(this.scene.times, (_, i) => {
      const value = layer.values.at(field, i, vertex, cell);
      return value >= NONE ? NaN : value;
    });
    this.#togglePlots(true);
    this.plots.add(`${words(field)}, ${layer.name(cell).name} ${cell}`, this.scene.times, values);
  }

  #placeMark() {
    find("mark").hidden = !this.picked;
    if (!this.picked) return;
    const [x, y] = this.stage.project(this.picked.at(this.timeline.moment()));
    Object.assign(find("mark").style, { left: `${x}px`, top: `${y}px` });
  }

  #togglePlots(on = find("plots").hidden) {
    find("plots").hidden = !on;
    find("toggle-plots").classList.toggle("on", on);
    this.changed();
  }

  #connect() {
    const canvas = find("canvas");
    let down = null;
    canvas.addEventListener("pointerdown", (event) => (down = [event.offsetX, event.offsetY]));
    canvas.addEventListener("pointerup", (event) => {
      const still = down && Math.hypot(event.offsetX - down[0], event.offsetY - down[1]) < 4;
      if (still && event.button === 0) this.pick(event.offsetX, event.offsetY);
    });
    find("plot-chosen").addEventListener("click", () => this.#plotChosen());
    find("forget").addEventListener("click", () => this.choose(null));
    find("joint-size").addEventListener("input", () => {
      sizeJoints(this.layers);
      this.changed();
    });
    find("edges").addEventListener("change", () => {
      this.layers.forEach((layer) => layer.showEdges(find("edges").checked));
      this.changed();
    });
    find("toggle-plots").addEventListener("click", () => this.#togglePlots());
    find("toggle-side").addEventListener("click", () => (find("side").hidden = !find("side").hidden));
    find("picture").addEventListener("click", () => this.#savePicture());
    find("link").addEventListener("click", () => this.#copyLink());
    window.addEventListener("hashchange", () => this.#readAddress());
    window.addEventListener("keydown", (event) => this.#key(event));
    this.#togglePlots(Boolean(this.scene.history) && window.innerHeight > 600);
    find("side").hidden = window.innerWidth <= 720;
  }

  #key(event) {
    if (event.target.matches("input[inputmode], select") || event.ctrlKey || event.metaKey) return;
    const actions = {
      " ": () => this.timeline.play(!this.timeline.playing),
      ArrowLeft: () => this.timeline.step(-1), ArrowRight: () => this.timeline.step(1),
      Home: () => this.timeline.go(this.timeline.start), End: () => this.timeline.go(this.timeline.end),
      p: () => this.#togglePlots(), s: () => find("toggle-side").click(), d: () => find("theme").click(),
    };
    const action = actions[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (!action) return;
    event.preventDefault();
    action();
  }

  /** `#t=1.5&field=N` chooses the time and the field. */
  #readAddress() {
    const asked = new URLSearchParams(window.location.hash.slice(1));
    const time = Number(asked.get("t"));
    if (asked.has("field")) this.colours.choose(asked.get("field"));
    if (asked.has("t") && Number.isFinite(time)) {
      this.timeline.play(false);
      this.timeline.go(time);
    }
  }

  #copyLink() {
    const chosen = new URLSearchParams({ t: shown(this.timeline.now, 8) });
    if (this.colours.field) chosen.set("field", this.colours.field);
    window.location.hash = chosen.toString();
    navigator.clipboard?.writeText(window.location.href).catch(() => {});
  }

  #savePicture() {
    this.stage.invalidate();
    this.stage.render();
    const link = document.createElement("a");
    link.download = `${this.scene.title}_${shown(this.timeline.now, 6)}.png`;
    find("canvas").toBlob((blob) => {
      link.href = URL.createObjectURL(blob);
      link.click();
      setTimeout(() => URL.revokeObjectURL(link.href), 1000);
    });
  }
}

/**
 * The middle of the motion, its bounds about it, its size, and a cloud of places all over it with
 * the sizes of what is there; of obstacles only the part that is close to others. A `known` middle
 * stays.
 */
function surroundings(layers, known) {
  const solid = layers.filter(({ kind }) => kind !== "arrows");
  const moving = solid.filter(({ series }) => series !== "contact_surfaces");
  const cloud = (moving.length ? moving : solid).flatMap(sampled);
  const box = [-1, 1].map((sign) =>
    [0, 1, 2].map((c) => sign * cloud.reduce((most, at) => Math.max(most, sign * at[c] + at[3]), -Infinity)));
  if (moving.length) enlarge(box, cloud, solid.filter(({ series }) => series === "contact_surfaces"));
  const origin = known ?? box[0].map((low, c) => 0.5 * (low + box[1][c]));
  const reach = Math.hypot(...box[1].map((high, c) => high - box[0][c])) || 1;
  const about = (at) => [...[0, 1, 2].map((c) => at[c] - origin[c]), at[3]];
  return { origin, reach, cloud: cloud.map(about), box: box.map((ends) => ends.map((value, c) => value - origin[c])) };
}

/** Some thousand places (x, y, z, size) of a layer over its motion. */
function sampled(data) {
  const motion = new Motion(data.motion, [0, 0, 0]);
  const size = data.local ? data.local.reduce((most, x) => Math.max(most, Math.abs(x)), 0) : 0;
  const instants = Math.max(1, Math.ceil(motion.instants / 60));
  const stride = Math.max(1, Math.ceil((60 * motion.count) / 6000));
  const out = [];
  for (let i = 0; i < motion.instants; i += instants) {
    for (let k = 0; k < motion.count; k += stride) out.push([...motion.place(k, { i, s: 0 }, []), size]);
  }
  return out;
}

/** Let a box and a cloud have the part of obstacles that is next to them. */
function enlarge(box, cloud, obstacles) {
  const margin = 0.08 * Math.hypot(...box[1].map((high, c) => high - box[0][c]));
  const [low, high] = [box[0].map((x) => x - margin), box[1].map((x) => x + margin)];
  for (const data of obstacles) {
    for (let v = 0; v < data.frame.length; v += 1 + Math.floor(data.frame.length / 500)) {
      const motion = new Motion(data.motion, [0, 0, 0]);
      const turned = rotate(motion.turn(data.frame[v], { i: 0, s: 0 }, []), data.local.subarray(3 * v, 3 * v + 3));
      const place = motion.place(data.frame[v], { i: 0, s: 0 }, []).map((x, c) => Math.min(Math.max(x + turned[c], low[c]), high[c]));
      cloud.push([...place, 0]);
      place.forEach((x, c) => {
        box[0][c] = Math.min(box[0][c], x);
        box[1][c] = Math.max(box[1][c], x);
      });
    }
  }
}
