// The values now: a numeral and an analogue bar each, with normal range, limits, set-point and
// dead-band.
import { at, el, panel, setText } from "./dom.js";
import { fixed, known, SIGN, signed } from "./format.js";
import { normalRange, QUANTITIES } from "./quantities.js";

/**
 * Nearer to an end of the scale a limit has no label of its own: it would lie over that of the
 * end.
 */
const LABEL_SHARE = 0.08;

/** A flag's text as a tile has room for it. */
const brief = (/** @type {string} */ text) =>
    text.replace("beyond its essential limit", "essential limit").replace("off its ", "off ");

class Bar {
  constructor(/** @type {Spec} */ spec, /** @type {Limits} */ limits) {
    this.spec = spec;
    this.limits = limits;
    this.own = limits[spec.key] ?? { range: [0, 1] };
    this.low = this.own.range[0];
    this.high = this.own.range[1];
    this.tile = panel(`value-${spec.key}`, spec.name);
    this.tile.classList.add("tile", spec.big ? "tall" : "small");
    this.tile.firstElementChild?.append(" ", el("span", { className: "unit" }, spec.unit));
    this.value = el("output", { className: "numeral" }, "–");
    this.aim = el("span", { className: "aim" });
    this.flag = el("span", { className: "flag" });
    this.plan = el("span", { className: "plan" });
    this.scale = el("div", { className: "scale", role: "img",
        "aria-label": `${spec.name}: scale ${this.low} to ${this.high} ${spec.unit}` });
    this.tile.append(el("p", { className: "reading" }, this.value),
        el("p", { className: "beside" }, this.aim, " ", this.plan, " ", this.flag),
        el("div", { className: "gauge" }, this.scale));
    const { kept, warn, trip, dead_band: deadBand } = this.own;
    this.normal = kept || warn || trip ? this.#part("band normal") : null;
    if (this.normal && !kept) this.#stretch(this.normal, ...(warn ?? trip ?? [null, null]));
    this.deadBand = deadBand ? this.#part("band dead-band") : null;
    this.#limits("warn", warn);
    this.#limits("trip", trip);
    this.#label(this.low, "end lowest");
    this.#label(this.high, "end highest");
    this.planned = this.#part("mark planned");
    this.goal = this.#part("mark goal");
    this.marker = this.#part("mark marker");
    this.pointer = this.#part("mark pointer");
    this.update(null, null, null, null, null);
  }

  /**
   * `plan` is the programme's set-point, which need not be the one in force, `goal` what stands
   * in for one out of reach, `wrong` what the server finds wrong.
   * @param {Value} value
   * @param {Value} aim
   * @param {Value} plan
   * @param {Value} goal
   * @param {Flag?} wrong
   */
  update(value, aim, plan, goal, wrong) {
    const { spec } = this;
    setText(this.value, fixed(value, spec.digits));
    const difference = spec.big && known(value) && known(aim)
        ? ` (${signed(value - aim, Math.abs(value - aim) < 99.5 ? spec.digits : 0)})` : "";
    setText(this.aim, spec.aim ? `${spec.aimName} ${fixed(aim, spec.digits)}${difference}` : "");
    // in a ramp the two are told up to a second apart
    const differs = known(plan) && !(Math.abs(plan - (aim ?? NaN)) <= (spec.rampPerS ?? 0));
    const relation = differs ? "≠" : fixed(plan, spec.digits) === fixed(aim, spec.digits) ? "="
        : "≈";
    setText(this.plan, known(plan) ? `${relation} programme ${fixed(plan, spec.digits)}` : "");
    this.plan.classList.toggle("differs", differs);
    const replaced = goal !== null && known(aim)
        && fixed(goal, spec.digits) !== fixed(aim, spec.digits);
    // why it is off
    const explanation = replaced && (!wrong || wrong.kind === "error")
        ? `attainable ${fixed(goal, spec.digits)}` : wrong?.text;
    this.tile.dataset.level = wrong?.level ?? (replaced ? "low" : "");
    const off = known(value) && (value < this.low || value > this.high);
    this.pointer.classList.toggle("off", off);
    const sign = explanation ? `${SIGN[wrong?.level ?? "low"]} ` : "";
    // a small tile has room for this only
    const offScale = off && !spec.big ? `off scale, ${value < this.low ? "low" : "high"}` : "";
    setText(this.flag, sign + (offScale
        || [explanation && brief(explanation), off && "off scale"].filter(Boolean).join(" · ")));
    this.flag.title = explanation ?? "";
    this.#point(this.planned, differs ? plan : null);
    this.#point(this.goal, replaced ? goal : null);
    this.#point(this.pointer, value);
    this.#point(this.marker, aim);
    if (this.normal && this.own.kept) this.#stretch(
        this.normal, ...normalRange(this.spec.key, this.limits, plan ?? aim));
    const half = this.own.dead_band ?? 0;
    if (this.deadBand) this.#stretch(this.deadBand, aim === null ? null : aim - half,
        aim === null ? null : aim + half);
  }

  #share(/** @type {number} */ value) {
    return Math.min(1, Math.max(0, (value - this.low) / (this.high - this.low)));
  }

  #part(/** @type {string} */ className) {
    const part = el("div", { className });
    this.scale.append(part);
    return part;
  }

  /** @param {HTMLElement} band @param {Value} low @param {Value} high */
  #stretch(band, low, high) {
    const [from, to] = [this.#share(low ?? this.low), this.#share(high ?? this.high)];
    band.style.setProperty("--from", `${100 * from}%`);
    band.style.setProperty("--share", `${100 * Math.max(0, to - from)}%`);
  }

  /** @param {string} kind @param {Pair | undefined} limits */
  #limits(kind, [low, high] = [null, null]) {
    for (const [from, to, at] of [[this.low, low, low], [high, this.high, high]]) {
      if (!known(at)) continue;
      this.#stretch(this.#part(`band ${kind}`), from, to);
      const share = this.#share(at);
      if (share > LABEL_SHARE && share < 1 - LABEL_SHARE) this.#label(at, kind);
    }
  }

  #label(/** @type {number} */ value, /** @type {string} */ kind) {
    const label = this.#part(`tick ${kind}`);
    label.textContent = String(value);
    at(label, this.#share(value));
  }

  #point(/** @type {HTMLElement} */ mark, /** @type {Value} */ value) {
    mark.hidden = value === null;
    if (value !== null) at(mark, this.#share(value));
  }
}

/** Tiles of all quantities in `root`. */
export class Bars {
  constructor(/** @type {HTMLElement} */ root, /** @type {Limits} */ limits) {
    this.bars = QUANTITIES.map((spec) => new Bar(spec, limits));
    root.replaceChildren(...this.bars.map((bar) => bar.tile));
  }

  /**
   * Show the values with what is wrong with them, the programme's set-points, and what stands in
   * for those out of reach.
   * @param {Values} values
   * @param {Flags} flags
   * @param {Programme?} programme
   * @param {SetPoints?} attainable
   */
  update(values, flags, programme = null, attainable = null) {
    const [plan, goals] = /** @type {(Values | null)[]} */ (
        /** @type {unknown} */ ([programme, attainable]));
    for (const bar of this.bars) {
      const { key, aim } = bar.spec;
      bar.update(values[key] ?? null, values[aim] ?? null, plan?.[key] ?? null,
          goals?.[key] ?? null, flags[key] ?? null);
    }
  }
}
