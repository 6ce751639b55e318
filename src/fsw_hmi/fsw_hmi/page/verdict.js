// One line that says whether the weld is good, and if not, what is worst.
import { fixed, words } from "./format.js";
import { judge, QUANTITIES } from "./quantities.js";

const RANK = { high: 0, medium: 1, low: 2 };
const BY_URGENCY = (a, b) => RANK[a.priority] - RANK[b.priority] || Number(b.first_out) - Number(a.first_out) || a.raised_s - b.raised_s;

/** Alarms by urgency: priority, then first-out, then age. */
export const byUrgency = (alarms) => [...alarms].sort(BY_URGENCY);

/** No ticks for longer than this: the values on the page are old. */
export const TICK_AGE_S = 0.5;

/**
 * `{level, text, detail}`; level is "good", "attention", "low", "medium" or "high".
 * `now` holds what the page knows: state, alarms, values, limits, tickAgeS.
 */
export function verdict(now) {
  if (now.tickAgeS === null || now.tickAgeS === undefined) return { level: "attention", text: "No measurements yet", detail: "" };
  const present = byUrgency(now.alarms.filter((alarm) => alarm.state !== "cleared" && alarm.state !== "shelved"));
  const urgent = [fromTickAge, fromAlarms("high"), fromMode, fromAlarms("medium"), fromValues, fromState, fromAlarms("low")];
  for (const look of urgent) {
    const found = look(now, present);
    if (found) return found;
  }
  return { level: "good", text: "Good", detail: "depth and temperature within their limits" };
}

function fromTickAge({ tickAgeS }) {
  return tickAgeS > TICK_AGE_S ? { level: "high", text: "No measurements", detail: `for ${fixed(tickAgeS, 1)} s` } : null;
}

function fromAlarms(priority) {
  return (now, present) => {
    const first = present.find((alarm) => alarm.priority === priority);
    if (!first) return null;
    const more = present.length > 1 ? `, ${present.length - 1} more` : "";
    return { level: priority, text: first.text, detail: `${priority} alarm${more}` };
  };
}

function fromMode({ state }) {
  return state?.known && state.actual_mode === "safe_stop" ? { level: "high", text: "Safe stop", detail: state.reason } : null;
}

function fromValues({ values, limits }) {
  for (const { key, name, aim } of QUANTITIES) {
    const { level, text } = judge(key, limits, values[key] ?? null, values[aim] ?? null);
    if (level) return { level, text: `${name}: ${text}`, detail: "" };
  }
  return null;
}

function fromState({ state }) {
  if (!state?.known) return { level: "medium", text: "No supervisor", detail: "nobody is known to command the weld" };
  const { target_controller: wanted, actual_controller: actual, target_mode: mode, actual_mode: actualMode, reason } = state;
  if (mode !== actualMode) return { level: "medium", text: `In ${words(actualMode)} instead of ${words(mode)}`, detail: reason };
  if (actualMode === "auto" && wanted !== actual) return { level: "medium", text: `${actual || "nobody"} instead of ${wanted}`, detail: reason };
  return actualMode === "auto" ? null : { level: "attention", text: `In ${words(actualMode)}`, detail: reason };
}
