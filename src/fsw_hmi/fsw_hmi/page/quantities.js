// What is measured: one place for names, units, digits and colour-free roles of the columns.
import { known } from "./format.js";

const DRIVE = { aim: "", aimName: "", step: 1, span: 1 };
/** `aim` is the column that the quantity should follow: a set-point, or for a drive the command. @type {Spec[]} */
export const QUANTITIES = [
  { key: "depth_mm", name: "Depth", unit: "mm", digits: 2, aim: "reference_depth_mm", aimName: "set-point", big: true, rampPerS: 0.02, step: 0.1, span: 0.4 },
  { key: "temperature_c", name: "Temperature", unit: "°C", digits: 1, aim: "reference_temperature_c", aimName: "set-point", big: true, rampPerS: 1, step: 5, span: 20 },
  { key: "force_kn", name: "Force", unit: "kN", digits: 1, aim: "command_force_kn", aimName: "command", step: 2, span: 6 },
  { key: "speed_rpm", name: "Speed", unit: "rpm", digits: 0, aim: "command_speed_rpm", aimName: "command", step: 5, span: 20 },
  { key: "torque_nm", name: "Torque", unit: "N·m", digits: 0, ...DRIVE },
  { key: "power_kw", name: "Power", unit: "kW", digits: 1, ...DRIVE },
];

export const TRENDS = ["depth_mm", "temperature_c", "force_kn", "speed_rpm"];

/** @returns {Spec} */
export const quantity = (/** @type {string} */ key) => /** @type {Spec} */ (QUANTITIES.find((one) => one.key === key));

/** The quality limits of a quantity, absolute; those of the depth are relative to its set-point. @param {string} key @param {Limits} limits @param {Value} aim @returns {Pair} */
export function qualityLimits(key, limits, aim) {
  const [low, high] = limits[key]?.quality ?? [null, null];
  if (key !== "depth_mm") return [low, high];
  return [low === null || aim === null ? null : aim + low, high === null || aim === null ? null : aim + high];
}

/** How a value stands: level null where it is normal, else "high" (trip) or "medium". @param {string} key @param {Limits} limits @param {Value | undefined} value @param {Value | undefined} aim @returns {Judgement} */
export function judge(key, limits, value, aim) {
  if (!known(value)) return { level: null, text: "" };
  const outside = (/** @type {Pair | undefined} */ [low, high] = [null, null]) => {
    if (low !== null && value < low) return "low";
    return high !== null && value > high ? "high" : "";
  };
  const own = limits[key];
  const trip = outside(own?.trip);
  if (trip) return { level: "high", text: `beyond trip, ${trip}` };
  const warn = outside(own?.warn);
  if (warn) return { level: "medium", text: `warning, ${warn}` };
  const quality = outside(qualityLimits(key, limits, aim ?? null));
  if (quality) return { level: "medium", text: `off quality, ${quality}` };
  const off = known(aim) ? value - aim : 0;
  if (own?.deviation && Math.abs(off) > own.deviation) return { level: "medium", text: `off its aim, ${off < 0 ? "low" : "high"}`, isOff: true };
  return { level: null, text: "" };
}
