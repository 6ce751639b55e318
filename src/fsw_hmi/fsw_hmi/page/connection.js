// The websocket to the server: reconnects by itself, answers requests, and knows how old the news
// are.
import { clock } from "./format.js";

/**
 * Ticks come every 0.1 s and beats every 0.2 s: silence that is longer is told, well within a
 * second.
 */
export const SILENCE_MS = 800;
const WATCH_MS = 100;
const BEHIND_MS = 1000;
const AGAIN_MS = 1000;
/** The server answers in time or says that it timed out; this is for an answer that is lost. */
const ANSWER_MS = 15_000;
const STALE_CODE = 4001;
const LOST_CODE = 4002;

export class Connection {
  #build;
  #on;
  /** @type {Map<number, {what: string, resolve: (answer: Answer) => void, timer: number}>} */
  #pending = new Map();
  /** @type {WebSocket?} */ #socket = null;
  #resume = ""; // by which the server knows this page again after a short loss
  #nextId = 1;
  #retry = 0;
  #lastFrame = -Infinity;
  #lastWatch = performance.now();
  // largest server_s - performance.now(): the frame that came with the least delay
  #fastest = -Infinity;
  /** @type {Link} */ #state = { kind: "connecting", text: "Connecting" };
  /** @type {Value} */ serverS = null;

  constructor(/** @type {string} */ build, /** @type {Listener} */ on) {
    this.#build = build;
    this.#on = on;
  }

  start() {
    setInterval(() => this.#watch(), WATCH_MS);
    document.addEventListener("visibilitychange", () => document.hidden || this.#watch());
    this.#on.linked(this.#state);
    this.#open();
  }

  get live() {
    return this.#state.kind === "live";
  }

  /**
   * Send a request; resolves to an answer, always.
   * @param {string} what
   * @param {object} fields
   * @returns {Promise<Answer>}
   */
  request(what, fields = {}) {
    if (!this.live) return Promise.resolve({ outcome: "refused", message: "not connected" });
    const id = this.#nextId++;
    return new Promise((resolve) => {
      const timer = setTimeout(() => this.#answer(
          { id, outcome: "timed_out", message: "no answer from the server" }), ANSWER_MS);
      this.#pending.set(id, { what, resolve, timer });
      this.#socket?.send(JSON.stringify({ id, do: what, ...fields }));
    });
  }

  #open() {
    clearTimeout(this.#retry);
    const url = new URL(
        `ws?build=${encodeURIComponent(this.#build)}&resume=${encodeURIComponent(this.#resume)}`,
        location.href);
    url.protocol = location.protocol === "https:" ? "wss:" : "ws:";
    const socket = new WebSocket(url);
    this.#socket = socket;
    this.#fastest = -Infinity;
    socket.onmessage = (event) => socket === this.#socket && this.#receive(JSON.parse(event.data));
    socket.onclose = (event) => socket === this.#socket && this.#closed(event);
  }

  #closed(/** @type {{code: number}} */ event) {
    this.#socket = null;
    // which is sent again; the others are answered where the session goes on
    this.#giveUp((what) => what === "safe_stop");
    if (event.code === STALE_CODE) {
      this.#giveUp();
      return this.#become("stale", "The page is out of date: reload it");
    }
    this.#become("lost", `Disconnected since ${this.#since()}`);
    this.#retry = setTimeout(() => this.#open(), AGAIN_MS * (0.8 + 0.4 * Math.random()));
  }

  #receive(/** @type {any} */ frame) {
    if (frame.t === "answer") return this.#answer(frame);
    if (frame.t === "hello") {
      if (frame.resume !== this.#resume) this.#giveUp();
      this.#resume = frame.resume;
    }
    if (frame.server_s !== undefined) this.#note(frame.server_s);
    this.#on.frame(frame);
  }

  /**
   * Take note of a frame's time. Frames that waited in a queue, because the page stood still, are
   * not news.
   */
  #note(/** @type {number} */ serverS) {
    const now = performance.now();
    this.#fastest = Math.max(this.#fastest, serverS * 1000 - now);
    if (now + this.#fastest - serverS * 1000 > BEHIND_MS) return;
    this.#lastFrame = now;
    this.serverS = serverS;
    this.#become("live", "Connected");
    this.#on.fresh(serverS);
  }

  #watch() {
    const now = performance.now();
    const stood = now - this.#lastWatch > BEHIND_MS;
    this.#lastWatch = now;
    if (!this.live || now - this.#lastFrame < SILENCE_MS) return;
    this.#become(
        "lost", `${stood ? "The page stood still" : "Frozen: no news"} since ${this.#since()}`);
    // A socket that is silent or behind is not worth waiting for: a new one starts with the
    // present.
    const old = this.#socket;
    this.#socket = null;
    if (old) old.close(LOST_CODE);
    this.#closed({ code: 0 });
  }

  #since() {
    return this.serverS === null ? "the start" : `${clock(this.serverS)} (server time)`;
  }

  #become(/** @type {Link["kind"]} */ kind, /** @type {string} */ text) {
    // the first reason is the one to keep
    const lost = kind === "lost" && this.#state.kind === "lost";
    if (lost || (kind === this.#state.kind && text === this.#state.text)) return;
    this.#state = { kind, text };
    this.#on.linked(this.#state);
  }

  /** Requests whose answer cannot come. @param {(what: string) => boolean} lost */
  #giveUp(lost = () => true) {
    for (const [id, { what }] of [...this.#pending]) {
      if (lost(what)) this.#answer({ id, outcome: "timed_out",
          message: "the connection was lost before the answer" });
    }
  }

  #answer(/** @type {Answer & {id: number}} */ { id, outcome, message }) {
    const waiting = this.#pending.get(id);
    if (!waiting) return;
    this.#pending.delete(id);
    clearTimeout(waiting.timer);
    waiting.resolve({ outcome, message });
  }
}
