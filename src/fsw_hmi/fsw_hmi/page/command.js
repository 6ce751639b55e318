// What an operator can do: log in, take control, command. Every request shows pending and then
// its answer.
import { byId, el, panel, renew, setText } from "./dom.js";
import { choiceField, closeForm, notice, numberField, openForm, selectField,
    textField } from "./dialog.js";
import { words } from "./format.js";
import { resume, setPoints } from "./set_points.js";

const MODES = [
  { value: "auto", text: "auto", remark: "the controller commands" },
  { value: "hold", text: "hold", remark: "force and speed stay" },
  { value: "manual", text: "manual", remark: "force and speed by hand" },
  { value: "safe_stop", text: "safe stop", remark: "the defined safe command" },
];
const SWITCH_WAITS_S = ["0", "2", "5", "10"];
const NAME = "[A-Za-z0-9][A-Za-z0-9._\\-]*";
/** When a login is tried again that could not be checked. */
const AGAIN_MS = 5000;
/** A stop that was pressed without a connection waits for so long; later it would surprise. */
const STOPS_MS = 10_000;

export class Commands {
  // only here, so that a reload forgets them
  /** @type {{[kind: string]: string}?} */ #credentials = null;
  /** @type {Control?} */ #control = null; // as last told
  #due = 0; // until when control that is asked for must be answered
  // until when a stop that was pressed without a connection is sent with the next one
  #stopsUntil = -Infinity;
  #lapse = 0; // the timer of that
  #lost = ""; // how control has got lost without anybody's doing
  /** Why nothing can be commanded from here; empty where it can. */
  lack = "";

  /**
   * @param {import("./live.js").LivePage} page what the page knows
   * @param {import("./connection.js").Connection} connection
   * @param {import("./actions.js").Actions} actions
   */
  constructor(page, connection, actions) {
    this.page = page;
    this.connection = connection;
    this.actions = actions;
    this.stop = /** @type {HTMLButtonElement} */ (byId("safe-stop"));
    this.stop.onclick = () => this.safeStop();
    this.control = el("p", { className: "control", role: "status" });
    this.logInButton = button("Log in", () => this.logIn());
    this.takeButton = button("Take control", () => this.takeControl());
    this.requestButton = button("Ask for control",
        () => this.ask("Ask for control", "request_control"));
    this.withdrawButton = button("Withdraw request",
        () => this.ask("Withdraw request", "withdraw_request"));
    this.pages = el("span");
    this.releaseButton = button("Release control",
        () => this.ask("Release control", "release_control"));
    const access = el("div", { className: "buttons" }, this.logInButton, this.takeButton,
        this.requestButton, this.withdrawButton, this.releaseButton);
    this.acting = [button("Set-points", () => setPoints(page, this.ask)), button(
        "Controller", () => this.switchController()), button("Mode", () => this.changeMode())];
    this.welding = [button("Hold weld", () => this.weld("hold")), button("Resume weld",
        () => resume(page, () => this.weld("resume"))), button("Abort weld", () => this.abort())];
    this.acknowledgeStop = button("Acknowledge stop",
        () => this.ask("Acknowledge the safe stop", "acknowledge_stop"));
    const acting = el("div", { className: "acting" }, ...this.acting, ...this.welding,
        this.acknowledgeStop, this.pages);
    this.root = panel("commands", "Commands", this.control, access, acting);
    document.addEventListener("keydown", (event) => {
      if (!event.ctrlKey || event.key !== ".") return;
      event.preventDefault();
      this.safeStop();
    });
    this.update();
  }

