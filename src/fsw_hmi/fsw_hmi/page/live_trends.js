// The last 1, 5 or 45 minutes, and the controller's prediction ahead of now.
import { el } from "./dom.js";
import { clock } from "./format.js";
import { TRENDS } from "./quantities.js";
import { drawBand, drawLine, drawTime, liveLines, Trends, withNormal } from "./trends.js";

/** Redrawing a long window as often as a short one would cost much and change no pixel. */
const WINDOWS = [
  { name: "1 min", length_s: 60, ahead_s: 10, every_s: 10, redraw_ms: 200 },
  { name: "5 min", length_s: 300, ahead_s: 15, every_s: 60, redraw_ms: 250 },
  { name: "45 min", length_s: 2700, ahead_s: 15, every_s: 900, redraw_ms: 1000 },
];
const LEGEND = [["measured", "measured"], ["aimed", "set-point"], ["limit", "limit"],
    ["predicted", "prediction"], ["deviation", "expected, ± 2 σ",
    "95 of 100 measurements, if the plan is followed and nothing happens that the controller cannot know"],
    ["second", "to be confirmed"]];

/** An older prediction says nothing about what comes. */
const PREDICTION_MAX_AGE_S = 3;
const PREVIEW = "#1f5f9e";
/** 95 of 100 measurements lie within so many standard deviations. */
const SIGMAS = 2;

export class LiveTrends {
  #window = WINDOWS[0];
  /** @type {Ahead?} */ prediction = null;
  /** @type {Ahead?} */ #preview = null; // what is about to be confirmed
  /** @type {[number, number]?} */ #range = null; // what is looked at, null: the present
  /** @type {number?} */ #mark = null; // the moment that was asked for
  #now = NaN; // of what is drawn
  toServerS = 0; // from the weld's clock to the server's

  /** @param {HTMLElement} root @param {import("./store.js").Store} store @param {Limits} limits */
  constructor(root, store, limits) {
    this.store = store;
    this.limits = limits;
    this.buttons = WINDOWS.map((window) =>
        el("button", { type: "button", onclick: () => this.#choose(window) }, window.name));
    this.back = el("button", { type: "button", className: "primary back",
        onclick: () => this.#show(null) }, "Back to now");
    const legend = el("ul", { className: "legend" }, ...LEGEND.map(([kind, text, title = ""]) =>
        el("li", { title }, el("span", { className: `key ${kind}` }), text)));
    this.plots = el("div", { className: "plots" });
    this.trends = new Trends(this.plots, {
      lines: (key) => liveLines(key, limits),
      label: (time) => this.#label(time),
      splits: (min, max) => this.#splits(min, max),
      overlay: (u, key) => this.#overlay(u, key),
      zoom: (range) => this.#show(range),
      ends: () => [store.columns[0][0] ?? NaN, store.newest],
    });
    root.replaceChildren(el("div", { className: "toolbar", role: "group", "aria-label": "Trends" },
        ...this.buttons, this.trends.other, this.back, legend), this.plots);
    this.#choose(this.#window);
  }

  /**
   * Show set-points that are about to be confirmed; null: there are none.
   * @param {Ahead?} ahead
   */
  preview(ahead) {
    // where the page scrolls, above the form
    if (ahead && !this.#preview) this.plots.scrollIntoView({ block: "start" });
    this.#preview = ahead;
    if (ahead) this.#range = null;
    this.#draw(true);
  }

  /** Show a moment in the middle. @param {number} timeS */
  look(timeS) {
    this.#show(this.#about(timeS), timeS);
  }

  /**
   * Show a range of time, null: the present.
   * @param {[number, number]?} range
   * @param {number?} mark
   */
  #show(range, mark = this.#mark) {
    this.#range = range;
    this.#mark = range && mark;
    this.#draw(true);
  }

  /** The window with a time in its middle. @param {number} timeS @returns {[number, number]} */
  #about(timeS) {
    const half = this.#window.length_s / 2;
    return [timeS - half, timeS + half];
  }

  /** A time of the weld as the server's. */
  clock(/** @type {number} */ timeS) {
    return clock(timeS + this.toServerS);
  }

  destroy() {
    clearInterval(this.timer);
    this.trends.destroy();
  }

  #choose(/** @type {typeof WINDOWS[0]} */ window) {
    this.#window = window;
    if (this.#range) this.#range = this.#about((this.#range[0] + this.#range[1]) / 2);
    this.buttons.forEach((button, i) =>
        button.setAttribute("aria-pressed", String(WINDOWS[i] === window)));
    clearInterval(this.timer);
    this.timer = setInterval(() => this.#draw(), window.redraw_ms);
    this.#draw(true);
  }

  #draw(always = false) {
    const now = this.store.newest;
    this.back.classList.toggle("unused", !this.#range); // its room stays reserved
    if (document.hidden || Number.isNaN(now) || (now === this.#now && !always)) return;
    this.#now = now;
    const { length_s: length, ahead_s: least } = this.#window;
    const ahead = Math.max(least, (this.#preview?.time_s.at(-1) ?? now) - now);
    const [from, to] = this.#range ?? [now - length, now + ahead];
    const held = Object.fromEntries(TRENDS.map(
        (key) => [key, [...(this.#ahead()?.[key] ?? []), ...(this.#preview?.[key] ?? [])]]));
    this.trends.draw(withNormal(this.store.since(from), this.limits), from, to, held);
  }

  /**
   * Fixed places, so that the axis does not crawl: the curves move below it.
   * @param {number} min
   * @param {number} max
   */
  #splits(min, max) {
    const [last, every] = this.#range ? [max, (max - min) / 3] : [this.#now, this.#window.every_s];
    const places = [];
    for (let at = last; at >= min - 0.01; at -= every) places.unshift(at);
    return places;
  }

  #label(/** @type {number} */ time) {
    const back = this.#now - time;
    const steps = back / this.#window.every_s;
    if (this.#range || Math.abs(steps - Math.round(steps)) > 1e-6) return this.clock(time);
    if (back < 0.5) return "now";
    return this.#window.length_s > 60 ? `−${Math.round(back / 60)} min` : `−${Math.round(back)} s`;
  }

  #overlay(/** @type {Plot} */ u, /** @type {string} */ key) {
    drawTime(u, this.#now, "#5a6268");
    if (this.#mark !== null) drawTime(u, this.#mark, "#000", [4, 3]);
    const expected = this.#ahead();
    if (expected) drawBand(u, expected, key, SIGMAS);
    for (const [ahead, stroke] of /** @type {const} */ (
        [[this.#preview, PREVIEW], [expected, undefined]])) {
      if (ahead?.[key]) drawLine(u, ahead.time_s, ahead[key], stroke);
    }
  }

  #ahead() {
    const ahead = this.prediction;
    return ahead && Math.abs(this.store.newest - ahead.time_s[0]) < PREDICTION_MAX_AGE_S ? ahead
        : null;
  }
}
