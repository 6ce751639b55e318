// What was asked for: this page's requests with their answers, and everybody's last actions.
import { el, panel, renew, scroll, setShort } from "./dom.js";
import { clock } from "./format.js";

/** @type {Record<string, string>} */
const TEXT = { pending: "… pending", done: "✓ done", refused: "✕ refused",
    timed_out: "? timed out" };

export class Actions {
  constructor() {
    this.answer = el("p", { className: "answer", role: "status" });
    this.list = el("ol", { className: "actions" });
    this.root = panel("actions", "Last actions", this.answer,
        scroll("List of the last actions", this.list));
  }

  /**
   * What became of this page's last request; `outcome` is "pending" until there is an answer.
   * @param {string} text
   * @param {string} outcome
   */
  tell(text, outcome, message = "") {
    this.answer.dataset.outcome = outcome;
    setShort(this.answer, `${text}: ${TEXT[outcome]}${message ? `, ${message}` : ""}`);
  }

  update(/** @type {Action[]} */ actions) {
    const newest = [...actions].reverse();
    renew(this.list, JSON.stringify(newest), () => newest.map(entry));
  }
}

function entry(/** @type {Action} */ { server_s: serverS, who, action, outcome, message }) {
  const result = el("span", { className: "detail" },
      `${TEXT[outcome] ?? outcome}${message ? `, ${message}` : ""}`);
  return el("li", {}, el("time", {}, clock(serverS)),
      el("span", {}, `${who || "somebody"}: ${action} `, result));
}