  /** Show what may be done now, and why not. */
  update() {
    const { hello, progress, state } = this.page;
    const { live } = this.connection;
    this.#showControl(live);
    const stopped = state.actual_mode === "safe_stop" && !state.acknowledged;
    const nobody = this.lack || (state.known ? "" : "No supervisor reports.");
    const [points, controller, mode] = this.acting;
    const runs = progress?.state === "running";
    const end = this.#endReason();
    permit([points], nobody || end || (runs && !progress.left
        ? "The programme runs: hold the weld first." : ""));
    permit([controller], nobody || end);
    permit([mode], nobody || (stopped ? "Acknowledge the stop first." : ""));
    const held = progress?.state === "held";
    const none = this.lack || (runs || held ? "" : "No programme of a weld runs.");
    const [hold, resumed, abort] = this.welding;
    permit([hold], none || (runs ? "" : "The weld is held already."));
    permit([resumed], none || (held || progress?.left ? ""
        : "The programme runs with its own set-points."));
    permit([abort], none);
    permit([this.acknowledgeStop], nobody
        || (stopped ? "" : "There is no safe stop to acknowledge."));
    this.stop.disabled = !live && !hello; // once connected, it waits for the connection
    const waits = performance.now() < this.#stopsUntil;
    if (this.stop.lastChild) setText(this.stop.lastChild, live ? "Ctrl + ."
        : `${waits ? "waits for the connection" : "not connected"}: stop at the machine`);
  }

