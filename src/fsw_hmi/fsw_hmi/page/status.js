// The line at the top: good or not, who commands and why, progress, server time, safe stop. Its height never changes.
import { el, setShort, setText } from "./dom.js";
import { clock, words } from "./format.js";
import { Progress } from "./progress.js";

/** @type {Record<Level, string>} */
const SIGN = { "": "", good: "✓", attention: "●", low: "●", medium: "▲", high: "■" };

export class Status {
  constructor(/** @type {HTMLElement} */ root, /** @type {HTMLElement} */ safeStop) {
    this.sign = el("span", { className: "sign", "aria-hidden": "true" }, "●");
    this.text = el("strong", {}, "Connecting");
    this.detail = el("span", { className: "detail" });
    this.verdict = el("section", { id: "verdict", "aria-label": "Verdict" }, this.sign, el("p", {}, this.text, this.detail));
    this.who = el("strong", {}, "–");
    this.why = el("span", { className: "detail" });
    this.command = el("section", { id: "who", "aria-label": "Who commands" }, el("p", {}, this.who, this.why));
    this.progress = new Progress();
    this.time = el("strong", { className: "time" }, "--:--:--");
    this.link = el("span", { className: "detail" }, "connecting");
    this.clock = el("section", { id: "clock", "aria-label": "Server time" }, el("p", {}, this.time, this.link));
    root.replaceChildren(this.verdict, this.command, this.progress.root, this.clock, safeStop);
  }

  judge(/** @type {Verdict} */ { level, text, detail }) {
    this.verdict.dataset.level = level;
    setText(this.sign, SIGN[level]);
    setShort(this.text, text);
    setShort(this.detail, detail ?? "");
  }

  tell(/** @type {State} */ state) {
    const { target_controller: wanted, actual_controller: actual, target_mode: mode, actual_mode: actualMode, reason, requested_by: by } = state;
    // In hold, manual and safe stop nobody among the controllers commands.
    const differs = !state.known || mode !== actualMode || (actualMode === "auto" && wanted !== actual);
    const target = differs ? `target ${wanted || "none"} · ${words(mode)}; ` : "";
    setShort(this.who, !state.known ? "No supervisor" : actualMode === "auto" ? `${actual || "nobody"} · auto` : words(actualMode));
    setShort(this.why, state.known ? `${target}${reason}${by ? ` (${by})` : ""}` : "");
    this.command.dataset.level = differs ? "medium" : "";
  }

  tick(/** @type {number} */ serverS) {
    setText(this.time, clock(serverS));
  }

  connection(/** @type {Link} */ { kind, text }) {
    setText(this.link, kind === "live" ? "server time, UTC" : "last server time");
    if (kind === "live") return;
    this.judge({ level: "high", text: kind === "connecting" ? "Connecting" : text, detail: kind === "lost" ? "values are old, commands are off; reconnecting" : "" });
  }
}
