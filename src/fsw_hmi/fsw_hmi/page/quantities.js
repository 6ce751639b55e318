// What is measured: one place for names, units, digits and colour-free roles of the columns.
const DRIVE = { aim: "", aimName: "", step: 1, span: 1 };
/**
 * `aim` is the column that the quantity should follow: a set-point, or for a drive the command.
 * @type {Spec[]}
 */
export const QUANTITIES = [
  { key: "depth_mm", name: "Depth", unit: "mm", digits: 2, aim: "reference_depth_mm",
      aimName: "set-point", big: true, rampPerS: 0.02, step: 0.1, span: 0.4 },
  { key: "temperature_c", name: "Temperature", unit: "°C", digits: 1,
      aim: "reference_temperature_c", aimName: "set-point", big: true, rampPerS: 1, step: 5,
      span: 20 },
  { key: "force_kn", name: "Force", unit: "kN", digits: 1, aim: "command_force_kn",
      aimName: "command", step: 2, span: 6 },
  { key: "speed_rpm", name: "Speed", unit: "rpm", digits: 0, aim: "command_speed_rpm",
      aimName: "command", step: 5, span: 20 },
  { key: "torque_nm", name: "Torque", unit: "N·m", digits: 0, ...DRIVE },
  { key: "power_kw", name: "Power", unit: "kW", digits: 1, ...DRIVE },
];

/** What trends show: always the first two, and one of the pairs. */
const ALWAYS = ["depth_mm", "temperature_c"];
export const PAIRS = [["force_kn", "speed_rpm"], ["torque_nm", "power_kw"]];
export const TRENDS = [...ALWAYS, ...PAIRS.flat()];
export const shown = (/** @type {string[]} */ pair) => [...ALWAYS, ...pair];

/** @returns {Spec} */
export const quantity = (/** @type {string} */ key) =>
    /** @type {Spec} */ (QUANTITIES.find((spec) => spec.key === key));

/**
 * Within which a quantity is normal, where the rule book says so: absolute, or about its
 * set-point.
 * @param {string} key
 * @param {Limits} limits
 * @param {Value} aim
 * @returns {Pair}
 */
export function normalRange(key, limits, aim) {
  /** @type {Pair} */ let [low, high] = [null, null];
  for (const bounds of limits[key]?.kept ?? []) {
    const from = bounds.of_aim ? aim : 0;
    if (from === null) continue;
    if (bounds.low !== null) low = Math.max(low ?? -Infinity, from + bounds.low);
    if (bounds.high !== null) high = Math.min(high ?? Infinity, from + bounds.high);
  }
  return [low, high];
}
