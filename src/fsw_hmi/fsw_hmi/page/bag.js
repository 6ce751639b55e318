// The page over recorded welds: scrub, play, zoom; two of them are drawn over each other.
import { Bars } from "./bars.js";
import { byId, el, panel, scroll, setText } from "./dom.js";
import { clock, NONE, SIGN, span, words } from "./format.js";
import { Player } from "./player.js";
import { drawTime, LINES, liveLines, Trends, uPlotReady, withNormal } from "./trends.js";
import { WeldMap } from "./weld_map.js";

const SECOND = "#1f5f9e";
const STEPS_S = [1, 2, 5, 10, 20, 30, 60, 120, 300, 600, 1200, 3600];

export async function startBag() {
  const title = el("p", {}, el("strong", {}, "Reading"));
  byId("status").replaceChildren(el("section", {}, title));
  try {
    /** @type {{bags: Weld[], limits: Limits}} */ const { bags, limits } = await get("bags");
    const welds = await Promise.all(bags.map(
        async (bag) => ({ ...bag, ...(await get(`bags/${bag.n}`)) })));
    await uPlotReady.catch(() => {});
    byId("status").replaceChildren();
    new BagPage(welds, limits);
  } catch (error) {
    title.replaceChildren(el("strong", {},
        `The bag cannot be read: ${/** @type {Error} */ (error).message}`));
  }
}

async function get(/** @type {string} */ path) {
  const answer = await fetch(path);
  if (!answer.ok) throw new Error(`${path}: ${await answer.text()}`);
  return answer.json();
}

class BagPage {
  who = el("strong");
  phase = el("strong");
  time = el("strong", { className: "time" });
  whole = el("button", { type: "button", onclick: () => this.#zoom([0, this.durationS]) },
      "Whole weld");
  timeS = 0;

  constructor(/** @type {Weld[]} */ welds, /** @type {Limits} */ limits) {
    this.welds = welds;
    this.limits = limits;
    this.first = welds[0];
    this.durationS = Math.max(...welds.map((weld) => weld.duration_s));
    /** @type {[number, number]} */ this.range = [0, this.durationS];
    this.columns = overlaid(welds, limits);
    this.#head();
    byId("side").append(this.#problems(), this.#events());
    this.bars = new Bars(byId("values"), limits);
    this.#plots();
    const map = new WeldMap(byId("map"), this.first.columns, (timeS) => this.player?.seek(timeS),
        span, welds.length > 1 ? this.first.name : "");
    map.add(this.first.rows);
    map.judged(this.first.account.marks);
    map.draw();
    this.player = new Player(byId("foot"), this.durationS, this.first.events,
        (timeS) => this.#show(timeS));
    this.#zoom(this.range);
  }

  #head() {
    const part = (/** @type {Node[]} */ ...texts) => el("section", {}, el("p", {}, ...texts));
    const names = this.welds.map((weld) => weld.name).join(" and ");
    const judged = this.welds.map(({ account }) => `${SIGN[account.level]} ${account.text}`).join(
        ", ");
    const start = this.first.start_s === null ? "simulated time"
        : `began ${new Date(this.first.start_s * 1000).toISOString().slice(0, 10)} ${clock(this.first.start_s)} UTC`;
    byId("status").append(
      part(el("strong", {}, `Recorded: ${names}`), el("span",
          { className: "detail", title: judged }, `${judged}; ${start}; no commands here`)),
      part(this.who, el("span", { className: "detail" }, `values of ${this.first.name}`)),
      part(this.phase, el("span", { className: "detail" }, "phase")),
      part(this.time, el("span", { className: "detail" }, "time in the weld")),
    );
  }

  #problems() {
    const all = this.welds.flatMap((weld) =>
        weld.problems.map((text) => el("li", {}, `▲ ${weld.name}: ${text}`)));
    const made = panel("problems", "Problems",
        scroll("List of the problems", el("ul", { className: "notes" }, ...all)));
    made.hidden = all.length === 0;
    return made;
  }

  #events() {
    const all = this.welds.flatMap((weld) => weld.events.map(
        (event) => ({ ...event, of: weld.name }))).sort((a, b) => a.time_s - b.time_s);
    const entry = (/** @type {typeof all[0]} */ event) =>
        el("li", {}, el("button", { type: "button", className: "event",
        onclick: () => this.player?.seek(event.time_s) }, el("time", {}, span(event.time_s)),
        ` ${this.welds.length > 1 ? `${event.of}: ` : ""}${event.text}`));
    return panel("events", "Events ", scroll(
        "List of the events", el("ol", {}, ...all.map(entry))));
  }