  /** Why the weld cannot be continued; empty where it can. */
  #endReason() {
    const { progress, state } = this.page;
    return progress?.state === "aborted" && state.actual_mode === "safe_stop"
        ? "This weld cannot be continued." : "";
  }

  /** Who has control, who asks for it, and what this page can do about it. */
  #showControl(/** @type {boolean} */ live) {
    const { hello, control } = this.page;
    const { holder, you, request, name, authenticated, note } = control;
    if (control !== this.#control) {
      // what it would send is no longer this page's to send
      if (this.#control?.you && !you) closeForm();
      if (you) this.#lost = "";
      this.#control = control;
      this.#due = performance.now() + 1000 * (request?.left_s ?? 0);
    }
    const leftS = request?.left_s ? Math.max(0, Math.ceil((this.#due - performance.now()) / 1000))
        : 0;
    const own = hello?.login === "password" && holder?.name === name; // on another page
    const mayTake = authenticated && !you && (!holder || own || (request?.you && !request.left_s));
    const reasons = [
      [!live, "Not connected."],
      [!authenticated, "Log in to command."],
      [!you && mayTake, "Take control to command."],
      [!you && request?.you, `You have asked for it: ${leftS} s left to answer.`],
      [!you, "Ask for control to command."],
    ];
    this.lack = String(reasons.find(([holds]) => holds)?.[1] ?? "");
    const has = holder ? `${holder.name}${you ? " (you)" : ""} has control.`
        : "Nobody has control.";
    const more = note || this.#lost;
    setText(this.control, [has, this.lack,
        more && `${more[0].toUpperCase()}${more.slice(1)}.`].filter(Boolean).join(" "));
    this.control.dataset.level = this.#lost ? "medium" : "";
    this.logInButton.hidden = authenticated;
    this.takeButton.hidden = !mayTake;
    this.requestButton.hidden = !authenticated || you || mayTake || Boolean(request?.you);
    this.withdrawButton.hidden = !request?.you;
    this.releaseButton.hidden = !you;
    this.#showPages(control.ticket);
    permit([this.logInButton, this.takeButton, this.withdrawButton, this.releaseButton],
        live ? "" : "Not connected.");
    permit([this.requestButton], !live ? "Not connected." : request
        ? `${request.name} has asked for it already.` : "");
    this.#showRequest(live && you ? request : null, leftS);
  }

  /**
   * Pages of other distributions, for a user.
   * @param {string} ticket by which the server gives them
   */
  #showPages(ticket) {
    this.pages.hidden = !ticket;
    renew(this.pages, ticket, () =>
      (this.page.hello?.pages ?? []).map((name) =>
        button(`${name[0].toUpperCase()}${name.slice(1)}`, () => {
          open(`pages/${encodeURIComponent(name)}?ticket=${ticket}`, "_blank", "noopener");
        }),
      ),
    );
  }

  /** @param {Control["request"]} request @param {number} leftS */
  #showRequest(request, leftS) {
    if (!request) return notice("");
    const to = { to: request.session };
    const when = leftS ? `and may take it in ${leftS} s` : "and may take it now";
    notice(
      request.session,
      `${request.name} asks for control ${when}.`,
      button(`Hand over to ${request.name}`,
          () => this.ask(`Hand control over to ${request.name}`, "hand_over_control", to)),
      button("Keep control", () => this.ask("Keep control", "keep_control", to)),
    );
  }

  /** Send a request and show what becomes of it. @type {Ask} */
  ask = async (text, what, fields) => {
    this.actions.tell(text, "pending");
    const answer = await this.connection.request(what, fields);
    this.actions.tell(text, answer.outcome, answer.message);
    return answer;
  };

  /**
   * A connection begins: a stop that waits goes first. A new session knows nobody: log in again
   * with what this page was told; control is lost with the old one.
   */
  async connected(isNew = true, hadControl = false) {
    const refused = performance.now() < this.#stopsUntil
        && (await this.#sendStop(this.#stopsUntil)).outcome === "refused";
    // nothing will change that
    if (refused && !(isNew && this.#credentials)) this.#keepStop(-Infinity);
    if (!isNew) return;
    if (hadControl) this.#lost = "control was lost with the connection to the server";
    this.update();
    if (!this.#credentials) return;
    const answer = await this.ask("Log in again", "login", this.#credentials);
    if (performance.now() < this.#stopsUntil && answer.outcome === "done") this.#sendStop(
        this.#stopsUntil);
    if (answer.outcome === "refused") {
      this.#credentials = null; // one that is out of date is not tried for ever
      this.#keepStop(-Infinity);
    }
    if (answer.outcome === "timed_out" && this.connection.live) setTimeout(
        () => this.page.control.authenticated || this.connected(), AGAIN_MS);
  }

  /** @param {(() => Promise<Answer>)?} then what to do once logged in, and `purpose` its name */
  logIn(then = null, purpose = "") {
    const kind = this.page.hello?.login ?? "token";
    const name = textField("Name", { autocomplete: "off", maxLength: 32, pattern: NAME,
        title: "letters a to z, digits and . _ -",
        value: this.#credentials?.name ?? this.page.control.name ?? "" });
    const secret = textField(kind === "token" ? "Token" : "Password",
        { type: "password", autocomplete: "off", maxLength: 200 });
    openForm({
      title: purpose ? `Log in: ${purpose}` : "Log in",
      fields: [name, secret],
      summary: () => (purpose ? `${purpose} is sent as soon as you are logged in.`
          : kind === "token" ? "The token is printed where the server was started." : ""),
      confirm: purpose ? `Log in and ${purpose.toLowerCase()}` : "Log in",
      run: async () => {
        const credentials = { [kind]: kind === "token" ? secret.value : secret.input.value,
            name: name.value };
        const answer = await this.ask("Log in", "login", credentials);
        if (answer.outcome !== "done") return answer;
        this.#credentials = credentials;
        return then ? then() : answer;
      },
    });
  }

  safeStop() {
    const until = performance.now() + STOPS_MS;
    if (!this.connection.live) return this.#keepStop(until);
    const send = () => this.#sendStop(until);
    if (this.page.control.may_stop) send();
    else this.logIn(send, "Safe stop");
  }

  /**
   * Send a stop. One that is lost with its connection, or that a login must come before, waits
   * until it lapses.
   * @param {number} until
   */
  async #sendStop(until) {
    clearTimeout(this.#lapse);
    const answer = await this.ask("Safe stop", "safe_stop");
    const lost = answer.outcome === "timed_out" && !this.connection.live;
    this.#keepStop(lost || (answer.outcome === "refused" && until === this.#stopsUntil) ? until
        : -Infinity);
    return answer;
  }

  /** A stop waits until then; -Infinity: none does. */
  #keepStop(/** @type {number} */ until) {
    clearTimeout(this.#lapse);
    this.#stopsUntil = until;
    const lapse = () => {
      this.actions.tell("Safe stop", "timed_out", "not sent");
      this.#keepStop(-Infinity);
    };
    if (until > -Infinity) this.#lapse = setTimeout(lapse, until - performance.now());
    this.update();
  }

  takeControl() {
    const { holder } = this.page.control;
    const take = () => this.ask("Take control", "take_control");
    if (!holder) return take();
    openForm({ title: "Take control", summary: () =>
        `${holder.name} has control, has not answered, and loses it.`,
        confirm: `Take control from ${holder.name}`, run: take });
  }

  acknowledge(/** @type {string} */ id) {
    this.ask("Acknowledge alarm", "acknowledge", { ids: [id] });
  }

  /** All alarms up to the newest that is on the page: one that comes meanwhile stays. */
  acknowledgeAll(/** @type {number} */ newest) {
    this.ask("Acknowledge all alarms", "acknowledge", { up_to: newest });
  }

  switchController() {
    const { controllers, actual_controller: actual } = this.page.state;
    const remark = (/** @type {Health} */ controller) =>
        [controller.name === actual ? "commands now" : controller.ready ? "ready" : "not ready",
        controller.reason].filter(Boolean).join(", ");
    const others = controllers.filter((controller) => controller.name !== actual);
    const choice = choiceField("Controller", controllers.map(
        (controller) => ({ value: controller.name, text: controller.name, remark: remark(
        controller) })), (others.find((controller) => controller.ready) ?? others[0])?.name);
    const wait = selectField("Wait until it is ready",
        SWITCH_WAITS_S.map((value) => ({ value, text: `at most ${value} s` })), "2");
    openForm({
      title: "Swap the controller",
      fields: [choice, wait],
      summary: () => `${actual || "nobody"} → ${choice.value}`,
      lack: () => this.#neverReady(choice.value, Number(wait.value)),
      confirm: "Swap",
      run: () => this.ask(`Swap to ${choice.value}`, "switch",
          { controller: choice.value, wait_s: Number(wait.value) }),
    });
  }

  /**
   * Why a swap to a controller is certain to be refused.
   * @param {string} name
   * @param {number} waitS
   */
  #neverReady(name, waitS) {
    const chosen = this.page.state.controllers.find((controller) => controller.name === name);
    if (!chosen) return "Choose a controller.";
    // it may become ready meanwhile
    const comes = chosen.healthy && !chosen.inhibited && waitS > 0;
    return chosen.ready || comes ? "" : `Not ready: ${chosen.reason || name}.`;
  }

  changeMode() {
    const { hello, values, state } = this.page;
    const drive = (/** @type {string} */ key, /** @type {string} */ name,
        /** @type {string} */ unit) => {
      const [low, high] = hello?.limits[key].range ?? [0, 0];
      return numberField(`${name} in manual`, unit, values[`command_${key}`]?.toFixed(1) ?? "",
          low, high);
    };
    const force = drive("force_kn", "Force", "kN");
    const speed = drive("speed_rpm", "Speed", "rpm");
    const mode = choiceField("Mode", MODES, state.actual_mode);
    const by = () => (mode.value === "manual"
        ? ` with ${force.input.value} kN and ${speed.input.value} rpm` : "");
    openForm({
      title: "Change the mode",
      fields: [mode, force, speed],
      summary: () => {
        for (const field of [force, speed]) field.use(mode.value === "manual");
        return `${words(state.actual_mode) || "unknown"} → ${words(mode.value)}${by()}`;
      },
      lack: () => (mode.value === "auto" ? this.#endReason() : ""),
      confirm: "Change mode",
      run: () => {
        const byHand = mode.value === "manual" ? { force_kn: force.value, speed_rpm: speed.value }
            : {};
        return this.ask(`Mode ${words(mode.value)}`, "mode", { mode: mode.value, ...byHand });
      },
    });
  }

  weld = (/** @type {string} */ action) => this.ask(`${action} weld`, "weld", { action });

  abort() {
    openForm({ title: "Abort the weld", summary: () =>
        "The programme ends and the weld goes into safe stop. This cannot be undone.",
        confirm: "Abort the weld", run: () => this.weld("abort") });
  }
}

const button = (/** @type {string} */ text, /** @type {() => void} */ onclick) =>
    el("button", { type: "button", onclick }, text);

/**
 * Whether buttons may be used; why not is told where one points.
 * @param {HTMLButtonElement[]} buttons
 * @param {string} lack
 */
function permit(buttons, lack) {
  for (const button of buttons) Object.assign(button, { disabled: Boolean(lack), title: lack });
}
