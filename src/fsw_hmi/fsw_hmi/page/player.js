// The clock of a recorded weld: scrub, play, pause, from keyboard and slider.
import { el, setText } from "./dom.js";
import { span } from "./format.js";

const SPEEDS = [0.5, 1, 2, 5, 10, 30, 60];
const REDRAW_MS = 100;

export class Player {
  #speed = 1;
  #playing = 0;

  /** @param {HTMLElement} root @param {number} durationS @param {Weld["events"]} events @param {(timeS: number) => void} onTime called whenever the time changes */
  constructor(root, durationS, events, onTime) {
    this.durationS = durationS;
    this.onTime = onTime;
    this.timeS = 0;
    this.play = el("button", { type: "button", id: "play", "aria-keyshortcuts": "Space", onclick: () => this.toggle() }, "▶ Play");
    const speed = el("select", { id: "speed", "aria-label": "Speed", onchange: () => (this.#speed = Number(speed.value)) }, ...SPEEDS.map((one) => el("option", { value: one, selected: one === 1 }, `${one} ×`)));
    this.slider = el("input", { type: "range", id: "scrub", min: 0, max: durationS, step: 1, value: 0, "aria-label": "Time in the weld", oninput: () => this.seek(this.slider.valueAsNumber) });
    this.text = el("output", { className: "time" });
    root.append(this.play, speed, el("div", { className: "line" }, this.slider, marks(durationS, events)), this.text);
    document.addEventListener("keydown", (event) => {
      if (event.key !== " " || /** @type {Element} */ (event.target).closest("select, button")) return;
      event.preventDefault();
      this.toggle();
    });
    this.seek(0);
  }

  seek(/** @type {number} */ timeS) {
    this.timeS = Math.min(this.durationS, Math.max(0, timeS));
    this.slider.value = String(this.timeS);
    this.slider.setAttribute("aria-valuetext", span(this.timeS));
    setText(this.text, `${span(this.timeS)} / ${span(this.durationS)}`);
    this.onTime(this.timeS);
  }

  toggle() {
    if (this.#playing) return this.#pause();
    if (this.timeS >= this.durationS) this.seek(0);
    let last = performance.now();
    setText(this.play, "❚❚ Pause");
    this.#playing = setInterval(() => {
      const now = performance.now();
      this.seek(this.timeS + (this.#speed * (now - last)) / 1000);
      last = now;
      if (this.timeS >= this.durationS) this.#pause();
    }, REDRAW_MS);
  }

  #pause() {
    clearInterval(this.#playing);
    this.#playing = 0;
    setText(this.play, "▶ Play");
  }
}

/** @param {number} durationS @param {Weld["events"]} events */
function marks(durationS, events) {
  const line = el("div", { className: "marks", "aria-hidden": "true" });
  for (const { time_s: timeS, text } of events) {
    const mark = el("span", { title: text });
    mark.style.setProperty("--at", `${(100 * timeS) / durationS}%`);
    line.append(mark);
  }
  return line;
}
