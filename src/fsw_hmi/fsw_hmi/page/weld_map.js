// The canister unrolled: the way welded so far, and the places outside limits that the server's
// judgement has, with the moment.
import { at, el, setShort, svg } from "./dom.js";
import { fixed, known, SIGN, span } from "./format.js";

const WAY_DEG = 420; // a turn, the overlap, and the way out
const TURN_DEG = 360;
const STEP_DEG = 0.5;
/** @type {Level[]} */ const LEVELS = ["good", "medium", "high"];
/** Marks are for fingers: those that are nearer become one. */
const MARK_PX = 48;
/** 95 of 100 welds of the type lie within so many standard deviations of the known heat. */
const SIGMAS = 2;
const HEIGHT = 10;

export class WeldMap {
  /** Which steps of the way are welded. @type {boolean[]} */
  #steps = new Array(WAY_DEG / STEP_DEG).fill(false);
  /** @type {Mark[]} */
  #marks = [];
  #drawn = "";
  #known = "";

  /**
   * `onMoment` is called with the moment of a mark that is chosen, which `momentText` puts into
   * words.
   * @param {HTMLElement} root
   * @param {string[]} names
   * @param {(timeS: number) => void} onMoment
   * @param {(timeS: number) => string} momentText
   * @param {string} weld whose name is shown, where there are several
   */
  constructor(root, names, onMoment, momentText = span, weld = "") {
    this.onMoment = onMoment;
    this.momentText = momentText;
    this.angle = names.indexOf("angle_deg");
    this.paths = LEVELS.map((level) => svg("path", { class: level }));
    this.tool = svg("path", { class: "tool" });
    this.heat = svg("path", { class: "heat" });
    this.picture = svg("svg", { viewBox: `0 0 ${WAY_DEG} 10`, preserveAspectRatio: "none",
        role: "img" }, svg("rect", { x: TURN_DEG, width: WAY_DEG - TURN_DEG, height: 10,
        class: "overlap" }), ...this.paths, this.heat, this.tool);
    this.detail = el("span", { className: "detail" });
    this.marks = el("div", { className: "exceedances" });
    this.unplaced = el("div", { className: "unplaced" });
    const axis = [0, 90, 180, 270, 360, 400].map(
        (deg) => at(el("span", { className: "tick" }, `${deg}°`), deg / WAY_DEG));
    root.replaceChildren(el("h2", {}, `${weld || "Weld"}, unrolled `, this.detail),
        el("div", { className: "way" }, this.picture, this.marks),
        el("div", { className: "axis" }, ...axis), this.unplaced);
    this.resizer = new ResizeObserver(() => this.draw());
    this.resizer.observe(root);
  }

  /** Take rows, in whatever order. */
  add(/** @type {Row[]} */ rows) {
    for (const row of rows) {
      const deg = row[this.angle];
      if (known(deg)) this.#steps[Math.min(
          Math.max(Math.floor(deg / STEP_DEG), 0), this.#steps.length - 1)] = true;
    }
  }

  /** Take the places outside limits, which replace those before. */
  judged(/** @type {Mark[]} */ marks) {
    this.#marks = marks;
  }

  /**
   * Take the heat that is known from earlier welds, drawn as a band from its least to its most,
   * and the share of it in use.
   */
  known(/** @type {Heat?} */ heat, /** @type {Value} */ share) {
    const edge = (/** @type {number} */ sign) => (heat?.heat_kw ?? []).map(
        (value, i) => value + sign * SIGMAS * (heat?.deviation_kw[i] ?? 0));
    const [low, high] = [edge(-1), edge(1)];
    const [least, most] = [Math.min(...low), Math.max(...high)];
    const points = (/** @type {number[]} */ values) =>
        values.map((value, i) =>
        `${heat?.angle_deg[i]} ${fixed((HEIGHT * (most - value)) / Math.max(most - least, 1e-6), 2)}`);
    this.heat.setAttribute("d", low.length
        ? `M${[...points(high), ...points(low).reverse()].join("L")}z` : "");
    const used = known(share) ? `${fixed(100 * share, 0)} % in use` : "not in use";
    this.#known = low.length
        ? `; known heat of ${heat?.type}: ${fixed(least, 1)} to ${fixed(most, 1)} kW, ${used}`
        : "";
  }

