// How far a safe stop has come: force down to its safe value, spindle, travel.
import { fixed, known, span, words } from "./format.js";

/** The force follows its ramp late by so much [s], and by no more than this [kN]. */
const LATE_S = 2;
const NEAR_KN = 1;

export class Stop {
  /** @type {{timeS: number, forceKn: number}?} */ #begin = null;

  /** What is told; null where nothing is being stopped. `share` is how far the force has come. @param {import("./live.js").LivePage} page */
  progress({ state, values, progress, hello }) {
    const { force_kn: now, time_s: timeS } = values;
    if (!state.known || state.actual_mode !== "safe_stop") this.#begin = null;
    else if (known(now) && known(timeS)) this.#begin ??= { timeS, forceKn: now };
    if (!this.#begin) return null;
    const rest = `spindle ${fixed(values.speed_rpm, 0)} rpm; ${progress ? `travel: programme ${words(progress.state)} at ${fixed(progress.angle_deg, 0)}°` : "no programme, no travel known here"}`;
    if (!hello?.safe || !known(now) || !known(timeS)) return { level: "attention", text: `Stopping: ${fixed(now, 1)} kN`, detail: rest, share: null };
    const { force_kn: safe, rate_kn_per_s: rate } = hello.safe;
    const { timeS: beganS, forceKn } = this.#begin;
    if (now <= safe + NEAR_KN) return { level: "attention", text: "Stopped", detail: `force ${fixed(now, 1)} kN, safe; ${rest}`, share: 1 };
    const due = Math.max(safe, forceKn - rate * Math.max(0, timeS - beganS - LATE_S)) + NEAR_KN;
    const share = (forceKn - now) / Math.max(forceKn - safe, NEAR_KN);
    if (now > due) return { level: "high", text: `■ Force does not fall: ${fixed(now, 1)} kN`, detail: `it should be below ${fixed(due, 1)} kN; ${rest}`, share };
    return { level: "attention", text: `Stopping: ${fixed(now, 1)} → ${fixed(safe, 1)} kN`, detail: `${span((now - safe) / rate)} left; ${rest}`, share };
  }
}
