// Histories of probes, with a line at the time that is shown; a click chooses the time.

import { CURVES, shown, styled, ticks } from "view/colours.js";

const [LEFT, RIGHT, TOP, BOTTOM] = [58, 8, 22, 18];

/** Panels of columns that belong together. */
export class Plots {
  constructor(history, timeline) {
    this.timeline = timeline;
    this.list = document.getElementById("plot-list");
    this.panels = new Map();
    this.setHistory(history);
    new ResizeObserver(() => this.draw()).observe(this.list);
  }

  /** Plot this table; the panels that are open stay open. */
  setHistory(history) {
    this.history = history;
    this.rows = history ? history.t.length : 0;
    this.groups = history ? grouped(history.names) : new Map();
    const open = [...this.panels.keys()].filter((name) => this.groups.has(name));
    this.panels.forEach(({ element }) => element.remove());
    this.panels.clear();
    this.#makeChoice();
    const names = [...this.groups.keys()];
    const first = names.filter((name) => !/energy/.test(name));
    const usual = (first.length ? first : names).slice(0, 2);
    for (const name of open.length ? open : usual) this.#toggle(name, true);
  }

  /** A curve that does not come from the table, such as the value at a point over time. */
  add(name, times, values) {
    this.panels.get(name)?.element.remove();
    this.panels.set(name, this.#panel(name, [{ label: name, t: times, values }]));
    this.draw();
  }

  draw() {
    for (const panel of this.panels.values()) drawPanel(panel, this.timeline);
  }

  #makeChoice() {
    const list = document.getElementById("column-list");
    list.replaceChildren();
    for (const name of this.groups.keys()) {
      const label = document.createElement("label");
      label.className = "check";
      const box = Object.assign(document.createElement("input"), { type: "checkbox" });
      box.dataset.group = name;
      box.addEventListener("change", () => this.#toggle(name, box.checked));
      const members = this.groups.get(name);
      label.append(box, members.length > 1 ? `${name} (${members.length})` : name);
      list.append(label);
    }
    document.getElementById("columns").hidden = !this.groups.size;
  }

  #toggle(name, on) {
    const box = [...document.querySelectorAll("#column-list input")].find((one) => one.dataset.group === name);
    box.checked = on;
    if (!on) {
      this.panels.get(name)?.element.remove();
      this.panels.delete(name);
      return;
    }
    const curves = this.groups.get(name).map((column) => {
      const number = this.history.names.indexOf(column);
      const values = this.history.values.subarray(number * this.rows, (number + 1) * this.rows);
      return { label: column, t: this.history.t, values };
    });
    this.panels.set(name, this.#panel(name, curves));
    this.draw();
  }

  #panel(name, curves) {
    const element = document.createElement("div");
    element.className = "plot";
    const canvas = document.createElement("canvas");
    const key = document.createElement("div");
    key.className = "key";
    const texts = curves.map(({ label }, k) => {
      const one = document.createElement("span");
      one.style.color = CURVES[k % CURVES.length];
      key.append(one);
      return { one, label };
    });
    element.append(canvas, key);
    this.list.append(element);
    const choose = (event) => {
      const { left, width } = canvas.getBoundingClientRect();
      const part = (event.clientX - left - LEFT) / (width - LEFT - RIGHT);
      this.timeline.play(false);
      this.timeline.go(this.timeline.start + part * (this.timeline.end - this.timeline.start));
    };
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      choose(event);
    });
    canvas.addEventListener("pointermove", (event) => event.buttons && choose(event));
    return { name, element, canvas, curves, texts };
  }
}

