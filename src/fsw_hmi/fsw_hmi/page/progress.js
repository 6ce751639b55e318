// Progress of the weld: phase, angle, length, time left; while it is stopped, how far the stop
// has come.
import { byId, setShort } from "./dom.js";
import { fixed, span, words } from "./format.js";
import { stopProgress } from "./stop.js";

export class Progress {
  root = byId("progress");
  phase = /** @type {HTMLElement} */ (document.querySelector("#progress strong"));
  bar = /** @type {HTMLProgressElement} */ (document.querySelector("#progress progress"));
  detail = /** @type {HTMLElement} */ (document.querySelector("#progress .detail"));

  update(/** @type {import("./live.js").LivePage} */ page) {
    const stop = stopProgress(page);
    const { level, text, detail } = stop ?? described(page.progress);
    this.bar.hidden = !stop || stop.share === null;
    this.bar.value = Math.min(1, Math.max(0, stop?.share ?? 0));
    this.root.dataset.level = level;
    setShort(this.phase, text);
    setShort(this.detail, detail);
  }
}

function described(/** @type {Programme?} */ programme) {
  if (!programme) return { level: "", text: "No programme", detail: "" };
  const { state, phase, angle_deg: angle, length_mm: length, time_left_s: timeLeft, left } =
      programme;
  const how = state === "running" ? (left ? " (set-points by hand)" : "") : ` (${words(state)})`;
  return {
    level: state === "aborted" || state === "silent" ? "high" : state === "held" || left
        ? "attention" : "",
    text: phase ? words(phase) + how : words(state),
    detail: `${fixed(angle, 0)}° · ${fixed(length, 0)} mm · ${span(timeLeft)} left`,
  };
}
