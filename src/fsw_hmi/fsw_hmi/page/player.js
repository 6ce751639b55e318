// The clock of a recorded weld: scrub, play, pause, from keyboard and slider.
import { at, el, setText } from "./dom.js";
import { span } from "./format.js";

const SPEEDS = [0.5, 1, 2, 5, 10, 30, 60];
const REDRAW_MS = 100;

export class Player {
  #playing = 0;

  /**
   * @param {HTMLElement} root
   * @param {number} durationS
   * @param {Weld["events"]} events
   * @param {(timeS: number) => void} onTime called whenever the time changes
   */
  constructor(root, durationS, events, onTime) {
    this.durationS = durationS;
    this.onTime = onTime;
    this.timeS = 0;
    this.play = el("button", { type: "button", id: "play", "aria-keyshortcuts": "Space",
        onclick: () => this.toggle() }, "▶ Play");
    this.speed = el("select", { id: "speed", "aria-label": "Speed" }, ...SPEEDS.map(
        (speed) => el("option", { value: speed, selected: speed === 1 }, `${speed} ×`)));
    this.slider = el("input", { type: "range", id: "scrub", min: 0, max: durationS, step: 1,
        value: 0, "aria-label": "Time in the weld",
        oninput: () => this.seek(this.slider.valueAsNumber) });
    const marks = el("div", { className: "marks", "aria-hidden": "true" },
        ...events.map((event) => at(el("span", { title: event.text }), event.time_s / durationS)));
    this.text = el("output", { className: "time" });
    root.append(this.play, this.speed, el("div", { className: "line" }, this.slider, marks),
        this.text);
    document.addEventListener("keydown", (event) => {
      if (event.key !== " " || /** @type {Element} */ (event.target).closest(
          "select, button")) return;
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
      this.seek(this.timeS + (Number(this.speed.value) * (now - last)) / 1000);
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
