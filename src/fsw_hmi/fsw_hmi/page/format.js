// Numbers and times as people read them.

export const NONE = "–";

const known = (value) => value !== null && value !== undefined && Number.isFinite(value);

export function fixed(value, digits) {
  if (!known(value)) return NONE;
  const text = Math.abs(value).toFixed(digits);
  return value < 0 && Number(text) !== 0 ? `−${text}` : text;
}

export function signed(value, digits) {
  const text = fixed(value, digits);
  return text === NONE || text.startsWith("−") || Number(text) === 0 ? text : `+${text}`;
}

/** `server_s` as time of the server's day, in UTC: the browser's clock and time zone have no part in it. */
export function clock(serverS) {
  return known(serverS) ? new Date(serverS * 1000).toISOString().slice(11, 19) : "--:--:--";
}

/** Seconds as m:ss or h:mm:ss. */
export function span(seconds) {
  if (!known(seconds)) return NONE;
  const whole = Math.max(0, Math.round(seconds));
  const two = (n) => String(n).padStart(2, "0");
  const [h, m, s] = [Math.floor(whole / 3600), Math.floor(whole / 60) % 60, whole % 60];
  return h ? `${h}:${two(m)}:${two(s)}` : `${m}:${two(s)}`;
}

/** `joint_line` as `joint line`. */
export const words = (name) => (name ?? "").replaceAll("_", " ");
