// What was asked for: this page's requests with their answers, and everybody's last actions.
import { el, panel, renew } from "./dom.js";
import { clock } from "./format.js";

const SIGN = { pending: "…", done: "✓", refused: "✕", timed_out: "?" };
const TEXT = { pending: "pending", done: "done", refused: "refused", timed_out: "timed out" };

export class Actions {
  constructor() {
    this.answer = el("p", { className: "answer", role: "status" });
    this.list = el("ol", { className: "actions" });
    this.root = panel("actions", "Last actions", this.answer, el("div", { className: "scroll", tabIndex: 0, role: "region", "aria-label": "List of the last actions" }, this.list));
  }

  /** What became of this page's last request; `outcome` is "pending" until there is an answer. */
  tell(text, outcome, message = "") {
    this.answer.dataset.outcome = outcome;
    this.answer.textContent = `${SIGN[outcome]} ${text}: ${TEXT[outcome]}${message ? `, ${message}` : ""}`;
  }

  update(actions) {
    const newest = [...actions].reverse();
    renew(this.list, JSON.stringify(newest), () => newest.map(entry));
  }
}

function entry({ server_s: serverS, who, action, outcome, message }) {
  return el(
    "li",
    {},
    el("time", {}, clock(serverS)),
    el("span", {}, `${SIGN[outcome] ?? ""} ${who || "somebody"}: ${action}`),
    el("span", { className: "detail" }, `${TEXT[outcome] ?? outcome}${message ? `, ${message}` : ""}`),
  );
}
