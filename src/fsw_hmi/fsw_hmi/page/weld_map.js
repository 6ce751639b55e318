// The canister unrolled: the way welded so far by its quality, and where it was left, with the moment of each.
import { el, setText, svg } from "./dom.js";
import { fixed, span } from "./format.js";
import { judge, quantity } from "./quantities.js";

const WAY_DEG = 420; // a turn, the overlap, and the way out
const STEP_DEG = 0.5;
const TURN_DEG = 360;
const SIGN = { high: "■", medium: "▲" };
const RANK = { good: 1, medium: 2, high: 3 };
/** Marks are for fingers: those that are nearer become one. */
const MARK_PX = 48;
const SAME_S = 5;

export class WeldMap {
  #levels = new Uint8Array(WAY_DEG / STEP_DEG); // of each step the worst; 0: not welded
  #exceedances = /** @type {Exceedance[]} */ ([]);
  #furthest = 0;

  /**
   * @param {HTMLElement} root
   * @param {string[]} names columns of a row
   * @param {Limits} limits
   * @param {(timeS: number) => void} onMoment called with the moment of an exceedance that is chosen
   * @param {(timeS: number) => string} told a moment in words
   */
  constructor(root, names, limits, onMoment, told = span) {
    this.root = root;
    this.limits = limits;
    this.onMoment = onMoment;
    this.told = told;
    this.columns = ["depth_mm", "temperature_c"].map((key) => ({ key, value: names.indexOf(key), aim: names.indexOf(quantity(key).aim) }));
    this.angle = names.indexOf("angle_deg");
    this.paths = Object.keys(RANK).map((level) => svg("path", { class: level }));
    this.tool = svg("path", { class: "tool" });
    this.picture = svg("svg", { viewBox: `0 0 ${WAY_DEG} 10`, preserveAspectRatio: "none", role: "img" }, svg("rect", { x: TURN_DEG, width: WAY_DEG - TURN_DEG, height: 10, class: "overlap" }), ...this.paths, this.tool);
    this.detail = el("span", { className: "detail" });
    this.marks = el("div", { className: "exceedances" });
    const axis = [0, 90, 180, 270, 360, 400].map((deg) => at(el("span", { className: "tick" }, `${deg}°`), deg));
    root.replaceChildren(el("h2", {}, "Weld, unrolled ", this.detail), el("div", { className: "way" }, this.picture, this.marks), el("div", { className: "axis" }, ...axis));
    root.hidden = true;
    this.resizer = new ResizeObserver(() => this.draw());
    this.resizer.observe(root);
  }

  /** Take rows, in order of time; blocks of them may come in any order. */
  add(rows) {
    const open = new Map();
    for (const row of rows) {
      const deg = row[this.angle];
      if (deg === null || deg === undefined) continue;
      this.#furthest = Math.min(Math.max(this.#furthest, deg), WAY_DEG);
      let worst = "good";
      for (const { key, value, aim } of this.columns) {
        const { level, text } = judge(key, this.limits, row[value], row[aim]);
        if (level) this.#exceed(open, key, { level, deg, text: `${quantity(key).name}: ${text}`, timeS: row[0], endS: row[0] });
        if (level && RANK[level] > RANK[worst]) worst = level;
      }
      const step = Math.min(Math.max(Math.floor(deg / STEP_DEG), 0), this.#levels.length - 1);
      this.#levels[step] = Math.max(this.#levels[step], RANK[worst]);
    }
  }

  /** One exceedance goes on as long as no more than a few seconds are between its rows. */
  #exceed(open, key, now) {
    const same = open.get(key) ?? this.#exceedances.find((one) => one.key === key && now.timeS > one.timeS - SAME_S && now.timeS < one.endS + SAME_S);
    if (same && now.timeS < same.endS + SAME_S) {
      if (now.timeS < same.timeS) Object.assign(same, { timeS: now.timeS, deg: now.deg });
      same.endS = Math.max(same.endS, now.endS);
      if (RANK[now.level] > RANK[same.level]) Object.assign(same, { level: now.level, text: now.text });
      return open.set(key, same);
    }
    const begun = { key, ...now };
    this.#exceedances.push(begun);
    return open.set(key, begun);
  }

  draw() {
    const known = this.#levels.some(Boolean);
    this.root.hidden = !known;
    if (!known) return;
    const count = this.#exceedances.length;
    setText(this.detail, `${fixed(this.#furthest, 0)}° welded, ${count ? `${count} times` : "nowhere"} outside the limits`);
    this.picture.setAttribute("aria-label", `Way around the canister: ${this.detail.textContent}`);
    this.tool.setAttribute("d", `M${this.#furthest} 0v10`);
    this.paths.forEach((path, i) => path.setAttribute("d", this.#stretches(i + 1)));
    this.#mark();
  }

  /** Rectangles of all steps of a level, one for each stretch. */
  #stretches(rank) {
    let drawn = "";
    for (let from = 0; from < this.#levels.length; from++) {
      if (this.#levels[from] !== rank) continue;
      let to = from;
      while (this.#levels[to] === rank) to++;
      drawn += `M${from * STEP_DEG} 0H${to * STEP_DEG}V10H${from * STEP_DEG}z`;
      from = to;
    }
    return drawn;
  }

  #mark() {
    const width = WAY_DEG / Math.max(1, Math.floor(this.marks.clientWidth / MARK_PX));
    const places = new Map();
    for (const one of this.#exceedances.sort((a, b) => a.timeS - b.timeS)) {
      const place = Math.floor(Math.min(one.deg, WAY_DEG - 1) / width);
      places.set(place, [...(places.get(place) ?? []), one]);
    }
    const key = JSON.stringify([width, [...places]]);
    if (key === this.drawn) return;
    this.drawn = key;
    const focused = [...this.marks.children].indexOf(/** @type {Element} */ (document.activeElement));
    this.marks.replaceChildren(...[...places].map(([place, group]) => this.#button((place + 0.5) * width, group)));
    /** @type {HTMLElement?} */ (this.marks.children[focused])?.focus();
  }

  /** A mark for one exceedance, or for several, which it shows one after the other. */
  #button(deg, group) {
    const worst = group.some((one) => one.level === "high") ? "high" : "medium";
    const texts = group.map((one) => `${one.text} from ${fixed(one.deg, 0)}°, ${this.told(one.timeS)}, for ${span(one.endS - one.timeS)}`);
    let next = 0;
    const button = at(el("button", { type: "button", title: texts.join("\n"), "aria-label": texts.join("; "), onclick: () => this.onMoment(group[next++ % group.length].timeS) }, el("span", {}, SIGN[worst], group.length > 1 ? group.length : "")), deg);
    button.dataset.level = worst;
    return button;
  }

  destroy() {
    this.resizer.disconnect();
  }
}

function at(node, deg) {
  node.style.setProperty("--at", `${(100 * deg) / WAY_DEG}%`);
  return node;
}