function drawPanel({ canvas, curves, texts }, { start, end, now }) {
  const { clientWidth: width, clientHeight: height } = canvas;
  if (!width) return;
  const density = window.devicePixelRatio;
  if (canvas.width !== Math.round(width * density)) {
    Object.assign(canvas, { width: Math.round(width * density), height: Math.round(height * density) });
  }
  const pen = canvas.getContext("2d");
  pen.setTransform(density, 0, 0, density, 0, 0);
  pen.clearRect(0, 0, width, height);
  const [low, high] = extremes(curves);
  const x = (t) => LEFT + ((t - start) / (end - start || 1)) * (width - LEFT - RIGHT);
  const y = (value) => height - BOTTOM - ((value - low) / (high - low)) * (height - TOP - BOTTOM);
  drawGrid(pen, { x, y, start, end, low, high, width, height });
  pen.save();
  pen.beginPath();
  pen.rect(LEFT, 0, width - LEFT - RIGHT, height - BOTTOM + 1);
  pen.clip();
  curves.forEach(({ t, values }, k) => drawCurve(pen, t, values, x, y, CURVES[k % CURVES.length]));
  pen.restore();
  pen.strokeStyle = styled("--ink");
  pen.lineWidth = 1;
  pen.beginPath();
  pen.moveTo(x(now), TOP - 6);
  pen.lineTo(x(now), height - BOTTOM);
  pen.stroke();
  texts.forEach(({ one, label }, k) => {
    one.textContent = `${label}  ${shown(valueAt(curves[k], now), 5)}`;
  });
}

function drawGrid(pen, { x, y, start, end, low, high, width, height }) {
  pen.strokeStyle = styled("--line");
  pen.fillStyle = styled("--faint");
  pen.lineWidth = 1;
  pen.font = "11px system-ui, sans-serif";
  pen.textBaseline = "middle";
  pen.textAlign = "right";
  for (const value of ticks(low, high, 4)) {
    line(pen, LEFT, y(value), width - RIGHT, y(value));
    pen.fillText(shown(value), LEFT - 6, y(value));
  }
  pen.textAlign = "center";
  for (const value of ticks(start, end, width / 110)) {
    line(pen, x(value), TOP, x(value), height - BOTTOM);
    pen.fillText(shown(value), x(value), height - BOTTOM + 10);
  }
}

function line(pen, ...[a, b, c, d]) {
  pen.beginPath();
  pen.moveTo(a, b);
  pen.lineTo(c, d);
  pen.stroke();
}

function drawCurve(pen, t, values, x, y, colour) {
  pen.strokeStyle = colour;
  pen.lineWidth = 1.5;
  pen.beginPath();
  let down = false;
  for (let k = 0; k < t.length; k++) {
    if (!Number.isFinite(values[k])) {
      down = false;
      continue;
    }
    if (down) pen.lineTo(x(t[k]), y(values[k]));
    else pen.moveTo(x(t[k]), y(values[k]));
    down = true;
  }
  pen.stroke();
}

function extremes(curves) {
  let [low, high] = [Infinity, -Infinity];
  for (const { values } of curves) {
    for (const value of values) {
      if (!Number.isFinite(value)) continue;
      if (value < low) low = value;
      if (value > high) high = value;
    }
  }
  if (!(low <= high)) return [0, 1];
  const margin = 0.06 * (high - low) || 0.05 * Math.abs(high) || 1;
  return [low - margin, high + margin];
}

function valueAt({ t, values }, now) {
  let [a, b] = [0, t.length - 1];
  while (b - a > 1) {
    const middle = (a + b) >> 1;
    if (t[middle] <= now) a = middle;
    else b = middle;
  }
  if (b === a || t[b] === t[a]) return values[a];
  const part = Math.min(Math.max((now - t[a]) / (t[b] - t[a]), 0), 1);
  return (1 - part) * values[a] + part * values[b];
}

/** Columns by what they are of: components of a vector, parts of the energy. */
function grouped(names) {
  const groups = new Map();
  for (const name of names) {
    const vector = name.match(/^(.*)_([fmpl]?)[xyz]$/);
    const numbered = name.match(/^(.*)_(|[nm]|gamma|kappa|eps)\d+$/);
    const energy = name.match(/^(.*)_(kinetic|strain|gravity|work|dissipation)$/);
    const [, start = name, kind = ""] = vector ?? numbered ?? (energy && energy.slice(0, 2)) ?? [];
    const key = kind ? `${start} ${kind}` : start;
    if (!groups.has(key)) groups.set(key, []);
    groups.get(key).push(name);
  }
  return groups;
}
