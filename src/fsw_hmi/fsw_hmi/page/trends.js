// Trends by uPlot, one below the other on one time axis.
import { el, setText } from "./dom.js";
import { fixed, known } from "./format.js";
import { normalRange, PAIRS, quantity, shown, TRENDS } from "./quantities.js";

const INK = "#1c1f22";
const GRID = { stroke: "#b3b8bc", width: 1 };
const BAND = "#7b848a66";
const DASHED = [6, 4];
const GAP_S = 0.55; // this long without a tick is drawn as a gap

/** Resolves when uPlot is there; nothing else waits for it. */
export const uPlotReady = new Promise((resolve, reject) => {
  const [css, script] = ["uPlot.min.css", "uPlot.iife.min.js"].map(
      (name) => new URL(`uplot/${name}`, import.meta.url).href);
  document.head.append(el("link", { rel: "stylesheet", href: css }),
      el("script", { src: script, onload: resolve, onerror: reject }));
});

/** @type {Record<"value" | "aim" | "edge" | "other", (key: string) => Line>} */
export const LINES = {
  value: (key) => ({ key, stroke: INK, width: 2 }),
  aim: (key) => ({ key, stroke: "#5a6268", width: 1.5, dash: [2, 3] }),
  edge: (key) => ({ key, stroke: "#7b848a", width: 1 }),
  other: (key) => ({ key, stroke: "#8a5a00", width: 1 }),
};

/**
 * Columns of the normal range along a trend, which may follow the set-point.
 * @param {Columns} columns
 * @param {Limits} limits
 * @returns {Columns}
 */
export function withNormal(columns, limits) {
  const extended = { ...columns };
  for (const key of TRENDS.filter((name) => limits[name]?.kept)) {
    const edges = Array.from(columns[quantity(key).aim] ?? columns[key],
        (aim) => normalRange(key, limits, aim));
    [extended[`${key}:low`], extended[`${key}:high`]] =
        [edges.map(([low]) => low), edges.map(([, high]) => high)];
  }
  return extended;
}

/** The lines of a quantity in the live page. @param {string} key @param {Limits} limits */
export function liveLines(key, limits) {
  const edges = limits[key]?.kept ? [LINES.edge(`${key}:low`), LINES.edge(`${key}:high`)] : [];
  const others = (limits[key]?.others ?? []).map(
      ({ key: column, name }) => ({ ...LINES.other(column), name }));
  const aims = quantity(key).aim ? [LINES.aim(quantity(key).aim)] : [];
  return [...edges, ...aims, ...others, LINES.value(key)];
}

export class Trends {
  /** @type {Chart[]} */ charts = [];
  /** @type {[Columns, number, number, Record<string, number[]>]?} */ #drawn = null;

