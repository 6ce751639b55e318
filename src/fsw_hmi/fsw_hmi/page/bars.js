// The values now: a numeral and an analogue bar each, with normal range, limits, set-point and dead-band.
import { el, panel, setText } from "./dom.js";
import { fixed, signed } from "./format.js";
import { judge, qualityLimits, QUANTITIES } from "./quantities.js";

const ADVICE_SIGN = { high: "■", medium: "▲" };

class Bar {
  constructor(spec, limits) {
    this.spec = spec;
    this.limits = limits;
    const [low, high] = limits[spec.key]?.range ?? [0, 1];
    this.low = low;
    this.high = high;
    this.tile = panel(`value-${spec.key}`, spec.name);
    this.tile.classList.add("tile", spec.big ? "tall" : "small");
    this.tile.firstChild.append(" ", el("span", { className: "unit" }, spec.unit));
    this.value = el("output", { className: "numeral" }, "–");
    this.aim = el("span", { className: "aim" });
    this.flag = el("span", { className: "flag" });
    this.plan = el("span", { className: "plan" });
    this.scale = el("div", { className: "scale", role: "img" });
    this.tile.append(
      el("p", { className: "reading" }, this.value),
      el("p", { className: "beside" }, this.aim, " ", this.plan, " ", this.flag),
      el("div", { className: "gauge" }, this.scale),
    );
    this.#build();
  }

  /** `plan` is the programme's set-point, which need not be the one in force. */
  update(value, aim, plan) {
    const { spec } = this;
    setText(this.value, fixed(value, spec.digits));
    const difference = spec.big && value !== null && aim !== null ? ` (${signed(value - aim, spec.digits)})` : "";
    setText(this.aim, spec.aim ? `${spec.aimName} ${fixed(aim, spec.digits)}${difference}` : "");
    const apart = plan === null ? 0 : Math.abs(plan - (aim ?? NaN));
    const differs = plan !== null && !(apart <= (spec.rampPerS ?? 0)); // in a ramp the two are told up to a second apart
    setText(this.plan, plan === null ? "" : `${differs ? "≠" : fixed(plan, spec.digits) === fixed(aim, spec.digits) ? "=" : "≈"} programme ${fixed(plan, spec.digits)}`);
    this.plan.classList.toggle("differs", differs);
    if (this.planned) this.#point(this.planned, differs ? plan : null);
    const verdict = judge(spec.key, this.limits, value, aim);
    this.tile.dataset.level = verdict.level ?? "";
    setText(this.flag, verdict.level ? `${ADVICE_SIGN[verdict.level]} ${verdict.text}` : "");
    this.#point(this.pointer, value);
    if (this.marker) this.#point(this.marker, aim);
    if (aim !== this.drawnAim) this.#followAim(aim);
  }

  #build() {
    const own = this.limits[this.spec.key] ?? {};
    if (own.quality) this.normal = this.#band("normal");
    else if (own.warn || own.trip) this.#stretch(this.#band("normal"), ...(own.warn ?? own.trip));
    if (own.dead_band) this.deadBand = this.#band("dead-band");
    for (const kind of ["warn", "trip"]) {
      const [low, high] = own[kind] ?? [null, null];
      if (low !== null) this.#limit(kind, this.low, low, low);
      if (high !== null) this.#limit(kind, high, this.high, high);
    }
    for (const [edge, name] of [[this.low, "lowest"], [this.high, "highest"]]) this.#label(edge, `end ${name}`);
    if (this.spec.big) this.planned = this.#mark("planned");
    if (this.spec.aim) this.marker = this.#mark("marker");
    this.pointer = this.#mark("pointer");
    this.scale.setAttribute("aria-label", this.#describe(own));
  }

  /** Bands that move with the set-point. */
  #followAim(aim) {
    this.drawnAim = aim;
    const [low, high] = qualityLimits(this.spec.key, this.limits, aim);
    if (this.normal) this.#stretch(this.normal, low, high);
    const half = this.limits[this.spec.key]?.dead_band;
    if (this.deadBand) this.#stretch(this.deadBand, aim === null ? null : aim - half, aim === null ? null : aim + half);
  }

  #describe(own) {
    const texts = [`scale ${this.low} to ${this.high} ${this.spec.unit}`];
    for (const kind of ["warn", "trip"]) {
      const [low, high] = own[kind] ?? [null, null];
      if (low !== null) texts.push(`${kind} below ${low}`);
      if (high !== null) texts.push(`${kind} above ${high}`);
    }
    return `${this.spec.name}: ${texts.join(", ")}`;
  }

  #share(value) {
    return Math.min(100, Math.max(0, (100 * (value - this.low)) / (this.high - this.low)));
  }

  #band(kind) {
    const band = el("div", { className: `band ${kind}` });
    this.scale.append(band);
    return band;
  }

  #stretch(band, low, high) {
    const [from, to] = [this.#share(low ?? this.low), this.#share(high ?? this.high)];
    band.style.setProperty("--from", `${from}%`);
    band.style.setProperty("--share", `${Math.max(0, to - from)}%`);
  }

  #limit(kind, from, to, at) {
    this.#stretch(this.#band(kind), from, to);
    this.#label(at, kind);
  }

  #label(value, kind) {
    const label = el("span", { className: `tick ${kind}` }, String(value));
    label.style.setProperty("--at", `${this.#share(value)}%`);
    this.scale.append(label);
  }

  #mark(kind) {
    const mark = el("div", { className: `mark ${kind}`, hidden: true });
    this.scale.append(mark);
    return mark;
  }

  #point(mark, value) {
    mark.hidden = value === null || value === undefined;
    if (!mark.hidden) mark.style.setProperty("--at", `${this.#share(value).toFixed(2)}%`);
  }
}

/** Tiles of all quantities in `root`. */
export class Bars {
  constructor(root, limits) {
    this.bars = QUANTITIES.map((spec) => new Bar(spec, limits));
    root.replaceChildren(...this.bars.map((bar) => bar.tile));
  }

  /** Show one row, an object by column name, beside the programme's set-points. @param {Values} values @param {Programme?} programme */
  update(values, programme = null) {
    for (const bar of this.bars) bar.update(values[bar.spec.key] ?? null, values[bar.spec.aim] ?? null, /** @type {Values?} */ (programme)?.[bar.spec.key] ?? null);
  }
}
