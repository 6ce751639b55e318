// Trends by uPlot, one below the other on one time axis.
import { el } from "./dom.js";
import { fixed } from "./format.js";
import { qualityLimits, quantity, TRENDS } from "./quantities.js";

const INK = "#1c1f22";
const GRID = { stroke: "#b3b8bc", width: 1 };
const FONT = "13px system-ui, sans-serif";
const DASHED = [6, 4];
const GAP_S = 0.55; // this long without a tick is drawn as a gap

/** Resolves when uPlot is there: the server may still be installing it, which delays nothing else. */
export const uPlotReady = new Promise((resolve, reject) => {
  const [css, script] = ["uPlot.min.css", "uPlot.iife.min.js"].map((name) => new URL(`uplot/${name}`, import.meta.url).href);
  document.head.append(el("link", { rel: "stylesheet", href: css }), el("script", { src: script, onload: resolve, onerror: reject }));
});

/** Lines of a trend: `{key, label, stroke, width, dash}`, keys as in the data. */
export const LINES = {
  value: (key) => ({ key, stroke: INK, width: 2 }),
  aim: (key) => ({ key, stroke: "#5a6268", width: 1.5, dash: [2, 3] }),
  edge: (key) => ({ key, stroke: "#7b848a", width: 1 }),
};

/** Columns of the quality limits along a trend; those of the depth follow its set-point. */
export function withQuality(columns, limits) {
  const extended = { ...columns };
  for (const key of TRENDS.filter((one) => limits[one]?.quality)) {
    const aims = columns[quantity(key).aim];
    const edge = (side) => Float64Array.from(aims, (aim) => qualityLimits(key, limits, aim)[side] ?? NaN);
    [extended[`${key}:low`], extended[`${key}:high`]] = [edge(0), edge(1)];
  }
  return extended;
}

/** The lines of quantity `key` in the live page. */
export function liveLines(key, limits) {
  const edges = limits[key]?.quality ? [LINES.edge(`${key}:low`), LINES.edge(`${key}:high`)] : [];
  return [...edges, LINES.aim(quantity(key).aim), LINES.value(key)];
}