  #plots() {
    const key = (/** @type {string} */ kind, /** @type {string} */ text) =>
        el("li", {}, el("span", { className: `key ${kind}` }), text);
    const names = this.welds.map((weld, i) => key(i ? "second" : "measured", weld.name));
    const plots = el("div", { className: "plots" });
    const bar = el("div", { className: "toolbar" }, this.whole);
    byId("trends").append(bar, plots);
    const second = (/** @type {string} */ name) => (this.welds.length > 1
        ? [{ ...LINES.value(`${name}#1`), stroke: SECOND, dash: [7, 3] }] : []);
    this.trends = new Trends(plots, {
      lines: (name) => [...second(name), ...liveLines(name, this.limits)],
      label: span,
      incrs: STEPS_S,
      zoom: (range) => this.#zoom(range),
      ends: () => [0, this.durationS],
      overlay: (u) => {
        for (const event of this.first.events) drawTime(u, event.time_s, "#8d959a", [2, 3]);
        drawTime(u, this.timeS, "#000");
      },
    });
    bar.append(this.trends.other, el("span", { className: "detail" }, "drag in a trend to zoom"),
        el("ul", { className: "legend" }, ...names));
  }

  #zoom(/** @type {[number, number]} */ [from, to]) {
    this.range = [Math.max(0, from), Math.min(this.durationS, to)];
    this.whole.disabled = this.range[0] === 0 && this.range[1] === this.durationS;
    this.trends?.draw(this.columns, ...this.range);
  }

  #show(/** @type {number} */ timeS) {
    this.timeS = timeS;
    const row = this.first.rows.findLast((sample) => sample[0] <= timeS + 1e-6)
        ?? this.first.rows[0] ?? [];
    const values = Object.fromEntries(this.first.columns.map((name, i) => [name, row[i] ?? null]));
    this.bars?.update(values, /** @type {Flags} */ (
        row[this.first.columns.indexOf("flags")] ?? {}));
    setText(this.who, [values.controller, words(values.mode)].filter(Boolean).join(" · ") || NONE);
    setText(this.phase, words(values.phase) || NONE);
    setText(this.time, span(timeS));
    const [from, to] = this.range;
    if (timeS < from || timeS > to) this.#zoom([timeS, timeS + to - from]);
    else this.trends?.charts.forEach(({ uplot }) => uplot.redraw(false));
  }
}

/** Columns by name; those of the second weld carry `#1`, all on one time axis. */
function overlaid(/** @type {Weld[]} */ welds, /** @type {Limits} */ limits) {
  const tables = welds.map((weld, n) => {
    /** @type {Columns} */
    const columns = Object.fromEntries(weld.columns.map(
        (name, i) => [name, weld.rows.map((row) => row[i])]));
    return n ? Object.fromEntries(Object.entries(columns).map(
        ([name, values]) => [`${name}#${n}`, values])) : withNormal(columns, limits);
  });
  if (tables.length === 1 || !globalThis.uPlot) return tables[0];
  const joined = uPlot.join(tables.map(
      (table) => /** @type {import("uplot").AlignedData} */ (Object.values(table))));
  const names = ["time_s", ...tables.flatMap((table) => Object.keys(table).slice(1))];
  return Object.fromEntries(names.map((name, i) => [name, /** @type {Value[]} */ (joined[i])]));
}
