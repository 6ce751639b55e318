// Disturbances and sensor faults: only offered where the plant is the emulator.
import { numberField, openForm, selectField } from "./dialog.js";
import { lasting, words } from "./format.js";

const named = (/** @type {string[]} */ values) => values.map((value) => ({ value, text: words(value) }));
const units = (/** @type {Record<string, Allowed>} */ of) => Object.entries(of).map(([value, { unit }]) => ({ value, text: `${words(value)} [${unit}]` }));
const WITH_SIZE = ["bias", "drift", "spike", "delay", "dust"];

export function disturb(/** @type {Hello} */ { disturbances }, /** @type {Ask} */ ask) {
  const { channels, shapes, duration_s: [shortest, longest] } = disturbances;
  const channel = selectField("Channel", units(channels));
  const shape = selectField("Shape", named(shapes));
  const amplitude = numberField("Amplitude", "", 0, 0, 0);
  const duration = numberField("Duration", "s", 10, shortest, longest);
  const period = numberField("Period", "s", 10, shortest, longest);
  openForm({
    title: "Disturb the emulated weld",
    fields: [channel, shape, amplitude, duration, period],
    summary: () => {
      const { unit, min, max } = channels[channel.value];
      amplitude.use(shape.value !== "none", min, max, unit);
      amplitude.refuseZero();
      duration.use(shape.value === "ramp" || shape.value === "pulse");
      period.use(shape.value === "sine" || shape.value === "random");
      const size = `${amplitude.input.value || "–"} ${unit}`;
      /** @type {Record<string, string>} */ const told = { none: "no disturbance any more", step: `at once by ${size}`, ramp: `by ${size} within ${lasting(duration.value)}`, pulse: `by ${size} for ${lasting(duration.value)}`, sine: `to and fro by ${size}, every ${lasting(period.value)}`, random: `at random by ${size} (standard deviation), a new level every ${lasting(period.value)} on average` };
      return `${words(channel.value)}: ${told[shape.value] ?? size}`;
    },
    confirm: "Disturb",
    run: () => ask(`Disturb ${words(channel.value)}`, "disturb", { channel: channel.value, shape: shape.value, amplitude: amplitude.sent, duration_s: duration.sent, period_s: period.sent }),
  });
}

export function fault(/** @type {Hello} */ { faults, disturbances }, /** @type {Ask} */ ask) {
  const { sensors, kinds, delay_s: delay } = faults;
  const sensor = selectField("Sensor", units(sensors));
  const kind = selectField("Fault", named(kinds));
  const magnitude = numberField("Size", "", 0, 0, 0);
  const duration = numberField("Duration", "s, 0: lasts", 5, 0, disturbances.duration_s[1]);
  openForm({
    title: "Fault of an emulated sensor",
    fields: [sensor, kind, magnitude, duration],
    summary: () => {
      const { min, max, unit: own } = sensors[sensor.value];
      const unit = kind.value === "delay" ? "s" : kind.value === "drift" ? `${own}/s` : own;
      magnitude.use(WITH_SIZE.includes(kind.value), ...(kind.value === "delay" ? delay : /** @type {const} */ ([min, max])), unit);
      magnitude.refuseZero();
      duration.use(kind.value !== "none" && kind.value !== "spike");
      if (kind.value === "none") return `${words(sensor.value)}: no fault any more`;
      const size = magnitude.root.hidden ? "" : ` of ${magnitude.input.value || "–"} ${unit}`;
      const long = kind.value === "spike" ? "for one sample" : duration.value === 0 ? "until it is cleared" : `for ${lasting(duration.value)}`;
      return `${words(sensor.value)}: ${kind.value}${size}, ${long}`;
    },
    confirm: "Set the fault",
    run: () => ask(`Fault ${sensor.value} ${kind.value}`, "fault", { sensor: sensor.value, kind: kind.value, magnitude: magnitude.sent, duration_s: duration.sent }),
  });
}
