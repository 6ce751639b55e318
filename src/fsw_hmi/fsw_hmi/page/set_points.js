// New set-points: from where, to where, and how long the ramp takes.
import { checkField, numberField, openForm } from "./dialog.js";
import { fixed, known, lasting, signed } from "./format.js";

/** @typedef {import("./live.js").LivePage} Page */

const LEAD_S = 0.5; // a ramp is sent ahead by so much
const AFTER_S = 5; // is drawn after a ramp

/**
 * How long each of both ramps lasts [s].
 * @param {SetPoints} from
 * @param {SetPoints} to
 * @param {Reference} reference
 */
const each = (from, to, reference) => ({
  depth_mm: Math.abs(to.depth_mm - from.depth_mm) / reference.rate_depth_mm_per_s,
  temperature_c: Math.abs(
      to.temperature_c - from.temperature_c) / reference.rate_temperature_c_per_s,
});

/** What changes in words; empty: nothing. @param {SetPoints} from @param {SetPoints} to */
function changes(from, to) {
  const change = (/** @type {string} */ name, /** @type {string} */ unit,
      /** @type {number} */ old, /** @type {number} */ next, /** @type {number} */ digits) => {
    if (old === next) return [];
    return [
        known(old)
        ? `${name} ${fixed(old, digits)} → ${fixed(next, digits)} ${unit} (${signed(next - old, digits)})`
        : `${name} ${fixed(next, digits)} ${unit}`];
  };
  return [...change("Depth", "mm", from.depth_mm, to.depth_mm, 2),
      ...change("Temperature", "°C", from.temperature_c, to.temperature_c, 1)].join(", ");
}

/**
 * A ramp as it would be drawn in the trends; `together`: both arrive at the same time, else each
 * as soon as it can.
 * @param {Page} page
 * @param {SetPoints} from
 * @param {SetPoints} to
 * @param {boolean} together
 * @returns {Ahead?}
 */
function ramp({ store, hello }, from, to, together) {
  if (!hello || !store) return null;
  const lasts = each(from, to, hello.reference);
  const whole = Math.max(...Object.values(lasts));
  if (!known(whole)) return null;
  const times = [0, ...Object.values(lasts), whole + AFTER_S].sort((a, b) => a - b);
  const line = (/** @type {"depth_mm" | "temperature_c"} */ key) =>
      times.map((timeS) => from[key] + (to[key] - from[key]) * Math.min(
      1, timeS / Math.max(together ? whole : lasts[key], 1e-6)));
  return { time_s: times.map((timeS) => store.newest + LEAD_S + timeS), depth_mm: line("depth_mm"),
      temperature_c: line("temperature_c") };
}

const inForce = (/** @type {Page} */ { values }) => ({ depth_mm: values.reference_depth_mm ?? NaN,
    temperature_c: values.reference_temperature_c ?? NaN });

/**
 * Resume: what it does to the set-points, in words and drawn ahead.
 * @param {Page} page
 * @param {() => Promise<Answer>} run
 */
export function resume(page, run) {
  openForm({
    title: "Resume the weld",
    summary: () => {
      const { progress } = page;
      const goal = { depth_mm: progress?.depth_mm ?? NaN,
          temperature_c: progress?.temperature_c ?? NaN };
      page.trends?.preview(progress?.left ? ramp(page, inForce(page), goal, false) : null);
      if (!progress?.left) return "The programme's set-points are in force.";
      const how = progress.way_back_s
          ? `back to the programme by a ramp of ${lasting(progress.way_back_s)}`
          : "the programme continues where it is";
      return [changes(inForce(page), goal), how].filter(Boolean).join("; ");
    },
    confirm: "Resume the weld",
    run,
    closed: () => page.trends?.preview(null),
  });
}

/** @param {Page} page @param {Ask} ask */
export function setPoints(page, ask) {
  if (!page.hello) return;
  const { reference } = page.hello;
  const from = inForce(page);
  const start = (/** @type {number} */ value, /** @type {number} */ digits) =>
      (known(value) ? value.toFixed(digits) : "");
  const depth = numberField("Depth", "mm", start(from.depth_mm, 2), ...reference.depth_mm, 0.01);
  const temperature = numberField("Temperature", "°C", start(from.temperature_c, 1),
      ...reference.temperature_c, 0.1);
  const asRamp = checkField("as a ramp", true);
  const wanted = () => ({ depth_mm: depth.value, temperature_c: temperature.value });
  openForm({
    title: "Change the set-points",
    fields: [depth, temperature, asRamp],
    summary: () => {
      const to = wanted();
      page.trends?.preview(asRamp.value ? ramp(page, from, to, true) : null);
      if (!known(to.depth_mm) || !known(
          to.temperature_c)) return "Depth and temperature are both needed.";
      const lastsS = Math.max(...Object.values(each(from, to, reference)));
      const how = !asRamp.value || !known(lastsS) ? "at once, as a step"
          : `by a ramp of ${lasting(lastsS)}`;
      return lastsS === 0 ? "These are the set-points in force." : `${changes(from, to)}, ${how}`;
    },
    confirm: "Apply set-points",
    run: () => ask(`Set-points ${depth.input.value} mm, ${temperature.input.value} °C`,
        "set_reference", { ...wanted(), ramp: asRamp.value }),
    closed: () => page.trends?.preview(null),
  });
}
