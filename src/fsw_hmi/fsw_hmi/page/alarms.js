// The alarms: priority, state, what came first, what follows, what to do; acknowledge, shelve.
import { choiceField, openForm, textField } from "./dialog.js";
import { byId, el, panel, renew, setText } from "./dom.js";
import { clock } from "./format.js";

const SIGN = { high: "■", medium: "▲", low: "●" };
const STATE = { active: "not acknowledged", acknowledged: "acknowledged", cleared: "gone, not acknowledged", shelved: "shelved" };
const SHELVES_MIN = [5, 20, 60];
const needsAcknowledging = (alarm) => alarm.state === "active" || alarm.state === "cleared";

export class Alarms {
  #told = new Set();

  /** @param acknowledge `(ids)` @param ask `(text, request, fields)`, resolves to its answer */
  constructor(acknowledge, ask) {
    this.acknowledge = acknowledge;
    this.ask = ask;
    this.list = el("ol", { className: "alarms" });
    this.count = el("span", { className: "count" });
    this.all = el("button", { type: "button", onclick: () => acknowledge(this.waiting) }, "Acknowledge all");
    this.reach = el("p", { className: "reach detail" });
    this.root = panel("alarms", "Alarms ", el("div", { className: "scroll", tabIndex: 0, role: "region", "aria-label": "List of alarms" }, this.reach, this.list));
    this.root.firstChild.append(this.count);
    this.root.firstChild.after(this.all);
    this.update([]);
  }

  /** @param {any[]} alarms in the order to be shown @param {{ok: boolean, text: string}?} reach whether commands reach the machine */
  update(alarms, reach = null) {
    this.waiting = alarms.filter(needsAcknowledging).map((alarm) => alarm.id);
    setText(this.count, alarms.length ? `${alarms.length}, ${this.waiting.length} to acknowledge` : "none");
    this.all.hidden = this.waiting.length === 0;
    this.reach.hidden = !reach?.text || reach.ok === false; // what is wrong is an alarm
    setText(this.reach, reach?.text ? `${reach.ok ? "✓ " : ""}${reach.text}` : "");
    const focused = /** @type {HTMLElement?} */ (document.activeElement)?.dataset.alarm;
    renew(this.list, JSON.stringify(alarms), () => alarms.map((alarm) => this.#entry(alarm)));
    if (focused) /** @type {HTMLElement?} */ (this.list.querySelector(`[data-alarm="${CSS.escape(focused)}"]`))?.focus();
    this.#announce(alarms);
  }

  #entry(alarm) {
    const { text, consequence, advice, priority, state } = alarm;
    const lines = [[detail(alarm), "detail"], [[consequence, advice].filter(Boolean).join(". "), "advice"]];
    return el(
      "li",
      { className: `alarm ${priority} ${state}` },
      el("span", { className: "sign", "aria-hidden": "true" }, SIGN[priority]),
      el("div", {}, el("strong", {}, text), ...lines.map(([line, className]) => el("span", { className }, line))),
      el("div", { className: "acts" }, ...this.#buttons(alarm)),
    );
  }

  #buttons(alarm) {
    const { id, text, priority, state } = alarm;
    const button = (name, label, onclick) => {
      const made = el("button", { type: "button", "aria-label": `${label}: ${text}`, onclick }, name);
      made.dataset.alarm = `${name} ${id}`;
      return made;
    };
    if (state === "shelved") return [button("Back", "Back", () => this.ask("Take an alarm back", "unshelve", { alarm: id }))];
    const shelve = priority === "high" ? [] : [button("Shelve", "Shelve", () => this.#shelve(alarm))];
    return needsAcknowledging(alarm) ? [button("Ack", "Ack", () => this.acknowledge([id])), ...shelve] : shelve;
  }

  #shelve({ id, text }) {
    const minutes = choiceField("For", SHELVES_MIN.map((one) => ({ value: String(one), text: `${one} min` })), String(SHELVES_MIN[0]));
    const reason = textField("Why");
    openForm({
      title: "Shelve an alarm",
      fields: [minutes, reason],
      summary: () => `${text}: out of the way for ${minutes.value} min. It comes back by itself.`,
      confirm: "Shelve",
      run: () => this.ask("Shelve an alarm", "shelve", { alarm: id, minutes: Number(minutes.value), reason: reason.value }),
    });
  }

  /** Say only what is new: a list read out again at every change would be noise. */
  #announce(alarms) {
    const present = alarms.filter((alarm) => alarm.state === "active");
    const key = (alarm) => `${alarm.id} ${alarm.count}`;
    const fresh = present.filter((alarm) => !this.#told.has(key(alarm)));
    this.#told = new Set(present.map(key));
    if (fresh.length) byId("announce-alarms").textContent = fresh.map((alarm) => `${alarm.priority} alarm: ${alarm.text}`).join(". ");
  }
}

/** One line: when, how urgent, how it stands, what it had to do with a trip. */
function detail({ priority, state, count, chatters, first_out: firstOut, first, text, raised_s: raised, shelved, shelved_until_s: until }) {
  const parts = [clock(raised), priority, state === "shelved" ? `shelved until ${clock(until)} by ${shelved}` : STATE[state]];
  if (count > 1) parts.push(`${count} times`);
  if (chatters) parts.push("comes and goes");
  if (firstOut) parts.push("first out");
  if (first && first !== text) parts.push(`first: ${first}`);
  return parts.join(" · ");
}
