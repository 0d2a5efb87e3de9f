// The panel of settings: field and range of the colours, what is shown, views.

import { balanced, shown, styled, suited, table, texture } from "view/colours.js";
import { styleOf } from "view/layers.js";

const find = (id) => document.getElementById(id);
/** Fields that colours show at first. */
const USUAL = ["von_mises", "bending_moment", "energy", "tension", "displacement"];

/** The field, its range and colours, and the legend that explains them. */
export class Colours {
  constructor(layers, changed) {
    this.changed = changed;
    this.#setLayers(layers);
    find("field").addEventListener("change", () => this.choose(find("field").value || null));
    find("elements").addEventListener("change", changed);
    find("range").addEventListener("click", () => this.#setRange(this.#whole()));
    for (const id of ["low", "high"]) {
      find(id).addEventListener("change", () => this.#readRange());
    }
  }

  /** Colour these layers, by the same field as before if they have it. */
  replace(layers) {
    const field = this.field;
    this.#setLayers(layers);
    this.choose(this.units.has(field) || field === null ? field : this.usual);
  }

  #setLayers(layers) {
    this.layers = layers;
    this.ranges = new Map();
    this.#fillFields();
  }

  get smooth() {
    return !find("elements").checked;
  }

  /** Show a field; null for none. */
  choose(field) {
    this.field = this.units.has(field) ? field : null;
    find("field").value = this.field ?? "";
    find("legend").hidden = this.field === null;
    if (this.field) this.#setRange(this.#whole());
    this.changed();
  }

  #fillFields() {
    this.units = new Map();
    for (const layer of this.layers) {
      for (const [name, unit] of layer.values?.list() ?? []) {
        const known = this.units.get(name);
        this.units.set(name, known === undefined || known === unit ? unit : "");
      }
    }
    find("field").replaceChildren(new Option("one colour", ""));
    for (const name of this.units.keys()) find("field").append(new Option(words(name), name));
    // rather one that all surfaces have; lines have no stresses
    const surfaces = this.layers.filter((layer) => layer.values && !layer.ends);
    const known = USUAL.filter((name) => this.units.has(name));
    const common = known.find((name) => surfaces.every((layer) => layer.values.has(name)));
    this.usual = (common === "displacement" ? known[0] : common ?? known[0]) ?? null;
  }

  /** Range of the field over the whole motion. */
  #whole() {
    if (!this.ranges.has(this.field)) {
      const found = this.layers.filter((layer) => layer.values?.has(this.field)).map((layer) => layer.values.range(this.field));
      this.ranges.set(this.field, balanced([
        Math.min(...found.map(([low]) => low)), Math.max(...found.map(([, high]) => high)),
      ]));
    }
    return this.ranges.get(this.field);
  }

  #readRange() {
    const [low, high] = ["low", "high"].map((id) => this.factor * Number(find(id).value.replace(",", ".")));
    this.#setRange(low < high ? [low, high] : this.#whole());
  }

  #setRange([low, high]) {
    const [unit, factor] = suited(this.units.get(this.field), Math.max(-low, high));
    this.factor = factor;
    find("low").value = shown(low / factor);
    find("high").value = shown(high / factor);
    find("unit").textContent = unit;
    const bytes = table(low < 0 && high > 0);
    const colours = texture(bytes);
    for (const layer of this.layers) {
      layer.uniforms.colours.value?.dispose();
      layer.uniforms.colours.value = colours;
      layer.uniforms.range.value.set(low, high);
    }
    this.#drawLegend(bytes, low / factor, high / factor, unit);
    this.changed();
  }

  #drawLegend(bytes, low, high, unit) {
    find("legend-title").textContent = words(this.field) + (unit ? `, ${unit}` : "");
    const pen = find("legend-bar").getContext("2d");
    const image = pen.createImageData(1, 256);
    for (let k = 0; k < 256; k++) image.data.set(bytes.subarray(4 * k, 4 * k + 4), 4 * (255 - k));
    pen.putImageData(image, 0, 0);
    const items = [4, 3, 2, 1, 0].map((k) => {
      const item = document.createElement("li");
      item.textContent = shown(low + (k / 4) * (high - low), 3);
      return item;
    });
    find("legend-ticks").replaceChildren(...items);
  }
}

/** Switches of the layers, which share one where they have one label. */
export function fillLayers(layers, changed) {
  const before = new Map([...find("layers").querySelectorAll("input")].map((box) => [box.name, box.checked]));
  find("layers").replaceChildren();
  const groups = Map.groupBy(layers, (layer) => layer.style.label);
  for (const [label, members] of groups) {
    const row = document.createElement("label");
    row.className = "check";
    const box = Object.assign(document.createElement("input"), { type: "checkbox" });
    box.name = label;
    box.checked = before.get(label) ?? !members[0].style.hidden;
    for (const layer of members) layer.mesh.visible = box.checked;
    box.addEventListener("change", () => {
      for (const layer of members) layer.mesh.visible = box.checked;
      changed();
    });
    const swatch = document.createElement("span");
    swatch.className = "swatch";
    swatch.style.background = `var(${members[0].style.colour})`;
    row.append(box, swatch, label);
    find("layers").append(row);
  }
}

/** The size of the pictures of joints. */
export function sizeJoints(layers) {
  const joints = layers.filter((layer) => layer.series === "joints" && layer.uniforms.growth);
  find("joint-row").hidden = !joints.length;
  for (const layer of joints) layer.uniforms.growth.value = 2 ** Number(find("joint-size").value);
}

export function fillViews(stage) {
  for (const name of stage.views) {
    const button = document.createElement("button");
    button.textContent = name;
    button.addEventListener("click", () => stage.lookFrom(name));
    find("views").append(button);
  }
  find("perspective").addEventListener("change", () => stage.usePerspective(find("perspective").checked));
  find("grid").addEventListener("change", () => stage.showGrid(find("grid").checked));
  find("grid-size").textContent = `(${stage.gridText})`;
}

/** Light or dark: that of the system until the button is used. */
export function connectTheme(paint) {
  const root = document.documentElement;
  const dark = window.matchMedia("(prefers-color-scheme: dark)");
  const set = (on) => {
    root.classList.toggle("dark", on);
    paint();
  };
  dark.addEventListener("change", () => set(dark.matches));
  find("theme").addEventListener("click", () => set(!root.classList.contains("dark")));
  set(dark.matches);
}

/** Colours of the style sheet for the layers. */
export function paintLayers(layers) {
  for (const layer of layers) {
    layer.uniforms.plain.value.setStyle(styled(styleOf(layer.series).colour), "srgb-linear");
    layer.uniforms.missing.value.setStyle(styled("--missing"), "srgb-linear");
  }
}

const WORDS = {
  von_mises: "von Mises stress", N: "axial force N", Q2: "shear force Q2", Q3: "shear force Q3",
  T: "torque T", M2: "bending moment M2", M3: "bending moment M3", energy: "energy density",
  tension: "cable tension",
};

/** The name of a field in words. */
export const words = (name) => WORDS[name] ?? name.replaceAll("_", " ");