  draw() {
    const welded = this.#steps.findLastIndex(Boolean) * STEP_DEG;
    const outside = this.#marks.map((mark) => ({ from: mark.from_deg ?? NaN,
        to: Math.max(mark.to_deg ?? NaN, (mark.from_deg ?? NaN) + STEP_DEG),
        worst: { rank: LEVELS.indexOf(mark.level), text: mark.text, timeS: mark.time_s } }));
    const times = outside.length === 1 ? "once" : outside.length ? `${outside.length} times`
        : "nowhere";
    setShort(this.detail, welded < 0 ? "no angle is known yet"
        : `${fixed(welded, 0)}° welded, ${times} outside the limits${this.#known}`);
    this.picture.setAttribute("aria-label", `Way around the canister: ${this.detail.textContent}`);
    this.tool.setAttribute("d", welded < 0 ? "" : `M${welded} 0v10`);
    const drawn = [this.#welded(), ...LEVELS.slice(1).map(
        (_, i) => outside.filter(({ from, worst }) => known(from) && worst.rank === i + 1))];
    this.paths.forEach((path, level) => path.setAttribute(
        "d", drawn[level].map(({ from, to }) => `M${from} 0H${to}V10H${from}z`).join("")));
    this.#mark(outside);
  }

  /** The way welded so far, in stretches. */
  #welded() {
    const stretches = /** @type {{from: number, to: number}[]} */ ([]);
    this.#steps.forEach((step, i) => {
      if (!step) return;
      const last = stretches[stretches.length - 1];
      if (last?.to !== i * STEP_DEG) stretches.push(
          { from: i * STEP_DEG, to: (i + 1) * STEP_DEG });
      else last.to = (i + 1) * STEP_DEG;
    });
    return stretches;
  }

  /** @param {Stretch[]} outside */
  #mark(outside) {
    const width = WAY_DEG / Math.max(1, Math.floor(this.marks.clientWidth / MARK_PX));
    const key = JSON.stringify([width, outside]);
    if (key === this.#drawn) return;
    this.#drawn = key;
    /** @type {Map<number, Stretch[]>} */ const places = new Map();
    for (const stretch of outside.filter(({ from }) => known(from))) {
      const place = Math.min(Math.floor(stretch.from / width), Math.round(WAY_DEG / width) - 1);
      places.set(place, [...(places.get(place) ?? []), stretch]);
    }
    const focused = [...this.marks.children].indexOf(
        /** @type {Element} */ (document.activeElement));
    this.marks.replaceChildren(...[...places].map(
        ([place, group]) => at(this.#button(group), ((place + 0.5) * width) / WAY_DEG)));
    /** @type {HTMLElement?} */ (this.marks.children[focused])?.focus();
    const unplaced = outside.filter(({ from }) => !known(from));
    this.unplaced.replaceChildren(...(unplaced.length
        ? [this.#button(unplaced), " without a place"] : []));
  }

  /**
   * A mark for one stretch, or for several, which it shows one after the other.
   * @param {Stretch[]} group
   */
  #button(group) {
    const rank = Math.max(...group.map(({ worst }) => worst.rank));
    const texts = group.map(({ from, to, worst }) =>
        `${worst.text}, ${known(from) ? `${fixed(from, 0)}° to ${fixed(to, 0)}°` : "place not known"}, ${this.momentText(worst.timeS)}`);
    let next = 0;
    const sign = el(
        "span", { "data-sign": `${SIGN[LEVELS[rank]]}${group.length > 1 ? group.length : ""}` });
    const onclick = () => this.onMoment(group[next++ % group.length].worst.timeS);
    return el("button", { type: "button", "data-level": LEVELS[rank], title: texts.join("\n"),
        "aria-label": texts.join("; "), onclick }, sign);
  }

  destroy() {
    this.resizer.disconnect();
  }
}
