// Dead man's switch of the page: a veil that the compositor draws by itself when this script
// stops resetting it.
import { byId, setText } from "./dom.js";
import { clock } from "./format.js";

const HOLD_MS = 900;

export class Veil {
  constructor() {
    this.veil = byId("veil");
    this.text = byId("veil-text");
    // An animation of the opacity runs on even while the page's script hangs.
    this.animation = this.veil.animate({ opacity: [0, 0, 1], offset: [0, 0.999, 1] },
        { duration: HOLD_MS, fill: "forwards" });
  }

  /** News of `serverS`: lift the veil and wind the clock up again. */
  lift(/** @type {number} */ serverS) {
    setText(this.text, `Frozen or disconnected: no news since ${clock(serverS)} (server time)`);
    this.animation.currentTime = 0;
    if (this.animation.playState !== "running") this.animation.play();
  }

  /** Say what is known of why there is no news. */
  drop(/** @type {string} */ text) {
    setText(this.text, text);
    this.animation.finish();
  }
}
