// Disturbances and sensor faults: only offered where the plant is the emulator.
import { numberField, openForm, selectField } from "./dialog.js";
import { words } from "./format.js";

const named = (values) => values.map((value) => ({ value, text: words(value) }));
const MAX_S = 3600;

export function disturb(commands) {
  const { channels, shapes } = commands.page.hello.disturbances;
  const channel = selectField("Channel", Object.entries(channels).map(([value, { unit }]) => ({ value, text: `${words(value)} [${unit}]` })));
  const shape = selectField("Shape", named(shapes));
  const all = Object.values(channels);
  const amplitude = numberField("Amplitude", "", 0, Math.min(...all.map((one) => one.min)), Math.max(...all.map((one) => one.max)), "any");
  const duration = numberField("Duration", "s, 0: lasts", 0, 0, MAX_S, "any");
  const period = numberField("Period", "s, for a sine", 10, 0, MAX_S, "any");
  openForm({
    title: "Disturb the emulated weld",
    fields: [channel, shape, amplitude, duration, period],
    summary: () => {
      const { unit, min, max } = channels[channel.value];
      return `${words(channel.value)}: ${shape.value} of ${amplitude.input.value} ${unit} (${min} to ${max} ${unit})`;
    },
    confirm: "Disturb",
    run: () =>
      commands.ask(`Disturb ${channel.value}`, "disturb", { channel: channel.value, shape: shape.value, amplitude: amplitude.value, duration_s: duration.value, period_s: period.value }),
  });
}

export function fault(commands) {
  const { sensors, kinds } = commands.page.hello.faults;
  const sensor = selectField("Sensor", Object.entries(sensors).map(([value, { unit }]) => ({ value, text: `${words(value)} [${unit}]` })));
  const kind = selectField("Fault", named(kinds));
  const magnitude = numberField("Size", "in the sensor's unit", 0, -1000, 1000, "any");
  const duration = numberField("Duration", "s, 0: lasts", 5, 0, MAX_S, "any");
  openForm({
    title: "Fault of an emulated sensor",
    fields: [sensor, kind, magnitude, duration],
    summary: () => `${words(sensor.value)}: ${kind.value}, ${magnitude.input.value} ${sensors[sensor.value].unit}, ${duration.value === 0 ? "until it is cleared" : `for ${duration.input.value} s`}`,
    confirm: "Set the fault",
    run: () => commands.ask(`Fault ${sensor.value} ${kind.value}`, "fault", { sensor: sensor.value, kind: kind.value, magnitude: magnitude.value, duration_s: duration.value }),
  });
}
