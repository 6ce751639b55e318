// Disturbances and sensor faults: only offered where the plant is the emulator.
import { numberField, openForm, selectField } from "./dialog.js";
import { words } from "./format.js";

const named = (values) => values.map((value) => ({ value, text: words(value) }));
const MAX_S = 3600;
const WITH_SIZE = ["bias", "drift", "spike", "delay"];
/** What a field that may be hidden sends. */
const sent = (field) => (field.input.disabled ? 0 : field.value);

export function disturb(commands) {
  const { channels, shapes } = commands.page.hello.disturbances;
  const channel = selectField("Channel", Object.entries(channels).map(([value, { unit }]) => ({ value, text: `${words(value)} [${unit}]` })));
  const shape = selectField("Shape", named(shapes));
  const amplitude = numberField("Amplitude", "", 0, 0, 0, "any");
  const duration = numberField("Duration", "s", 10, 0, MAX_S, "any");
  const period = numberField("Period", "s", 10, 0, MAX_S, "any");
  openForm({
    title: "Disturb the emulated weld",
    fields: [channel, shape, amplitude, duration, period],
    summary: () => {
      const { unit, min, max } = channels[channel.value];
      amplitude.use(shape.value !== "none", min, max, unit);
      duration.use(shape.value === "ramp" || shape.value === "pulse");
      period.use(shape.value === "sine");
      if (shape.value === "none") return `${words(channel.value)}: no disturbance any more`;
      return `${words(channel.value)}: ${shape.value} of ${amplitude.input.value} ${unit}`;
    },
    confirm: "Disturb",
    run: () =>
      commands.ask(`Disturb ${channel.value}`, "disturb", { channel: channel.value, shape: shape.value, amplitude: sent(amplitude), duration_s: sent(duration), period_s: sent(period) }),
  });
}

export function fault(commands) {
  const { sensors, kinds, delay_s: delay } = commands.page.hello.faults;
  const sensor = selectField("Sensor", Object.entries(sensors).map(([value, { unit }]) => ({ value, text: `${words(value)} [${unit}]` })));
  const kind = selectField("Fault", named(kinds));
  const magnitude = numberField("Size", "", 0, 0, 0, "any");
  const duration = numberField("Duration", "s, 0: lasts", 5, 0, MAX_S, "any");
  openForm({
    title: "Fault of an emulated sensor",
    fields: [sensor, kind, magnitude, duration],
    summary: () => {
      const sized = WITH_SIZE.includes(kind.value);
      const { min, max, unit: own } = sensors[sensor.value];
      const unit = kind.value === "delay" ? "s" : kind.value === "drift" ? `${own}/s` : own;
      magnitude.use(sized, ...(kind.value === "delay" ? delay : [min, max]), unit);
      duration.use(kind.value !== "none");
      if (kind.value === "none") return `${words(sensor.value)}: no fault any more`;
      const size = sized ? ` of ${magnitude.input.value} ${unit}` : "";
      return `${words(sensor.value)}: ${kind.value}${size}, ${duration.value === 0 ? "until it is cleared" : `for ${duration.input.value} s`}`;
    },
    confirm: "Set the fault",
    run: () => commands.ask(`Fault ${sensor.value} ${kind.value}`, "fault", { sensor: sensor.value, kind: kind.value, magnitude: sent(magnitude), duration_s: sent(duration) }),
  });
}
