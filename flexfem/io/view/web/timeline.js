// The time: playing, stepping, choosing.

import { shown } from "view/colours.js";

const FACTORS = [0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100];
/** Seconds that a motion takes on the screen at first, about. */
const USUAL = 8;

/** Holds the time and tells listeners of its changes. */
export class Timeline {
  /** `times` of the instants; `clock` says what they are: "time" (s), "load factor", "iteration". */
  constructor(times, clock) {
    this.seconds = clock === "time";
    this.playing = false;
    this.listeners = [];
    this.#setTimes(times);
    this.now = this.start;
    const length = this.end - this.start;
    const usual = length / USUAL || 1;
    this.factor = this.seconds && length > 2 && length <= 20 ? 1 : nearest(usual);
    this.#connect(clock);
  }

  /** There are more instants; one who looks at the last one stays there. */
  extend(times) {
    const follow = this.now >= this.end && !this.playing;
    this.#setTimes(times);
    Object.assign(this.slider, { min: this.start, max: this.end });
    this.go(follow ? this.end : this.now);
  }

  onChange(listener) {
    this.listeners.push(listener);
  }

  /** The instant before the time, and the part of the way to the next one. */
  moment() {
    const { times, now } = this;
    let [a, b] = [0, times.length - 1];
    while (b - a > 1) {
      const middle = (a + b) >> 1;
      if (times[middle] <= now) a = middle;
      else b = middle;
    }
    if (now >= times[b]) return { i: b, s: 0 };
    return { i: a, s: Math.min(Math.max((now - times[a]) / (times[b] - times[a]), 0), 1) };
  }

  go(time) {
    this.now = Math.min(Math.max(time, this.start), this.end);
    this.slider.value = this.now;
    if (document.activeElement !== this.clock) this.clock.value = shown(this.now, 5);
    this.listeners.forEach((listener) => listener(this.now));
  }

  /** To an instant before or after. */
  step(by) {
    this.play(false);
    const { i, s } = this.moment();
    const next = by < 0 && s > 0 ? i : i + by;
    this.go(this.times[Math.min(Math.max(next, 0), this.times.length - 1)]);
  }

  play(on) {
    if (on && this.now >= this.end) this.now = this.start;
    this.playing = on && this.times.length > 1;
    this.button.classList.toggle("playing", this.playing);
    this.last = null;
  }

  /** Go on as far as the clock on the wall has, in milliseconds. */
  tick(wall) {
    if (!this.playing) return;
    const passed = this.last === null ? 0 : (wall - this.last) / 1000;
    this.last = wall;
    const next = this.now + this.factor * passed;
    if (next < this.end) this.go(next);
    else if (this.loop.checked) this.go(this.start);
    else {
      this.go(this.end);
      this.play(false);
    }
  }

  #setTimes(times) {
    this.times = times;
    [this.start, this.end] = [times[0], times.at(-1)];
  }

  #connect(clock) {
    const find = (id) => document.getElementById(id);
    [this.slider, this.button, this.clock, this.loop] = ["slider", "play", "clock", "loop"].map(find);
    Object.assign(this.slider, { min: this.start, max: this.end, value: this.start });
    this.slider.addEventListener("input", () => this.go(Number(this.slider.value)));
    this.clock.addEventListener("change", () => {
      const asked = Number(this.clock.value.replace(",", "."));
      this.clock.blur();
      this.go(Number.isFinite(asked) ? asked : this.now);
    });
    find("clock-name").textContent = this.seconds ? "t" : clock;
    find("clock-unit").textContent = this.seconds ? "s" : "";
    this.button.addEventListener("click", () => this.play(!this.playing));
    find("first").addEventListener("click", () => this.go(this.start));
    find("back").addEventListener("click", () => this.step(-1));
    find("forward").addEventListener("click", () => this.step(1));
    this.#fillSpeeds(find("speed"));
    this.go(this.start);
  }

  #fillSpeeds(select) {
    const usual = this.factor;
    for (const factor of FACTORS) {
      const value = this.seconds ? factor : factor * usual;
      if (!this.seconds && (factor < 0.1 || factor > 10)) continue;
      const option = new Option(`× ${shown(this.seconds ? value : factor)}`, value);
      option.selected = value === usual;
      select.append(option);
    }
    if (![...select.options].some((option) => option.selected && Number(option.value) === usual)) {
      select.append(new Option(`× ${shown(usual)}`, usual, true, true));
    }
    select.title = this.seconds ? "speed: seconds of the motion in a second" : "speed";
    select.addEventListener("change", () => (this.factor = Number(select.value)));
  }
}

/** The round number next to a speed. */
function nearest(value) {
  const power = 10 ** Math.floor(Math.log10(value));
  return Number(([1, 2, 5].findLast((factor) => factor * power <= value) * power).toPrecision(1));
}
