// Colours of values, and numbers as people write them.

import * as THREE from "three";

// From blue to red without the near-black and near-white ends that hide shading.
const POSITIVE = ["#3565a8", "#2a9d9d", "#7fbf5a", "#f0b93a", "#d1402f"];
const SIGNED = ["#2452b0", "#4f86c6", "#a3a8ad", "#d9744f", "#b81f2c"];

/** Colours of a range, as bytes (256, 4). */
export function table(signed) {
  const stops = (signed ? SIGNED : POSITIVE).map((text) => {
    const value = parseInt(text.slice(1), 16);
    return [value >> 16, (value >> 8) & 255, value & 255];
  });
  const out = new Uint8Array(4 * 256);
  for (let k = 0; k < 256; k++) {
    const place = (k / 255) * (stops.length - 1);
    const i = Math.min(Math.floor(place), stops.length - 2);
    for (let c = 0; c < 3; c++) {
      out[4 * k + c] = stops[i][c] + (place - i) * (stops[i + 1][c] - stops[i][c]);
    }
    out[4 * k + 3] = 255;
  }
  return out;
}

/** A texture of such colours. */
export function texture(bytes) {
  const made = new THREE.DataTexture(bytes, 256, 1);
  made.minFilter = made.magFilter = THREE.LinearFilter;
  made.needsUpdate = true;
  return made;
}

/** A range that is about zero if it has both signs. */
export function balanced([low, high]) {
  if (low < -1e-9 * Math.abs(high)) {
    const largest = Math.max(-low, high);
    return [-largest, largest];
  }
  return [0, high > 0 ? high : 1];
}

/** A number with some significant digits. */
export function shown(value, digits = 4) {
  if (!Number.isFinite(value)) return "–";
  if (value === 0) return "0";
  const size = Math.abs(value);
  if (size >= 1e5 || size < 1e-3) {
    return value.toExponential(digits - 1).replace(/\.?0+e/, "e").replace("e+", "e");
  }
  return String(Number(value.toPrecision(digits)));
}

const PREFIXES = [[1e9, "G"], [1e6, "M"], [1e3, "k"], [1, ""], [1e-3, "m"]];
const SCALED = new Set(["Pa", "N", "N m", "N/m", "N m/m", "J/m", "J/m²", "J/m³"]);

/** A unit that suits a size, and what values are divided by: Pa become MPa. */
export function suited(unit, size) {
  if (!SCALED.has(unit) || !(size > 0)) return [unit, 1];
  const [factor, prefix] = PREFIXES.find(([one]) => size >= one) ?? [1, ""];
  return [prefix + unit, factor];
}

/** A value with its unit. */
export function measured(value, unit) {
  const [text, factor] = suited(unit, Math.abs(value));
  return `${shown(value / factor)} ${text}`.trim();
}

/** Round numbers between two values, about `count` of them. */
export function ticks(low, high, count) {
  const raw = (high - low) / Math.max(count, 1);
  if (!(raw > 0) || !Number.isFinite(raw)) return [low];
  const power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].find((factor) => factor * power >= raw) * power;
  const out = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) out.push(k * step);
  return out;
}

/** A colour of the style sheet. */
export function styled(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
}

/** Colours of curves, for light and dark grounds. */
export const CURVES = ["#3b7dd8", "#e07b39", "#2fa37a", "#b455c4", "#d04a4a", "#9a8a2b"];
