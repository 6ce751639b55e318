// The alarms, two lines each, one where it is gone; of the one that is open also what follows and
// what to do.
import { choiceField, openForm, textField } from "./dialog.js";
import { byId, el, panel, renew, scroll, setShort, setText } from "./dom.js";
import { clock, SIGN } from "./format.js";

const SHELVES_MIN = [5, 20, 60];
const needsAcknowledging = (/** @type {Alarm} */ { state }) => state === "active"
    || state === "cleared";

export class Alarms {
  /** @type {Set<string>} */ #announced = new Set();
  #newest = 0; // number of the newest alarm of the list
  // whose id was chosen; null: the headline's, else the first is open
  /** @type {string?} */ #opened = null;
  /** @type {[Alarm[], Reach | null, string | undefined]} */ #latest = [[], null, ""];

  /** @param {import("./command.js").Commands} commands */
  constructor(commands) {
    this.commands = commands;
    this.list = el("ol", { className: "alarms" });
    this.count = el("span", { className: "count" });
    this.reach = el("p", { className: "reach detail" });
    this.all = el("button", { type: "button",
        onclick: () => commands.acknowledgeAll(this.#newest) }, "Ack all");
    this.root = panel("alarms", "Alarms ", this.reach, this.all,
        scroll("List of alarms", this.list));
    this.root.firstElementChild?.append(this.count);
  }

  /**
   * @param {Alarm[]} alarms in the order to be shown
   * @param {Reach | null} reach whether commands reach the machine
   * @param {string} [first] the one that the headline is of
   */
  update(alarms, reach, first) {
    this.#latest = [alarms, reach, first];
    const { lack } = this.commands;
    const waiting = alarms.filter(needsAcknowledging).length;
    this.#newest = Math.max(0, ...alarms.map(({ number }) => number));
    setText(this.count, alarms.length ? `${alarms.length}, ${waiting} to acknowledge` : "none");
    this.all.disabled = Boolean(lack) || !waiting;
    this.all.title = lack || (waiting ? "" : "nothing is to be acknowledged");
    // what is wrong is an alarm
    const reaches = reach?.text && reach.ok !== false ? `${reach.ok ? "✓ " : ""}${reach.text}`
        : "";
    setShort(this.reach, [reaches, lack && alarms.length ? "Ack and Shelve need control."
        : ""].filter(Boolean).join(" · "));
    const focused = /** @type {HTMLElement?} */ (document.activeElement)?.dataset.alarm;
    const opened = alarms.find(({ id }) => id === this.#opened)
        ?? (this.#opened === "" ? null : (alarms.find(({ id }) => id === first) ?? alarms[0]));
    renew(this.list, JSON.stringify([alarms, lack, opened?.id]),
        () => alarms.map((alarm) => this.#entry(alarm, alarm === opened)));
    if (focused) /** @type {HTMLElement?} */ (
        this.list.querySelector(`[data-alarm="${CSS.escape(focused)}"]`))?.focus();
    this.#announce(alarms);
  }

  /** @param {Alarm} alarm @param {boolean} open */
  #entry(alarm, open) {
    const { id, text, what: head, why, consequence, advice, priority, state } = alarm;
    const details = detail(alarm, open);
    const what = el("span", { className: "what" },
        el("span", { className: "text", title: text }, el("strong", { title: head }, head),
        why ? `: ${why}` : ""), " ", el("span", { className: "detail", title: details }, details));
    const summary = el("summary", { "data-alarm": id,
        onclick: (/** @type {Event} */ event) => this.#open(event, open ? "" : id) },
        el("span", { className: "sign", "data-sign": SIGN[priority] }), what);
    return el("li", { className: `alarm ${priority} ${state}` },
        el("details", { open }, summary, el("p", {}, `${consequence} → ${advice}`)),
        el("div", { className: "acts" }, ...this.#buttons(alarm, open)));
  }

  #open(/** @type {Event} */ event, /** @type {string} */ id) {
    event.preventDefault();
    this.#opened = id;
    this.update(...this.#latest);
  }

  /** @param {Alarm} alarm @param {boolean} open */
  #buttons(alarm, open) {
    const { id, text, priority, state } = alarm;
    const { lack } = this.commands;
    const button = (/** @type {string} */ name, /** @type {() => void} */ onclick) => {
      const labels = { "aria-label": `${name}: ${text}`, "data-alarm": `${name} ${id}` };
      return el("button", { type: "button", ...labels, disabled: Boolean(lack), title: lack,
          onclick }, name);
    };
    if (state === "shelved") return [button(
        "Back", () => this.commands.ask("Take an alarm back", "unshelve", { alarm: id }))];
    const shelve = priority === "high" || !open ? []
        : [button("Shelve", () => this.#shelve(alarm))];
    return needsAcknowledging(alarm) ? [
        button("Ack", () => this.commands.acknowledge(id)), ...shelve] : shelve;
  }

  #shelve(/** @type {Alarm} */ { id, text }) {
    const minutes = choiceField("For", SHELVES_MIN.map((duration) =>
        ({ value: String(duration), text: `${duration} min` })), String(SHELVES_MIN[0]));
    const reason = textField("Why");
    openForm({
      title: "Shelve an alarm",
      fields: [minutes, reason],
      summary: () => `${text}: out of the way for ${minutes.value} min. It comes back by itself.`,
      confirm: "Shelve",
      run: () => this.commands.ask("Shelve an alarm", "shelve",
          { alarm: id, minutes: Number(minutes.value), reason: reason.value }),
    });
  }

  /** Say only what is new: a list read out again at every change would be noise. */
  #announce(/** @type {Alarm[]} */ alarms) {
    const present = alarms.filter((alarm) => alarm.state === "active");
    const key = (/** @type {Alarm} */ alarm) => `${alarm.id} ${alarm.count}`;
    const fresh = present.filter((alarm) => !this.#announced.has(key(alarm)));
    this.#announced = new Set(present.map(key));
    if (fresh.length) byId("announce-alarms").textContent =
        fresh.map((alarm) => `${alarm.priority} alarm: ${alarm.text}`).join(". ");
  }
}

/**
 * When, how urgent, how it stands, what it had to do with a trip.
 * @param {Alarm} alarm
 * @param {boolean} open
 */
function detail({ priority, state, count, first_out: firstOut, first, first_s: firstS, text,
    raised_s: raised, shelved, shelved_until_s: until }, open) {
  if (state === "cleared" && !open) return [clock(raised), firstOut && "first out"].filter(
      Boolean).join(" · ");
  const parts = [count > 1 ? `${clock(firstS)} – ${clock(raised)}` : clock(raised), priority];
  if (state === "shelved") parts.push(`shelved until ${clock(until)}`, ...(open ? [shelved] : []));
  else if (state !== "active") parts.push(state === "cleared" ? "gone" : state);
  if (count > 1) parts.push(`${count} times`);
  parts.push(firstOut ? "first out" : "");
  if (first && first !== text) parts.push(`first: ${first}`);
  return parts.filter(Boolean).join(" · ");
}
