// The canister unrolled: the way welded so far by its quality, and where it was outside its limits, with the moment.
import { at, el, setShort, svg } from "./dom.js";
import { fixed, known, SIGN, span } from "./format.js";
import { judge, quantity } from "./quantities.js";

const WAY_DEG = 420; // a turn, the overlap, and the way out
const TURN_DEG = 360;
const STEP_DEG = 0.5;
/** @type {Level[]} */ const LEVELS = ["good", "medium", "high"];
/** Marks are for fingers: those that are nearer become one. */
const MARK_PX = 48;

export class WeldMap {
  /** Of each step of the way the worst row. @type {(Spot | undefined)[]} */
  #steps = new Array(WAY_DEG / STEP_DEG).fill(undefined);
  #drawn = "";

  /** `onMoment` is called with the moment of a mark that is chosen, which `told` puts into words. @param {HTMLElement} root @param {string[]} names @param {Limits} limits @param {(timeS: number) => void} onMoment @param {(timeS: number) => string} told */
  constructor(root, names, limits, onMoment, told = span) {
    this.limits = limits;
    this.onMoment = onMoment;
    this.told = told;
    this.columns = ["depth_mm", "temperature_c"].map((key) => ({ key, value: names.indexOf(key), aim: names.indexOf(quantity(key).aim) }));
    this.angle = names.indexOf("angle_deg");
    this.paths = LEVELS.map((level) => svg("path", { class: level }));
    this.tool = svg("path", { class: "tool" });
    this.picture = svg("svg", { viewBox: `0 0 ${WAY_DEG} 10`, preserveAspectRatio: "none", role: "img" }, svg("rect", { x: TURN_DEG, width: WAY_DEG - TURN_DEG, height: 10, class: "overlap" }), ...this.paths, this.tool);
    this.detail = el("span", { className: "detail" });
    this.marks = el("div", { className: "exceedances" });
    const axis = [0, 90, 180, 270, 360, 400].map((deg) => at(el("span", { className: "tick" }, `${deg}°`), deg / WAY_DEG));
    root.replaceChildren(el("h2", {}, "Weld, unrolled ", this.detail), el("div", { className: "way" }, this.picture, this.marks), el("div", { className: "axis" }, ...axis));
    this.resizer = new ResizeObserver(() => this.draw());
    this.resizer.observe(root);
  }

  /** Take rows, in whatever order. */
  add(/** @type {Row[]} */ rows) {
    for (const row of rows) {
      const deg = row[this.angle];
      const timeS = row[0];
      if (!known(deg) || !known(timeS)) continue;
      const verdicts = this.columns.map(({ key, value, aim }) => ({ key, ...judge(key, this.limits, row[value], row[aim]) }));
      const found = verdicts.find(({ level }) => level === "high") ?? verdicts.find(({ level }) => level);
      const rank = LEVELS.indexOf(found?.level ?? "good");
      const step = Math.min(Math.max(Math.floor(deg / STEP_DEG), 0), this.#steps.length - 1);
      const before = this.#steps[step];
      if (before && (before.rank > rank || (before.rank === rank && before.timeS <= timeS))) continue;
      this.#steps[step] = { rank, text: found ? `${quantity(found.key).name}: ${found.text}` : "", timeS };
    }
  }

  draw() {
    const welded = this.#steps.findLastIndex(Boolean) * STEP_DEG;
    const outside = this.#stretches((rank) => rank > 0);
    const times = outside.length === 1 ? "once" : outside.length ? `${outside.length} times` : "nowhere";
    setShort(this.detail, welded < 0 ? "no angle is known yet" : `${fixed(welded, 0)}° welded, ${times} outside the limits`);
    this.picture.setAttribute("aria-label", `Way around the canister: ${this.detail.textContent}`);
    this.tool.setAttribute("d", welded < 0 ? "" : `M${welded} 0v10`);
    this.paths.forEach((path, level) => path.setAttribute("d", this.#stretches((rank) => rank === level).map(({ from, to }) => `M${from} 0H${to}V10H${from}z`).join("")));
    this.#mark(outside);
  }

  /** Neighbouring steps whose rank is wanted, as `{from, to, worst}`. @param {(rank: number) => boolean} wanted */
  #stretches(wanted) {
    const found = /** @type {Stretch[]} */ ([]);
    this.#steps.forEach((step, i) => {
      if (!step || !wanted(step.rank)) return;
      const last = found[found.length - 1];
      if (last?.to !== i * STEP_DEG) found.push({ from: i * STEP_DEG, to: (i + 1) * STEP_DEG, worst: step });
      else Object.assign(last, { to: (i + 1) * STEP_DEG, worst: step.rank > last.worst.rank ? step : last.worst });
    });
    return found;
  }

  /** @param {Stretch[]} outside */
  #mark(outside) {
    const width = WAY_DEG / Math.max(1, Math.floor(this.marks.clientWidth / MARK_PX));
    const key = JSON.stringify([width, outside]);
    if (key === this.#drawn) return;
    this.#drawn = key;
    /** @type {Map<number, Stretch[]>} */ const places = new Map();
    for (const one of outside) {
      const place = Math.min(Math.floor(one.from / width), Math.round(WAY_DEG / width) - 1);
      places.set(place, [...(places.get(place) ?? []), one]);
    }
    const focused = [...this.marks.children].indexOf(/** @type {Element} */ (document.activeElement));
    this.marks.replaceChildren(...[...places].map(([place, group]) => this.#button((place + 0.5) * width, group)));
    /** @type {HTMLElement?} */ (this.marks.children[focused])?.focus();
  }

  /** A mark for one stretch, or for several, which it shows one after the other. @param {Stretch[]} group */
  #button(/** @type {number} */ deg, group) {
    const rank = Math.max(...group.map(({ worst }) => worst.rank));
    const texts = group.map(({ from, to, worst }) => `${worst.text}, ${fixed(from, 0)}° to ${fixed(to, 0)}°, ${this.told(worst.timeS)}`);
    let next = 0;
    const sign = el("span", {}, SIGN[LEVELS[rank]], group.length > 1 ? String(group.length) : "");
    const onclick = () => this.onMoment(group[next++ % group.length].worst.timeS);
    return at(el("button", { type: "button", "data-level": LEVELS[rank], title: texts.join("\n"), "aria-label": texts.join("; "), onclick }, sign), deg / WAY_DEG);
  }

  destroy() {
    this.resizer.disconnect();
  }
}
