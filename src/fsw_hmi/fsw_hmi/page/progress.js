// Progress of the weld: phase, where the tool is around the canister, length, time left.
import { el, setText, svg } from "./dom.js";
import { fixed, grouped, span, words } from "./format.js";
import { Stop } from "./stop.js";

const RADIUS = 20;
const TURN = 2 * Math.PI * RADIUS;

export class Progress {
  constructor() {
    this.path = svg("circle", { cx: 26, cy: 26, r: RADIUS, class: "path", "stroke-dasharray": "0 200" });
    this.tool = svg("circle", { cx: 26, cy: 26 - RADIUS, r: 4.5, class: "tool" });
    const ring = svg("svg", { viewBox: "0 0 52 52", class: "ring", "aria-hidden": "true" }, svg("circle", { cx: 26, cy: 26, r: RADIUS, class: "whole" }), this.path, this.tool);
    this.phase = el("strong", {}, "No programme");
    this.detail = el("span", { className: "detail" }, "");
    this.bar = el("progress", { max: 1, "aria-label": "Progress of the stop", hidden: true });
    this.stop = new Stop();
    this.root = el("section", { id: "progress", "aria-label": "Progress of the weld" }, ring, el("p", {}, this.phase, this.bar, this.detail));
  }

  /** Show the programme or, while the weld is stopped, how far the stop has come. @param {import("./live.js").LivePage} page */
  update(page) {
    const stop = this.stop.progress(page);
    this.bar.hidden = (stop?.share ?? null) === null;
    if (page.progress) this.#programme(page.progress);
    else if (!stop) setText(this.phase, "No programme");
    if (!stop) return;
    this.bar.value = Math.min(1, Math.max(0, stop.share ?? 0));
    setText(this.phase, stop.text);
    setText(this.detail, stop.detail);
    this.root.dataset.level = stop.level;
  }

  /** @param {Programme} programme */
  #programme({ state, phase, angle_deg: angle, length_mm: length, time_left_s: left, left: byHand }) {
    const state_ = state === "running" ? (byHand ? " (set-points by hand)" : "") : ` (${words(state)})`;
    setText(this.phase, `${words(phase) || words(state)}${phase ? state_ : ""}`);
    setText(this.detail, `${fixed(angle, 0)}° · ${grouped(length)} mm · ${span(left)} left`);
    this.root.dataset.level = state === "aborted" ? "high" : state === "held" || byHand ? "attention" : "";
    if (angle === null) return;
    // More than a turn is welded over: the ring stays full and the tool goes on.
    this.path.setAttribute("stroke-dasharray", `${(Math.min(Math.max(angle, 0), 360) / 360) * TURN} ${TURN}`);
    this.tool.setAttribute("transform", `rotate(${angle} 26 26)`);
  }
}
