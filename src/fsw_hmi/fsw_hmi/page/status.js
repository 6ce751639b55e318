// The line at the top: good or not, who commands and why, progress, server time, safe stop. Its
// height never changes.
import { byId, setShort, setText } from "./dom.js";
import { clock, localClock, SIGN, words } from "./format.js";
import { Progress } from "./progress.js";

/** What index.html has for one of its parts. */
const part = (/** @type {string} */ selector) =>
    /** @type {HTMLElement} */ (document.querySelector(selector));

export class Status {
  verdict = byId("verdict");
  sign = part("#verdict .sign");
  text = part("#verdict strong");
  detail = part("#verdict .detail");
  command = byId("who");
  who = part("#who strong");
  why = part("#who .detail");
  time = part("#clock .time");
  link = part("#clock .detail");
  recording = part("#clock .recording");
  progress = new Progress();

  judge(/** @type {Headline} */ { level, text, detail, next }) {
    this.verdict.dataset.level = level;
    this.sign.dataset.sign = SIGN[level];
    setShort(this.text, text);
    setShort(this.detail, [detail, next && `→ ${next}`].filter(Boolean).join(" "));
  }

  tell(/** @type {State} */ state) {
    const { target_controller: wanted, actual_controller: actual, target_mode: mode,
        actual_mode: actualMode, reason, by } = state;
    // In hold, manual and safe stop nobody among the controllers commands.
    const differs = !state.known || mode !== actualMode
        || (actualMode === "auto" && wanted !== actual);
    const target = differs ? `target ${wanted || "none"} · ${words(mode)}; ` : "";
    setShort(this.who, !state.known ? "No supervisor" : actualMode === "auto"
        ? `${actual || "nobody"} · auto` : words(actualMode));
    setShort(this.why, state.known
        ? `${target}${reason}${by ? ` (${by})` : ""}${state.standby ? " · standby ready" : ""}`
        : "");
    this.command.dataset.level = differs ? "medium" : "";
  }

  tick(/** @type {number} */ serverS) {
    setText(this.time, clock(serverS));
    setText(this.link, `UTC · ${localClock(serverS)} local`);
  }

  /** Whether the weld is on record. @param {{short: string, long: string}} words */
  record({ short, long }) {
    setText(this.recording, short);
    this.recording.title = long;
  }

  /** @param {Link} link @param {Programme?} programme */
  connection({ kind, text }, programme) {
    if (kind === "live") return;
    setText(this.link, "last server time, UTC");
    if (kind === "lost" && programme?.state === "done") return this.judge({ level: "attention",
        text: "Weld done", detail: `the page's server no longer answers. ${text}` });
    this.judge({ level: "high", text: kind === "connecting" ? "Connecting" : text,
        detail: kind === "lost" ? "values are old, commands are off; reconnecting" : "",
        next: kind === "lost" ? "Be ready to stop at the machine" : "" });
  }
}