  #pair = PAIRS[0];
  other = el("button", { type: "button", onclick: () => this.#swap() }); // shows the other pair

  /** @param {HTMLElement} root @param {Drawing} options */
  constructor(root, options) {
    this.root = root;
    this.options = options;
    this.resizer = new ResizeObserver(() => this.charts.forEach(fit));
    this.#named();
    root.addEventListener("keydown", (event) => this.#pan(event));
    uPlotReady.then(() => this.#begin(),
        () => root.append(el("p", { className: "panel" },
        "No trends: this page was built without uPlot, which draws them. What to do is in the server's log.")));
  }

  #begin() {
    if (!this.root.isConnected) return; // another weld has begun meanwhile
    this.charts = shown(this.#pair).map((key) => this.#chart(this.root, key));
    this.charts.forEach((chart) => this.resizer.observe(chart.plot));
    if (this.#drawn) this.draw(...this.#drawn);
  }

  /**
   * Draw columns between two times; the scales hold `extra[key]`, too.
   * @param {Columns} columns
   * @param {number} from
   * @param {number} to
   * @param {Record<string, number[]>} extra
   */
  draw(columns, from, to, extra = {}) {
    this.#drawn = [columns, from, to, extra]; // for charts that are made later
    for (const chart of this.charts) {
      chart.extra = extra[chart.key] ?? [];
      // sensors that there are
      const present = chart.named.filter(({ key }) =>
          Array.prototype.some.call(columns[key] ?? [], Number.isFinite));
      chart.unit.textContent = [chart.spec.unit, ...present.map(({ name }) => name)].join(", ");
      chart.uplot.setData(/** @type {import("uplot").AlignedData} */ (
          [columns.time_s, ...chart.keys.map((key) => columns[key])]), false);
      chart.uplot.setScale("x", { min: from, max: to });
    }
  }

  destroy() {
    this.resizer.disconnect();
    this.charts.forEach((chart) => chart.uplot.destroy());
    this.charts = [];
  }

  /** Show the other pair instead of this one. */
  #swap() {
    this.destroy();
    this.root.replaceChildren();
    this.#pair = /** @type {string[]} */ (PAIRS.find((pair) => pair !== this.#pair));
    this.#named();
    if (globalThis.uPlot) this.#begin();
  }

  #named() {
    const other = /** @type {string[]} */ (PAIRS.find((pair) => pair !== this.#pair));
    this.other.textContent = other.map((key) => quantity(key).name).join(", ");
  }

  /**
   * Arrows move the time axis by a quarter of its length, to the ends of the data.
   * @param {KeyboardEvent} event
   */
  #pan(event) {
    const share = { ArrowLeft: -0.25, ArrowRight: 0.25 }[event.key];
    if (share === undefined || !this.#drawn) return;
    event.preventDefault();
    const [, from, to] = this.#drawn;
    const [first, last] = this.options.ends();
    const shift = share * (to - from);
    const moved = share < 0 ? Math.max(shift, Math.min(0, first - from))
        : Math.min(shift, Math.max(0, last - to));
    if (moved) this.options.zoom([from + moved, to + moved]);
  }

  #chart(/** @type {HTMLElement} */ root, /** @type {string} */ key) {
    const spec = quantity(key);
    const lines = this.options.lines(key);
    const reading = el("span", { className: "reading" });
    const unit = el("span", { className: "unit" }, spec.unit);
    const plot = el("div", { className: "plot", role: "img", tabIndex: 0,
        "aria-label": `Trend of ${spec.name.toLowerCase()} in ${spec.unit}` });
    root.append(el("section", { className: `panel trend ${key}` },
        el("h2", {}, `${spec.name} `, unit), reading, plot));
    const chart = { key, spec, plot, reading, unit, named: lines.filter(({ name }) => name),
        keys: lines.map((line) => line.key), extra: [] };
    return Object.assign(chart, { uplot: new uPlot(
        this.#settings(chart, lines), [[], ...lines.map(() => [])], plot) });
  }

  /**
   * @param {Omit<Chart, "uplot">} chart
   * @param {Line[]} lines
   * @returns {import("uplot").Options}
   */
  #settings(chart, lines) {
    const { label, splits, incrs, zoom, overlay } = this.options;
    const axis = { stroke: INK, grid: GRID, ticks: { ...GRID, size: 4 },
        font: "13px system-ui, sans-serif" };
    const isLast = chart.key === this.#pair.at(-1);
    return {
      width: 200,
      height: 100,
      padding: [9, 12, isLast ? 0 : 6, 0],
      legend: { show: false },
      cursor: { sync: { key: "weld" }, drag: { x: true, y: false, setScale: false },
          points: { show: false } },
      scales: { x: { time: false, auto: false },
          y: { auto: true, range: (_, low, high) => verticalScale(chart, low, high) } },
      axes: [
        { ...axis, size: isLast ? 26 : 0, values: (_, at) => at.map((time) => (isLast ? label(time)
            : "")), ...(splits ? { splits: (_u, _i, min, max) => splits(min, max) } : { incrs }) },
        { ...axis, size: 48, space: 20, splits: (_u, _i, low, high, step) =>
            verticalSplits(low, high, step) },
      ],
      // distant limits would flatten what is measured
      series: [{}, ...lines.map((line) =>
          ({ ...line, auto: !line.key.includes(":"), points: { show: false }, gaps: addGaps }))],
      hooks: {
        draw: [(u) => overlay(u, chart.key), (u) => this.#read(chart, u)],
        setCursor: [(u) => this.#read(chart, u)],
        setSelect: [(u) => select(u, zoom)],
      },
    };
  }

  /**
   * The value under the cursor, also where the curve has moved below it.
   * @param {Omit<Chart, "uplot">} chart
   * @param {Plot} u
   */
  #read(chart, u) {
    const left = u.cursor.left ?? -1;
    const index = left < 0 ? -1 : u.posToIdx(left);
    const timeS = u.data[0][index];
    const value = u.data[chart.keys.length][index];
    const isThere = known(value) && Math.abs(timeS - u.posToVal(left, "x")) < GAP_S;
    setText(chart.reading, isThere
        ? `${this.options.label(timeS)}: ${fixed(value, chart.spec.digits)}` : "");
  }
}

/** @param {Plot} u @param {(range: [number, number]) => void} zoom */
function select(u, zoom) {
  const { left, width } = u.select;
  if (width < 4) return;
  u.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
  zoom([u.posToVal(left, "x"), u.posToVal(left + width, "x")]);
}

function fit(/** @type {Chart} */ { uplot, plot: { clientWidth: width, clientHeight: height } }) {
  if (width && height) uplot.setSize({ width, height });
}

/**
 * Smallest scale on the quantity's raster that holds two values, and what is drawn beside them.
 * @param {Omit<Chart, "uplot">} chart
 * @param {Value} low
 * @param {Value} high
 * @returns {[number, number]}
 */
function verticalScale({ spec: { step, span }, extra }, low, high) {
  const [least, most] = [Math.min(low ?? Infinity, ...extra),
      Math.max(high ?? -Infinity, ...extra)];
  if (!(least <= most)) return [0, span];
  const margin = Math.max(0, span - (most - least)) / 2 + 0.04 * Math.max(span, most - least);
  return [Math.floor((least - margin) / step) * step, Math.ceil((most + margin) / step) * step];
}

/**
 * Where a vertical axis is labelled: at multiples of the step, or at its ends where there is only
 * one.
 * @param {number} low
 * @param {number} high
 * @param {number} step
 */
function verticalSplits(low, high, step) {
  const [first, last] = [Math.ceil(low / step - 1e-9), Math.floor(high / step + 1e-9)];
  return last > first ? Array.from({ length: last - first + 1 }, (_, i) => (first + i) * step)
      : [low, high];
}

/**
 * Gaps where ticks are missing, beside those of missing values.
 * @param {Plot} u
 * @param {number} _
 * @param {number} first
 * @param {number} last
 * @param {[number, number][]} gaps
 */
function addGaps(u, _, first, last, gaps) {
  const times = u.data[0];
  for (let i = first + 1; i <= last; i++) {
    if (times[i] - times[i - 1] > GAP_S) gaps.push(
        [u.valToPos(times[i - 1], "x", true), u.valToPos(times[i], "x", true)]);
  }
  return gaps.sort(([a], [b]) => a - b);
}

/**
 * Draw a path on top of a chart, within its plotting area.
 * @param {Plot} u
 * @param {number[]} times
 * @param {number[]} values
 * @param {() => void} paint
 */
function drawPath({ ctx, bbox, valToPos }, times, values, paint) {
  ctx.save();
  ctx.beginPath();
  ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
  ctx.clip();
  ctx.beginPath();
  times.forEach((time, i) => ctx.lineTo(
      valToPos(time, "x", true), valToPos(values[i], "y", true)));
  paint();
  ctx.restore();
}

/** @param {Plot} u @param {number[]} times @param {number[]} values */
export function drawLine(u, times, values, stroke = INK, width = 2, dash = DASHED) {
  drawPath(u, times, values, () => {
    u.ctx.strokeStyle = stroke;
    u.ctx.lineWidth = width * devicePixelRatio;
    u.ctx.setLineDash(dash.map((length) => length * devicePixelRatio));
    u.ctx.stroke();
  });
}

/**
 * Shade so many standard deviations about a prediction that tells them.
 * @param {Plot} u
 * @param {Ahead} ahead
 * @param {string} key
 * @param {number} sigmas
 */
export function drawBand(u, { time_s: times, ...ahead }, key, sigmas) {
  const values = ahead[key] ?? [];
  const deviations = ahead[`${key}:deviation`] ?? [];
  if (deviations.length !== times.length || values.length !== times.length) return;
  const edge = (/** @type {number} */ sign) =>
      values.map((value, i) => value + sign * sigmas * deviations[i]);
  drawPath(u, [...times, ...[...times].reverse()], [...edge(1), ...edge(-1).reverse()], () => {
    u.ctx.fillStyle = BAND;
    u.ctx.fill();
  });
}

/**
 * Draw an upright line at a time.
 * @param {Plot} u
 * @param {number} time
 * @param {string} stroke
 * @param {number[]} dash
 */
export function drawTime(u, time, stroke, dash = []) {
  drawLine(u, [time, time], [u.scales.y.min ?? 0, u.scales.y.max ?? 0], stroke, 1, dash);
}
