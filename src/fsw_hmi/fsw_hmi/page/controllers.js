// Health of the controllers.
import { el, panel, renew, scroll, setText } from "./dom.js";
import { fixed } from "./format.js";

const HEADS = ["", "state", "ms (max)", "missed, late, rej."];

export class Controllers {
  constructor() {
    this.rows = el("tbody");
    this.notes = el("ul", { className: "notes" });
    this.timing = el("span", { className: "timing detail" }, "–");
    const head = el("tr", {}, ...HEADS.map((text) =>
        el("th", { scope: "col" }, text || el("span", { className: "hidden" }, "controller"))));
    this.root = panel("controllers", "Controllers", scroll("Health of the controllers",
        el("table", {}, el("thead", {}, head), this.rows), this.notes));
    this.root.firstElementChild?.append(" ", this.timing);
  }

  update(/** @type {State} */ state) {
    renew(this.rows, JSON.stringify([state.controllers, state.actual_controller]),
        () => state.controllers.map((controller) => row(controller, state)));
    const notes = state.controllers.filter((controller) => controller.reason).map((controller) =>
        `${controller.inhibited ? "■" : "▲"} ${controller.name}: ${controller.reason}`);
    renew(this.notes, JSON.stringify(notes),
        () => notes.map((text) => el("li", { title: text }, text)));
  }

  time(/** @type {Values} */ { solve_ms: solveMs, latency_ms: latencyMs }) {
    setText(this.timing, `latency ${fixed(latencyMs, 0)} ms · solve ${fixed(solveMs, 0)} ms`);
  }
}

function row(/** @type {Health} */ controller, /** @type {State} */ state) {
  const commands = controller.name === state.actual_controller && state.actual_mode === "auto";
  const status = controller.inhibited ? "inhibited" : !controller.healthy ? "fails"
      : controller.ready ? "ready" : "not ready";
  const cells = [commands && status === "ready" ? "commands" : status,
      `${fixed(controller.latency_ms, 0)} (${fixed(controller.latency_max_ms, 0)})`,
      `${controller.missed}, ${controller.late}, ${controller.rejected}`];
  const level = controller.inhibited || !controller.healthy ? "medium" : "";
  return el("tr", { "data-level": level }, el("th", { scope: "row" }, controller.name),
      ...cells.map((text) => el("td", {}, text)));
}