export class Trends {
  /**
   * @param {HTMLElement} root
   * @param {any} options
   *
   * Options: `lines(key)` of a quantity; `label(time)` on the axis, and where, `splits(min, max)`; `zoom([from, to])`,
   * called when a range is drawn with the mouse, without it there is no zoom; `overlay(uplot, key)` draws on top.
   */
  constructor(root, options) {
    this.options = options;
    this.charts = [];
    this.resizer = new ResizeObserver(() => this.charts.forEach((one) => this.#fit(one)));
    uPlotReady.then(() => this.#begin(root), () => root.append(el("p", { className: "panel" }, "No trends: the server could not install uPlot, which draws them. What to do is in its log.")));
  }

  #begin(root) {
    if (!root.isConnected) return; // another weld has begun meanwhile
    this.charts = TRENDS.map((key, index) => this.#chart(root, key, index === TRENDS.length - 1));
    this.charts.forEach((one) => this.resizer.observe(one.plot));
    if (this.drawn) this.draw(...this.drawn);
  }

  /** Draw `columns` (arrays by key, `time_s` first) between two times; the scales hold `extra[key]`, too. */
  draw(columns, from, to, extra = {}) {
    this.drawn = [columns, from, to, extra]; // for charts that are made later
    for (const one of this.charts) {
      const range = extent(one.scaled.map((key) => columns[key]), columns.time_s, from, to);
      one.scale = verticalScale(one.spec, Math.min(range[0], ...(extra[one.key] ?? [])), Math.max(range[1], ...(extra[one.key] ?? [])));
      one.uplot.setData([columns.time_s, ...one.keys.map((key) => columns[key])], false);
      one.uplot.setScale("x", { min: from, max: to });
    }
  }

  /** Draw what lies on top again. */
  redraw() {
    this.charts.forEach((one) => one.uplot.redraw(false));
  }

  destroy() {
    this.resizer.disconnect();
    this.charts.forEach((one) => one.uplot.destroy());
  }

  #chart(root, key, isLast) {
    const spec = quantity(key);
    const lines = this.options.lines(key);
    const reading = el("span", { className: "reading" });
    const plot = el("div", { className: "plot", role: "img", "aria-label": `Trend of ${spec.name.toLowerCase()} in ${spec.unit}` });
    const box = el("section", { className: `panel trend ${key}` }, el("h2", {}, `${spec.name} `, el("span", { className: "unit" }, spec.unit)), reading, plot);
    root.append(box);
    const one = { key, spec, plot, reading, keys: lines.map((line) => line.key), scale: [0, 1] };
    one.scaled = one.keys.filter((name) => !name.includes(":")); // distant limits would flatten what is measured
    one.uplot = new uPlot(this.#settings(one, lines, isLast), [[], ...lines.map(() => [])], plot);
    return one;
  }

  #settings(one, lines, isLast) {
    const { label, splits, zoom, overlay } = this.options;
    const axis = { stroke: INK, grid: GRID, ticks: { ...GRID, size: 4 }, font: FONT };
    return {
      width: 200,
      height: 100,
      padding: [9, 12, isLast ? 0 : 6, 0],
      legend: { show: false },
      cursor: { sync: { key: "weld" }, drag: { x: Boolean(zoom), y: false, setScale: false }, points: { show: false } },
      scales: { x: { time: false, auto: false }, y: { auto: true, range: () => one.scale } },
      axes: [
        { ...axis, size: isLast ? 26 : 0, values: (u, at) => at.map((time) => (isLast ? label(time, u) : "")), splits: (u, i, min, max) => splits(min, max) },
        { ...axis, size: 48, space: 28 },
      ],
      series: [{}, ...lines.map((line) => ({ ...line, points: { show: false }, gaps: findGaps }))],
      hooks: {
        draw: overlay ? [(u) => overlay(u, one.key)] : [],
        setCursor: [(u) => this.#read(one, u)],
        setSelect: zoom ? [(u) => this.#select(u, zoom)] : [],
      },
    };
  }

  #select(u, zoom) {
    const { left, width } = u.select;
    if (width < 4) return;
    u.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
    zoom([u.posToVal(left, "x"), u.posToVal(left + width, "x")]);
  }

  #read(one, u) {
    const index = u.cursor.idx;
    const at = index === null || index === undefined ? null : u.data[1 + one.keys.indexOf(one.keys.at(-1))][index];
    one.reading.textContent = at === null ? "" : `${this.options.label(u.data[0][index], u)}: ${fixed(at, one.spec.digits)}`;
  }

  #fit(one) {
    const { clientWidth: width, clientHeight: height } = one.plot;
    if (width && height) one.uplot.setSize({ width, height });
  }
}

/** Lowest and highest value of all lines between two times. */
function extent(columns, times, from, to) {
  let [low, high] = [Infinity, -Infinity];
  for (const column of columns) {
    for (let i = 0; i < column.length; i++) {
      const value = column[i];
      if (value === null || value === undefined || times[i] < from || times[i] > to) continue;
      if (value < low) low = value;
      if (value > high) high = value;
    }
  }
  return [low, high];
}

/** Smallest scale on the quantity's raster that holds two values. */
function verticalScale(/** @type {Spec} */ { step, span }, low, high) {
  if (low > high) return [0, span];
  const lacking = Math.max(0, span - (high - low)) / 2;
  const margin = lacking + 0.04 * Math.max(span, high - low);
  return [Math.floor((low - margin) / step) * step, Math.ceil((high + margin) / step) * step];
}

/** Gaps where ticks or values are missing, in pixels. */
function findGaps(u, seriesIndex, first, last) {
  const [times, values] = [u.data[0], u.data[seriesIndex]];
  const gaps = [];
  const add = (from, to) => gaps.push([u.valToPos(from, "x", true), u.valToPos(to, "x", true)]);
  for (let i = first + 1; i <= last; i++) {
    if (Number.isNaN(values[i]) || values[i] === null || times[i] - times[i - 1] > GAP_S) add(times[i - 1], times[i]);
  }
  return gaps;
}

/** Draw a dashed line of times and values on top of a chart, within its plotting area. */
export function drawLine(u, times, values, stroke = INK) {
  const { ctx, bbox } = u;
  ctx.save();
  ctx.beginPath();
  ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
  ctx.clip();
  ctx.beginPath();
  times.forEach((time, i) => ctx.lineTo(u.valToPos(time, "x", true), u.valToPos(values[i], "y", true)));
  ctx.strokeStyle = stroke;
  ctx.lineWidth = 2 * devicePixelRatio;
  ctx.setLineDash(DASHED.map((length) => length * devicePixelRatio));
  ctx.stroke();
  ctx.restore();
}

/** Draw an upright line at a time. */
export function drawTime(u, time, stroke, dash = []) {
  const { ctx, bbox } = u;
  const x = u.valToPos(time, "x", true);
  if (x < bbox.left || x > bbox.left + bbox.width) return;
  ctx.save();
  ctx.beginPath();
  ctx.moveTo(x, bbox.top);
  ctx.lineTo(x, bbox.top + bbox.height);
  ctx.strokeStyle = stroke;
  ctx.lineWidth = devicePixelRatio;
  ctx.setLineDash(dash);
  ctx.stroke();
  ctx.restore();
}
