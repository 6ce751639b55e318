// The page over a running weld: hands each frame to what shows it.
import { Actions } from "./actions.js";
import { Alarms } from "./alarms.js";
import { Bars } from "./bars.js";
import { Commands } from "./command.js";
import { Connection } from "./connection.js";
import { Controllers } from "./controllers.js";
import { endScreen, openForm } from "./dialog.js";
import { byId, meta } from "./dom.js";
import { ending, isOver, recordingWords } from "./ending.js";
import { LiveTrends } from "./live_trends.js";
import { Status } from "./status.js";
import { Store } from "./store.js";
import { Veil } from "./veil.js";
import { WeldMap } from "./weld_map.js";

/** @type {Control} */
const NOBODY = { t: "control", holder: null, you: false, request: null, name: "",
    authenticated: false, ticket: "", may_stop: false, note: "", note_code: "" };
/** @type {State} */
const UNKNOWN = { t: "state", known: false, known_heat_share: null, target_controller: "",
    actual_controller: "", target_mode: "", actual_mode: "", reason: "", cause: 0, by: "",
    stop_cause: 0, acknowledged: false, standby: false, controllers: [], interlocks: [] };

/** No ticks for longer than this: the values on the page are old. */
const TICK_AGE_S = 0.5;

/** @implements {Listener} */
export class LivePage {
  /** @type {Hello?} */ hello = null;
  /** @type {State} */ state = UNKNOWN;
  /** @type {Programme?} */ progress = null;
  /** @type {Heat?} */ heat = null;
  /** @type {Control} */ control = NOBODY;
  /** @type {Values} */ values = {};
  /** @type {{alarms: Alarm[], reach: Reach?, attainable: SetPoints?}} */
  alarms = { alarms: [], reach: null, attainable: null };
  /** @type {Headline} */
  headline = { level: "attention", text: "No measurements yet", detail: "" };
  /** @type {Account?} */ account = null;
  /** @type {RecordingReport?} */ recording = null;
  /** @type {Value} */ tickAgeS = null;
  /** @type {Tick["stop"]} */ stop = null;

  constructor() {
    this.connection = new Connection(meta("build"), this);
    this.veil = new Veil();
    this.actions = new Actions();
    this.commands = new Commands(this, this.connection, this.actions);
    this.status = new Status();
    this.list = new Alarms(this.commands);
    this.controllers = new Controllers();
    byId("side").append(this.list.root, this.commands.root, this.controllers.root,
        this.actions.root);
  }

  frame(/** @type {Frame} */ frame) {
    if (frame.t === "prediction" && frame.controller !== this.state.actual_controller) return;
    if (frame.t === "hello") this.#begin(frame);
    else if (frame.t === "tick") this.#tick(frame);
    else if (frame.t === "prediction") Object.assign(this.trends ?? {}, { prediction: frame });
    else if (frame.t === "actions") this.actions.update(frame.actions);
    else if (frame.t === "history") {
      this.store?.prepend(frame.rows);
      this.map?.add(frame.rows);
    } else {
      // of the weld before
      if (frame.t === "progress" && isOver(this.progress) && !isOver(frame)) this.account = null;
      if (frame.t === "beat") this.tickAgeS = frame.tick_age_s;
      else Object.assign(this, { [frame.t]: frame });
      if (this.isOld) this.stop = null;
      if (frame.t === "account") this.map?.judged(frame.marks);
      if (frame.t === "heat" || frame.t === "state") this.map?.known(
          this.heat, this.state.known_heat_share);
      this.#show();
    }
    if (["state", "history", "account", "heat"].includes(frame.t)) this.map?.draw();
  }

  /** Whether the values are not of the present. */
  get isOld() {
    return this.tickAgeS === null || this.tickAgeS > TICK_AGE_S;
  }

  #show() {
    if (this.state !== UNKNOWN) this.status.tell(this.state);
    this.status.progress.update(this);
    this.status.record(recordingWords(this.recording, this.trends?.toServerS ?? NaN));
    endScreen(`${this.hello?.session} ${this.progress?.state}`, ending(this));
    this.controllers.update(this.state);
    this.commands.update();
    this.list.update(this.alarms.alarms, this.alarms.reach, this.headline.alarm);
    this.#judge();
  }

  /** A connection begins: rebuild the view from the server's first frame. */
  #begin(/** @type {Hello} */ hello) {
    // another weld is told by a hello, too, on the same connection
    const isNew = hello.session !== this.hello?.session;
    const hadControl = this.control.you;
    this.hello = hello;
    this.values = {};
    this.stop = null;
    this.account = null;
    if (isNew) this.control = NOBODY;
    this.store = new Store(hello.columns);
    this.bars = new Bars(byId("values"), hello.limits);
    this.trends?.destroy();
    this.trends = new LiveTrends(byId("trends"), this.store, hello.limits);
    this.map?.destroy();
    this.map = new WeldMap(byId("map"), hello.columns, (timeS) => this.trends?.look(timeS),
        (timeS) => this.trends?.clock(timeS) ?? "");
    this.#show();
    this.commands.connected(isNew, hadControl);
  }

  #tick(/** @type {Tick} */ tick) {
    if (!this.hello) return;
    this.store?.append(tick.row);
    if (this.trends) this.trends.toServerS = tick.server_s - (tick.row[0] ?? NaN);
    this.values = Object.fromEntries(this.hello.columns.map((name, i) => [name, tick.row[i]]));
    this.tickAgeS = 0;
    this.stop = tick.stop;
    this.bars?.update(this.values, tick.flags, this.progress, this.alarms.attainable);
    this.map?.add([tick.row]);
    this.status.progress.update(this);
    this.#judge();
  }

  fresh(/** @type {number} */ serverS) {
    this.veil.lift(serverS);
    this.status.tick(serverS);
  }

  #judge() {
    if (!this.connection.live || !this.hello) return;
    this.status.judge(this.headline);
    this.controllers.time(this.values);
    document.body.classList.toggle("old", this.isOld);
  }

  linked(/** @type {Link} */ link) {
    document.body.dataset.link = link.kind;
    byId("announce-connection").textContent = link.text;
    this.#show();
    this.status.connection(link, this.progress);
    if (link.kind === "live") return;
    this.veil.drop(link.text);
    if (link.kind === "stale") openForm({ title: "The page is out of date",
        summary: () => "The server has a newer one. Nothing can be shown or commanded here.",
        confirm: "Reload", run: async () => location.reload() });
  }
}
