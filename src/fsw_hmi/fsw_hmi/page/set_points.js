// New set-points: from where, to where, and how long the ramp takes.
import { checkField, numberField, openForm } from "./dialog.js";
import { fixed, signed, span } from "./format.js";

const LEAD_S = 0.5; // a ramp is sent ahead by so much
const AFTER_S = 5; // is drawn after a ramp

/** Longest of both ramps [s]. */
export function rampSeconds(from, to, reference) {
  return Math.max(
    Math.abs(to.depth_mm - from.depth_mm) / reference.rate_depth_mm_per_s,
    Math.abs(to.temperature_c - from.temperature_c) / reference.rate_temperature_c_per_s,
  );
}

function changes(from, to) {
  const change = (name, unit, key, digits) => `${name} ${fixed(from[key], digits)} → ${fixed(to[key], digits)} ${unit} (${signed(to[key] - from[key], digits)})`;
  return `${change("Depth", "mm", "depth_mm", 2)}; ${change("temperature", "°C", "temperature_c", 1)}`;
}

/** What a resume does to the set-points, in words. */
function wayBack(page) {
  const { progress } = page;
  if (!progress?.left) return "The programme's set-points are in force.";
  const how = progress.way_back_s ? `; back to the programme by a ramp of ${span(progress.way_back_s)}` : ": the programme goes on where it is";
  return changes(inForce(page), progress) + how;
}

/** A ramp as it would be drawn in the trends; `together`: both arrive at the same time, else each as soon as it can. */
function ramp({ store, hello }, from, to, together) {
  const { rate_depth_mm_per_s: depthRate, rate_temperature_c_per_s: temperatureRate } = hello.reference;
  const each = { depth_mm: Math.abs(to.depth_mm - from.depth_mm) / depthRate, temperature_c: Math.abs(to.temperature_c - from.temperature_c) / temperatureRate };
  const whole = Math.max(each.depth_mm, each.temperature_c);
  if (!Number.isFinite(whole)) return null;
  const line = (key) => times.map((timeS) => from[key] + (to[key] - from[key]) * Math.min(1, timeS / Math.max(together ? whole : each[key], 1e-6)));
  const times = [0, ...Object.values(each), whole + AFTER_S].sort((a, b) => a - b);
  return { time_s: times.map((timeS) => store.newest + LEAD_S + timeS), depth_mm: line("depth_mm"), temperature_c: line("temperature_c") };
}

const inForce = ({ values }) => ({ depth_mm: values.reference_depth_mm ?? NaN, temperature_c: values.reference_temperature_c ?? NaN });

/** Resume: what it does to the set-points, in words and drawn ahead. */
export function resume(commands, run) {
  const { page } = commands;
  const draw = () => page.trends?.preview(page.progress?.left ? ramp(page, inForce(page), page.progress, false) : null);
  openForm({
    title: "Resume the weld",
    summary: () => {
      draw();
      return wayBack(page);
    },
    confirm: "Resume the weld",
    run,
    closed: () => page.trends?.preview(null),
  });
}

export function setPoints(commands) {
  const { page } = commands;
  const { reference } = page.hello;
  const from = inForce(page);
  const start = (value, digits) => (Number.isNaN(value) ? "" : value.toFixed(digits));
  const depth = numberField("Depth", "mm", start(from.depth_mm, 2), ...reference.depth_mm, 0.01);
  const temperature = numberField("Temperature", "°C", start(from.temperature_c, 1), ...reference.temperature_c, 0.1);
  const asRamp = checkField("as a ramp", true);
  const wanted = () => ({ depth_mm: depth.value, temperature_c: temperature.value });
  openForm({
    title: "Change the set-points",
    fields: [depth, temperature, asRamp],
    summary: () => {
      page.trends?.preview(asRamp.value ? ramp(page, from, wanted(), true) : null);
      const time = asRamp.value ? `ramp of ${span(rampSeconds(from, wanted(), reference))}` : "at once, as a step";
      return `${changes(from, wanted())}; ${time}`;
    },
    confirm: "Apply set-points",
    run: () => commands.ask(`Set-points ${depth.input.value} mm, ${temperature.input.value} °C`, "set_reference", { ...wanted(), ramp: asRamp.value }),
    closed: () => page.trends?.preview(null),
  });
}
