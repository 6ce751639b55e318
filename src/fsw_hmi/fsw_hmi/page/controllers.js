// Health of the controllers.
import { el, panel, renew, scroll, setText } from "./dom.js";
import { fixed } from "./format.js";

const HEADS = ["", "state", "ms (max)", "missed, late, rej."];

export class Controllers {
  constructor() {
    this.rows = el("tbody");
    this.notes = el("ul", { className: "notes" });
    this.timing = el("span", { className: "timing detail" }, "–");
    const head = el("tr", {}, ...HEADS.map((text) => el("th", { scope: "col" }, text || el("span", { className: "hidden" }, "controller"))));
    this.root = panel("controllers", "Controllers", scroll("Health of the controllers", el("table", {}, el("thead", {}, head), this.rows), this.notes));
    this.root.firstElementChild?.append(" ", this.timing);
  }

  update(/** @type {State} */ state) {
    renew(this.rows, JSON.stringify([state.controllers, state.actual_controller]), () => state.controllers.map((one) => row(one, state)));
    const notes = state.controllers.filter((one) => one.reason).map((one) => `${one.inhibited ? "■" : "▲"} ${one.name}: ${one.reason}`);
    renew(this.notes, JSON.stringify(notes), () => notes.map((text) => el("li", { title: text }, text)));
  }

  time(/** @type {Values} */ { solve_ms: solveMs, latency_ms: latencyMs }) {
    setText(this.timing, `latency ${fixed(latencyMs, 0)} ms · solve ${fixed(solveMs, 0)} ms`);
  }
}

function row(/** @type {Health} */ one, /** @type {State} */ state) {
  const commands = one.name === state.actual_controller && state.actual_mode === "auto";
  const status = one.inhibited ? "inhibited" : !one.healthy ? "fails" : one.ready ? "ready" : "not ready";
  const cells = [commands && status === "ready" ? "commands" : status, `${fixed(one.latency_ms, 0)} (${fixed(one.latency_max_ms, 0)})`, `${one.missed}, ${one.late}, ${one.rejected}`];
  const level = one.inhibited || !one.healthy ? "medium" : "";
  return el("tr", { "data-level": level }, el("th", { scope: "row" }, one.name), ...cells.map((text) => el("td", {}, text)));
}
