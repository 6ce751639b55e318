// New set-points: from where, to where, and how long the ramp takes.
import { checkField, numberField, openForm } from "./dialog.js";
import { fixed, signed, span } from "./format.js";

/** Longest of both ramps [s]. */
export function rampSeconds(from, to, reference) {
  return Math.max(
    Math.abs(to.depth_mm - from.depth_mm) / reference.rate_depth_mm_per_s,
    Math.abs(to.temperature_c - from.temperature_c) / reference.rate_temperature_c_per_s,
  );
}

/** What a resume does to the set-points, in words. */
export function wayBack({ progress, values }) {
  if (!progress?.left) return "The programme's set-points are in force.";
  const change = (name, unit, from, to, digits) => `${name} ${fixed(from, digits)} → ${fixed(to, digits)} ${unit} (${signed(to - from, digits)})`;
  const depth = change("Depth", "mm", values.reference_depth_mm, progress.depth_mm, 2);
  const temperature = change("temperature", "°C", values.reference_temperature_c, progress.temperature_c, 1);
  return progress.way_back_s ? `${depth}; ${temperature}; back to the programme by a ramp of ${span(progress.way_back_s)}` : `${depth}; ${temperature}: the programme goes on where it is`;
}

export function setPoints(commands) {
  const { hello, values } = commands.page;
  const { reference } = hello;
  const from = { depth_mm: values.reference_depth_mm ?? NaN, temperature_c: values.reference_temperature_c ?? NaN };
  const start = (value, digits) => (Number.isNaN(value) ? "" : value.toFixed(digits));
  const depth = numberField("Depth", "mm", start(from.depth_mm, 2), ...reference.depth_mm, 0.01);
  const temperature = numberField("Temperature", "°C", start(from.temperature_c, 1), ...reference.temperature_c, 0.1);
  const ramp = checkField("as a ramp", true);
  const wanted = () => ({ depth_mm: depth.value, temperature_c: temperature.value });
  const change = (name, unit, key, digits) => `${name} ${fixed(from[key], digits)} → ${fixed(wanted()[key], digits)} ${unit} (${signed(wanted()[key] - from[key], digits)})`;
  openForm({
    title: "Change the set-points",
    fields: [depth, temperature, ramp],
    summary: () => {
      const time = ramp.value ? `ramp of ${span(rampSeconds(from, wanted(), reference))}` : "at once, as a step";
      return `${change("Depth", "mm", "depth_mm", 2)}; ${change("temperature", "°C", "temperature_c", 1)}; ${time}`;
    },
    confirm: "Apply set-points",
    run: () => commands.ask(`Set-points ${depth.input.value} mm, ${temperature.input.value} °C`, "set_reference", { ...wanted(), ramp: ramp.value }),
  });
}
