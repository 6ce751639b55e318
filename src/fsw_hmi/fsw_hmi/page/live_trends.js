// The last 1, 5 or 45 minutes, and the controller's prediction ahead of now.
import { el } from "./dom.js";
import { clock } from "./format.js";
import { drawLine, drawTime, liveLines, Trends, withQuality } from "./trends.js";

/** Redrawing a long window as often as a short one would cost much and change no pixel. */
const WINDOWS = [
  { name: "1 min", length_s: 60, ahead_s: 10, every_s: 10, redraw_ms: 200 },
  { name: "5 min", length_s: 300, ahead_s: 15, every_s: 60, redraw_ms: 250 },
  { name: "45 min", length_s: 2700, ahead_s: 15, every_s: 900, redraw_ms: 1000 },
];

/** An older prediction says nothing about what comes. */
const PREDICTION_MAX_AGE_S = 3;

export class LiveTrends {
  #window = WINDOWS[0];
  #prediction = null;
  #toServerS = 0; // from the weld's clock to the server's

  constructor(root, store, limits) {
    this.store = store;
    this.limits = limits;
    this.buttons = WINDOWS.map((window) => el("button", { type: "button", onclick: () => this.#choose(window) }, window.name));
    const bar = el("div", { className: "toolbar", role: "group", "aria-label": "Length of the trends" }, ...this.buttons, legend());
    const plots = el("div", { className: "plots" });
    root.replaceChildren(bar, plots);
    this.trends = new Trends(plots, {
      lines: (key) => liveLines(key, limits),
      label: (time) => this.#label(time),
      splits: (min, max) => this.#splits(min, max),
      overlay: (u, key) => this.#overlay(u, key),
    });
    this.#choose(this.#window);
  }

  note(tick) {
    this.#toServerS = tick.server_s - tick.row[0];
  }

  predict(prediction) {
    this.#prediction = prediction;
  }

  destroy() {
    clearInterval(this.timer);
    this.trends.destroy();
  }

  #choose(window) {
    this.#window = window;
    this.buttons.forEach((button, i) => button.setAttribute("aria-pressed", String(WINDOWS[i] === window)));
    clearInterval(this.timer);
    this.timer = setInterval(() => this.#draw(), window.redraw_ms);
    this.#draw();
  }

  #draw() {
    const now = this.store.newest;
    if (document.hidden || Number.isNaN(now) || now === this.drawn?.now && this.#window === this.drawn.window) return;
    this.drawn = { now, window: this.#window };
    const from = now - this.#window.length_s;
    const columns = withQuality(this.store.since(from), this.limits);
    this.trends.draw(columns, from, now + this.#window.ahead_s, this.#ahead() ?? {});
  }

  /** Fixed places, so that the axis does not crawl: the curves move below it. */
  #splits(min, max) {
    const now = max - this.#window.ahead_s;
    const places = [];
    for (let at = now; at >= min - 0.01; at -= this.#window.every_s) places.unshift(at);
    return places;
  }

  #label(time) {
    const back = this.drawn.now - time;
    if (Math.abs(back / this.#window.every_s - Math.round(back / this.#window.every_s)) > 1e-6) return clock(time + this.#toServerS);
    if (back < 0.5) return "now";
    return this.#window.length_s > 60 ? `−${Math.round(back / 60)} min` : `−${Math.round(back)} s`;
  }

  #overlay(u, key) {
    drawTime(u, this.drawn?.now, "#5a6268");
    const ahead = this.#ahead();
    if (ahead?.[key]) drawLine(u, ahead.time_s, ahead[key]);
  }

  #ahead() {
    const ahead = this.#prediction;
    return ahead && Math.abs(this.store.newest - ahead.time_s[0]) < PREDICTION_MAX_AGE_S ? ahead : null;
  }
}

function legend() {
  const entry = (kind, text) => el("li", {}, el("span", { className: `key ${kind}` }), text);
  return el("ul", { className: "legend" }, entry("measured", "measured"), entry("aimed", "set-point"), entry("limit", "limit"), entry("predicted", "prediction"));
}
