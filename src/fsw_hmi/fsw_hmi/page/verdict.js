// One line that says whether the weld is good, and if not, what is worst.
import { fixed, known, words } from "./format.js";
import { judge, QUANTITIES } from "./quantities.js";

/** No ticks for longer than this: the values on the page are old. */
export const TICK_AGE_S = 0.5;

/** @param {Now} now @returns {Verdict} */
export function verdict(now) {
  if (!known(now.tickAgeS)) return { level: "attention", text: "No measurements yet" };
  const present = now.alarms.filter(({ state }) => state !== "cleared" && state !== "shelved"); // the worst first
  const told = (/** @type {Priority} */ priority) => fromAlarms(present, priority);
  const found = fromTickAge(now) ?? told("high") ?? told("medium") ?? fromValues(now) ?? fromState(now) ?? fromAccount(now) ?? told("low");
  return found ?? { level: "good", text: "Good", detail: "every limit is kept so far" };
}

/** @returns {Verdict?} */
function fromTickAge(/** @type {Now} */ { tickAgeS }) {
  return (tickAgeS ?? 0) > TICK_AGE_S ? { level: "high", text: "No measurements", detail: `for ${fixed(tickAgeS, 1)} s` } : null;
}

/** @param {Alarm[]} present @param {Priority} priority @returns {Verdict?} */
function fromAlarms(present, priority) {
  const first = present.find((alarm) => alarm.priority === priority);
  if (!first) return null;
  return { level: priority, text: first.what, detail: [first.why, `${priority} alarm${present.length > 1 ? `, ${present.length - 1} more` : ""}`].filter(Boolean).join(" · ") };
}

/** @returns {Verdict?} */
function fromValues(/** @type {Now} */ { values, limits }) {
  for (const { key, name, aim } of QUANTITIES) {
    const { level, text } = judge(key, limits, values[key], values[aim]);
    if (level) return { level, text: `${name}: ${text}` };
  }
  return null;
}

/** How the weld so far is judged, by the rules of its record. @returns {Verdict?} */
function fromAccount(/** @type {Now} */ { account }) {
  if (!account) return { level: "attention", text: "Not judged yet" };
  return account.level === "good" ? null : { level: account.level, text: account.text, detail: account.detail };
}

/** What is wrong with the state is an alarm; the rest is what somebody wants. @returns {Verdict?} */
function fromState(/** @type {Now} */ { state }) {
  if (!state.known) return { level: "medium", text: "No supervisor", detail: "nobody is known to command the weld" };
  return state.actual_mode === "auto" ? null : { level: state.actual_mode === "safe_stop" ? "high" : "attention", text: `In ${words(state.actual_mode)}`, detail: state.reason };
}
