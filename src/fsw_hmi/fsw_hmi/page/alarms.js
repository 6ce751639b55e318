// The alarms: priority, state, first-out, what to do, acknowledge.
import { byId, el, panel, renew, setText } from "./dom.js";
import { clock } from "./format.js";
import { byUrgency } from "./verdict.js";

const SIGN = { high: "■", medium: "▲", low: "●" };
const STATE = { active: "not acknowledged", acknowledged: "acknowledged", cleared: "gone, not acknowledged" };
const needsAcknowledging = (alarm) => alarm.state !== "acknowledged";

export class Alarms {
  #told = new Set();

  /** @param acknowledge `(ids)`, null where nothing can be acknowledged */
  constructor(acknowledge) {
    this.acknowledge = acknowledge;
    this.list = el("ol", { className: "alarms" });
    this.count = el("span", { className: "count" });
    this.all = el("button", { type: "button", onclick: () => acknowledge(this.waiting) }, "Acknowledge all");
    this.root = panel("alarms", "Alarms ", el("div", { className: "scroll", tabIndex: 0, role: "region", "aria-label": "List of alarms" }, this.list));
    this.root.firstChild.append(this.count);
    this.root.firstChild.after(this.all);
    this.update([]);
  }

  update(alarms) {
    const ordered = byUrgency(alarms);
    this.waiting = ordered.filter(needsAcknowledging).map((alarm) => alarm.id);
    setText(this.count, ordered.length ? `${ordered.length}, ${this.waiting.length} to acknowledge` : "none");
    this.all.hidden = this.waiting.length === 0;
    const focused = /** @type {HTMLElement?} */ (document.activeElement)?.dataset.alarm;
    renew(this.list, JSON.stringify(ordered), () => ordered.map((alarm) => this.#entry(alarm)));
    if (focused) /** @type {HTMLElement?} */ (this.list.querySelector(`[data-alarm="${CSS.escape(focused)}"]`))?.focus();
    this.#announce(ordered);
  }

  #entry(alarm) {
    const { id, text, advice, priority, state, first_out: first, raised_s: raised } = alarm;
    const entry = el(
      "li",
      { className: `alarm ${priority} ${state}` },
      el("span", { className: "sign", "aria-hidden": "true" }, SIGN[priority]),
      el(
        "div",
        {},
        el("strong", {}, text),
        el("span", { className: "detail" }, `${priority} · ${STATE[state]}${first ? " · first out" : ""} · ${clock(raised)}`),
        ...(advice ? [el("span", { className: "advice" }, advice)] : []),
      ),
    );
    if (needsAcknowledging(alarm)) {
      const button = el("button", { type: "button", "aria-label": `Acknowledge: ${text}`, onclick: () => this.acknowledge([id]) }, "Ack");
      button.dataset.alarm = id;
      entry.append(button);
    }
    return entry;
  }

  /** Say only what is new: a list read out again at every change would be noise. */
  #announce(alarms) {
    const present = alarms.filter((alarm) => alarm.state === "active");
    const fresh = present.filter((alarm) => !this.#told.has(alarm.id));
    this.#told = new Set(present.map((alarm) => alarm.id));
    if (fresh.length) byId("announce-alarms").textContent = fresh.map((alarm) => `${alarm.priority} alarm: ${alarm.text}`).join(". ");
  }
}
