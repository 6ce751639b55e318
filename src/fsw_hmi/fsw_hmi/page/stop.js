// How far a safe stop has come, in words: force down to its safe value, spindle, travel. The
// server judges it.
import { fixed, span, words } from "./format.js";

/**
 * What is told; null where nothing is being stopped. `share` is how far the force has come.
 * @param {import("./live.js").LivePage} page
 */
export function stopProgress({ stop, values, progress }) {
  if (!stop) return null;
  const now = fixed(values.force_kn, 1);
  const rest =
      `spindle ${fixed(values.speed_rpm, 0)} rpm; ${progress ? `travel: programme ${words(progress.state)} at ${fixed(progress.angle_deg, 0)}°` : "no programme, no travel known here"}`;
  const { share = null, safe_kn: safe = null, due_kn: due = null, left_s: left = null } = stop;
  const texts = {
    unknown: ["attention", `Stopping: ${now} kN`, rest],
    safe: ["attention", "Stopped, tool turns",
        `force ${now} kN, safe; this weld cannot be continued; ${rest}`],
    not_falling: ["high", `■ Force does not fall: ${now} kN`,
        `it should be below ${fixed(due, 1)} kN; ${rest}`],
    falling: ["attention", `Stopping: ${now} → ${fixed(safe, 1)} kN`,
        `${span(left)} left; ${rest}`],
  };
  const [level, text, detail] = texts[stop.kind];
  return { level, text, detail, share };
}
