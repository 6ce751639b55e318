// Numbers and times as people read them.

export const NONE = "–";

/** Signs of priorities and levels: nothing is told by colour alone. */
export const SIGN = { "": "", good: "✓", attention: "●", low: "●", medium: "▲", high: "■" };

/** @param {Maybe} value @returns {value is number} */
export const known = (value) => Number.isFinite(value);

export function fixed(/** @type {Maybe} */ value, /** @type {number} */ digits) {
  if (!known(value)) return NONE;
  const text = Math.abs(value).toFixed(digits);
  return value < 0 && Number(text) !== 0 ? `−${text}` : text;
}

export function signed(/** @type {Maybe} */ value, /** @type {number} */ digits) {
  const plain = fixed(value, digits);
  return known(value) && value > 0 && Number(plain) !== 0 ? `+${plain}` : plain;
}

/**
 * `serverS` as time of the server's day, in UTC: the browser's clock and time zone have no part
 * in it.
 */
export function clock(/** @type {Maybe} */ serverS) {
  return known(serverS) ? new Date(serverS * 1000).toISOString().slice(11, 19) : "--:--:--";
}

/** The same time where the page is looked at. */
export function localClock(/** @type {Maybe} */ serverS) {
  return known(serverS) ? new Date(serverS * 1000).toLocaleTimeString("en-GB") : "--:--:--";
}

/** Seconds as m:ss or h:mm:ss. */
export function span(/** @type {Maybe} */ seconds) {
  if (!known(seconds)) return NONE;
  const whole = Math.max(0, Math.round(seconds));
  const two = (/** @type {number} */ n) => String(n).padStart(2, "0");
  const [h, m, s] = [Math.floor(whole / 3600), Math.floor(whole / 60) % 60, whole % 60];
  return h ? `${h}:${two(m)}:${two(s)}` : `${m}:${two(s)}`;
}

/** A duration in words. */
export const lasting = (/** @type {Maybe} */ seconds) => (known(seconds) && seconds >= 99.5
    ? `${span(seconds)} min` : `${fixed(seconds, known(seconds) && seconds < 10 ? 1 : 0)} s`);

/** `joint_line` as `joint line`. */
export const words = (/** @type {string | null | undefined} */ name) =>
    (name ?? "").replaceAll("_", " ");
