// The recording and the end of a weld, in words.
import { clock, fixed, known, lasting, SIGN } from "./format.js";

/** @type {Record<BagState, [Level, string]>} */ const RECORDING = {
  none: ["medium", "not recorded"],
  recording: ["good", "recording"],
  incomplete: ["medium", "recording with gaps"],
  paused: ["medium", "recorder paused"],
  failed: ["high", "recording failed"],
  silent: ["high", "recorder silent"],
  closed: ["good", "bag closed"],
  closed_with_gaps: ["medium", "bag closed, with gaps"],
};
const VERDICT = { accept: "accept", review: "to be reviewed", reject: "reject" };
const OVER = ["done", "aborted"];

export const isOver = (/** @type {Programme?} */ programme) =>
    OVER.includes(programme?.state ?? "");

/**
 * State, file, size and last gap; `toServerS` is from the weld's time to the server's.
 * @param {RecordingReport?} report
 * @param {number} toServerS
 */
export function recordingWords(report, toServerS) {
  if (!report) return { short: "", long: "" };
  const { state, bag, bytes, gap } = report;
  const [level, text] = RECORDING[state];
  const size = bytes ? `, ${fixed(bytes / 1e6, 1)} MB` : "";
  const last = gap ? `, gap of ${lasting(gap[1] - gap[0])} at ${clock(gap[0] + toServerS)}` : "";
  const short = `${SIGN[level]} ${text}${size}${last}`;
  return { short, long: bag ? `${short}: ${bag}` : short };
}

/** What is said at the end of a weld; null before. @param {import("./live.js").LivePage} page */
export function ending({ progress, account, recording, values, trends, headline, isOld }) {
  if (!progress || !isOver(progress)) return null;
  const done = progress.state === "done";
  const bag = recordingWords(recording, trends?.toServerS ?? NaN).long
      || `${SIGN.medium} ${RECORDING.none[1]}`;
  const verdict = account
      ? `Verdict of the rules so far: ${VERDICT[account.verdict]} (${account.text}${account.detail ? `; ${account.detail}` : ""}).`
      : "Not judged.";
  const moves = !isOld && known(values.force_kn) && known(values.speed_rpm)
      ? ` The tool still turns at ${fixed(values.speed_rpm, 0)} rpm under ${fixed(values.force_kn, 0)} kN.` : "";
  return {
    title: done ? "Weld done" : "Weld aborted: it cannot be continued",
    lines: [verdict, `Recording: ${bag}.`, ...(done ? [] : [moves.trim()].filter(Boolean)),
        ...(headline.after ? [`Next: ${headline.after}.`] : [])],
  };
}
