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
