// The page over a running weld: hands each frame to what shows it.
import { Actions } from "./actions.js";
import { Alarms } from "./alarms.js";
import { Bars } from "./bars.js";
import { Commands } from "./command.js";
import { Connection } from "./connection.js";
import { Controllers } from "./controllers.js";
import { byId, el, meta } from "./dom.js";
import { LiveTrends } from "./live_trends.js";
import { Status } from "./status.js";
import { Store } from "./store.js";
import { Veil } from "./veil.js";
import { verdict } from "./verdict.js";
import { WeldMap } from "./weld_map.js";

const NOBODY = { holder: null, you: false, request: null, name: "", authenticated: false, role: "", may_stop: false, note: "" };

export function startLive() {
  new LivePage().connection.start();
}

export class LivePage {
  /** @type {Hello?} */ hello = null;
  /** @type {State?} */ state = null;
  /** @type {Programme?} */ progress = null;
  /** @type {Control} */ control = NOBODY;
  /** @type {Values} */ values = {};
  /** @type {any[]} */ alarmList = [];
  /** @type {number?} */ tickAgeS = null;

  constructor() {
    this.connection = new Connection(meta("build"), {
      frame: (frame) => this.#frames[frame.t]?.(frame),
      fresh: (serverS) => this.#fresh(serverS),
      state: (state) => this.#linked(state),
    });
    this.veil = new Veil();
    this.actions = new Actions();
    this.commands = new Commands(this, this.connection, this.actions);
    this.status = new Status(byId("status"), this.commands.safeStopButton);
    this.alarms = new Alarms((ids) => this.commands.acknowledge(ids), (...request) => this.commands.ask(...request));
    this.controllers = new Controllers();
    byId("side").append(this.alarms.root, this.commands.root, this.controllers.root, this.actions.root);
  }

  #frames = {
    hello: (hello) => this.#begin(hello),
    history: ({ rows }) => {
      this.store?.prepend(rows);
      this.map?.add(rows);
      this.map?.draw();
    },
    tick: (tick) => this.#tick(tick),
    beat: ({ tick_age_s: age }) => {
      this.tickAgeS = age;
      this.#judge();
    },
    prediction: (prediction) => this.trends?.predict(prediction),
    state: (state) => {
      this.state = state;
      this.status.tell(state);
      this.status.progress.update(this);
      this.controllers.update(state);
      this.map?.draw();
      this.commands.update();
      this.#judge();
    },
    progress: (progress) => {
      this.progress = progress;
      this.status.progress.update(this);
      this.commands.update();
    },
    alarms: ({ alarms, reach }) => {
      this.alarmList = alarms;
      this.alarms.update(alarms, reach);
      this.#judge();
    },
    control: (control) => {
      this.control = control;
      this.commands.update();
    },
    actions: ({ actions }) => this.actions.update(actions),
  };

  /** A connection begins: what is shown is built anew from what the server says. */
  #begin(hello) {
    const isNew = hello.session !== this.hello?.session; // another weld is told by a hello, too, on the same connection
    this.hello = hello;
    this.values = {};
    if (isNew) this.control = NOBODY;
    this.store = new Store(hello.columns);
    this.bars = new Bars(byId("values"), hello.limits);
    this.trends?.destroy();
    this.trends = new LiveTrends(byId("trends"), this.store, hello.limits);
    this.map?.destroy();
    this.map = new WeldMap(byId("map"), hello.columns, hello.limits, (timeS) => this.trends?.look(timeS), (timeS) => this.trends?.clock(timeS) ?? "");
    this.commands.update();
    if (isNew) this.commands.connected();
  }

  #tick(tick) {
    if (!this.hello) return;
    this.store?.append(tick.row);
    this.trends?.note(tick);
    this.values = Object.fromEntries(this.hello.columns.map((name, i) => [name, tick.row[i]]));
    this.tickAgeS = 0;
    this.bars?.update(this.values, this.progress);
    this.map?.add([tick.row]);
    this.status.progress.update(this);
    this.#judge();
  }

  #fresh(serverS) {
    this.veil.lift(serverS);
    this.status.tick(serverS);
  }

  #judge() {
    if (!this.connection.live || !this.hello) return;
    this.status.judge(verdict({ state: this.state, alarms: this.alarmList, values: this.values, limits: this.hello.limits, tickAgeS: this.tickAgeS }));
    this.controllers.time({ solveMs: this.values.solve_ms, latencyMs: this.values.latency_ms, tickAgeS: this.tickAgeS });
    document.body.classList.toggle("old", this.tickAgeS === null || this.tickAgeS > 0.5);
  }

  #linked(state) {
    document.body.dataset.link = state.kind;
    byId("announce-connection").textContent = state.text;
    this.status.connection(state);
    this.commands.update();
    if (state.kind === "live") return;
    this.veil.drop(state.text);
    if (state.kind === "stale") byId("dialogs").replaceChildren(staleNotice());
  }
}

function staleNotice() {
  const reload = el("button", { type: "button", className: "primary", onclick: () => location.reload() }, "Reload");
  const notice = el("dialog", { open: true, "aria-label": "The page is out of date" }, el("h2", {}, "The page is out of date"), el("p", {}, "The server has a newer one. Nothing can be shown or commanded here."), reload);
  return notice;
}
