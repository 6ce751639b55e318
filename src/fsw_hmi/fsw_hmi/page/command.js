// What an operator can do: log in, take control, command. Every request shows pending and then its answer.
import { el, panel, setText } from "./dom.js";
import { choiceField, closeForm, notice, numberField, openForm, selectField, textField } from "./dialog.js";
import { disturb, fault } from "./emulator.js";
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
/** How often the server is told that somebody is at the page, and when a login is tried again that could not be checked. */
const TOUCH_MS = 20_000;
const AGAIN_MS = 5000;

export class Commands {
  /** @type {{[kind: string]: string}?} */
  #credentials = null; // only here, so that a reload forgets them
  /** @type {Control?} */
  #control = null; // as last told
  #due = 0; // until when control that is asked for must be answered
  #touched = -Infinity;

  /**
   * @param {import("./live.js").LivePage} page what the page knows: hello, state, values, control, progress
   * @param {import("./connection.js").Connection} connection
   * @param {import("./actions.js").Actions} actions
   */
  constructor(page, connection, actions) {
    this.page = page;
    this.connection = connection;
    this.actions = actions;
    this.safeStopButton = el("button", { type: "button", id: "safe-stop", "aria-keyshortcuts": "Control+.", onclick: () => this.safeStop() }, el("strong", {}, "SAFE STOP"), el("span", {}, "Ctrl + ."));
    this.control = el("p", { className: "control" });
    this.access = el("div", { className: "buttons" });
    this.logInButton = this.#button("Log in", () => this.logIn());
    this.takeButton = this.#button("Take control", () => this.takeControl());
    this.requestButton = this.#button("Ask for control", () => this.ask("Ask for control", "request_control"));
    this.withdrawButton = this.#button("Withdraw request", () => this.ask("Withdraw request", "withdraw_request"));
    this.releaseButton = this.#button("Release control", () => this.ask("Release control", "release_control"));
    this.access.append(this.logInButton, this.takeButton, this.requestButton, this.withdrawButton, this.releaseButton);
    this.acknowledgeStopButton = this.#button("Acknowledge stop", () => this.ask("Acknowledge the safe stop", "acknowledge_stop"));
    this.acting = [
      this.acknowledgeStopButton,
      this.#button("Set-points", () => setPoints(this)),
      this.#button("Controller", () => this.switchController()),
      this.#button("Mode", () => this.changeMode()),
    ];
    this.weldButtons = ["hold", "resume", "abort"].map((action) => this.#button(`${action[0].toUpperCase()}${action.slice(1)} weld`, () => this.weld(action)));
    this.emulator = [this.#button("Disturb", () => disturb(this)), this.#button("Fault", () => fault(this))];
    this.root = panel("commands", "Commands", this.control, this.access, el("div", { className: "buttons acting" }, ...this.acting, ...this.weldButtons, ...this.emulator));
    document.addEventListener("keydown", (event) => {
      if (!event.ctrlKey || event.key !== ".") return;
      event.preventDefault();
      this.safeStop();
    });
    for (const touch of ["pointerdown", "pointermove", "keydown"]) document.addEventListener(touch, () => this.#touch(), { passive: true });
    this.update();
  }

  /** Show what may be done now, and why not. */
  update() {
    const { hello, control, progress, state } = this.page;
    const live = this.connection.live;
    const inForce = live && control.authenticated && control.you;
    this.#showControl(live, inForce);
    for (const button of this.acting) button.disabled = !inForce;
    this.acknowledgeStopButton.hidden = state?.actual_mode !== "safe_stop" || state.acknowledged;
    for (const button of this.weldButtons) {
      button.disabled = !inForce;
      button.hidden = !progress;
    }
    for (const button of this.emulator) {
      button.disabled = !inForce || control.role !== "engineer";
      button.title = inForce && button.disabled ? "needs the role engineer" : "";
      button.hidden = !hello?.emulator;
    }
    this.safeStopButton.disabled = !live;
    setText(this.safeStopButton.lastChild, live ? "Ctrl + ." : "not connected: stop at the machine");
    if (!live && this.#control?.you) closeForm(); // a login may go on
  }

  /** Who has control, who asks for it, and what this page can do about it. */
  #showControl(live, inForce) {
    const { hello, control } = this.page;
    const { holder, you, request, name, authenticated, role, note } = control;
    if (control !== this.#control) {
      if (this.#control?.you && !you) closeForm(); // what it would send is no longer this page's to send
      if (role && !authenticated) this.#credentials = null; // idle: who comes back must say who that is
      this.#control = control;
      this.#due = performance.now() + 1000 * (request?.left_s ?? 0);
    }
    const leftS = request?.left_s ? Math.max(0, Math.ceil((this.#due - performance.now()) / 1000)) : 0;
    const commands = authenticated && role !== "view";
    const own = hello?.login === "password" && holder?.name === name; // on another page
    const mayTake = commands && !you && (!holder || own || (request?.you && !request.left_s));
    const has = holder ? `${holder.name}${you ? " (you)" : ""} has control.` : "Nobody has control.";
    const why = hello?.commands === false ? " This server takes no commands." : !live ? " Not connected." : !authenticated ? " Log in to command." : !commands ? " Your role is view: you may look, and stop." : inForce ? "" : mayTake ? " Take control to command." : request?.you ? ` You have asked for it: ${leftS} s left to answer.` : " Ask for control to command.";
    setText(this.control, has + why + (note ? ` ${note[0].toUpperCase()}${note.slice(1)}.` : ""));
    this.logInButton.hidden = authenticated || hello?.commands === false;
    this.takeButton.hidden = !mayTake;
    this.requestButton.hidden = !commands || you || mayTake || Boolean(request?.you);
    this.requestButton.disabled = !live || Boolean(request);
    this.withdrawButton.hidden = !request?.you;
    this.releaseButton.hidden = !you;
    for (const button of [this.logInButton, this.takeButton, this.withdrawButton, this.releaseButton]) button.disabled = !live;
    this.#showRequest(live && you ? request : null, leftS);
  }

  #showRequest(request, leftS) {
    if (!request) return notice("");
    const to = { to: request.session };
    const when = leftS ? `and may take it in ${leftS} s` : "and may take it now";
    notice(
      request.session,
      `${request.name} asks for control ${when}.`,
      this.#button(`Hand over to ${request.name}`, () => this.ask(`Hand control over to ${request.name}`, "hand_over_control", to)),
      this.#button("Keep control", () => this.ask("Keep control", "keep_control", to)),
    );
  }

  /** Somebody is at this page. */
  #touch() {
    if (!this.connection.live || performance.now() - this.#touched < TOUCH_MS) return;
    this.#touched = performance.now();
    this.connection.request("active");
  }

  /** Send a request and show what becomes of it. */
  async ask(text, what, fields) {
    this.actions.tell(text, "pending");
    const answer = await this.connection.request(what, fields);
    this.actions.tell(text, answer.outcome, answer.message);
    return answer;
  }

  /** A new connection knows nobody: log in again with what this page was told. */
  async connected() {
    if (!this.#credentials) return;
    const answer = await this.ask("Log in again", "login", this.#credentials);
    if (answer.outcome === "refused") this.#credentials = null; // one that is out of date is not tried for ever
    else if (answer.outcome !== "done" && this.connection.live) setTimeout(() => this.page.control.authenticated || this.connected(), AGAIN_MS);
  }

  /** @param {(() => Promise<Answer>)?} then what to do once logged in, and `purpose` its name */
  logIn(then = null, purpose = "") {
    const kind = this.page.hello?.login ?? "token";
    const name = textField("Name", { autocomplete: "off", maxLength: 32, pattern: NAME, title: "letters a to z, digits and . _ -", value: this.#credentials?.name ?? this.page.control.name ?? "" });
    const secret = textField(kind === "token" ? "Token" : "Password", { type: "password", autocomplete: "off", maxLength: 200 });
    openForm({
      title: purpose ? `Log in: ${purpose}` : "Log in",
      fields: [name, secret],
      summary: () => (purpose ? `${purpose} is sent as soon as you are logged in.` : kind === "token" ? "The token is printed where the server was started." : ""),
      confirm: purpose ? `Log in and ${purpose.toLowerCase()}` : "Log in",
      run: async () => {
        const credentials = { [kind]: kind === "token" ? secret.value : secret.input.value, name: name.value };
        const answer = await this.ask("Log in", "login", credentials);
        if (answer.outcome !== "done") return answer;
        this.#credentials = credentials;
        return then ? then() : answer;
      },
    });
  }

  safeStop() {
    if (!this.connection.live) return;
    const send = () => this.ask("Safe stop", "safe_stop");
    if (this.page.control.may_stop) send();
    else this.logIn(send, "Safe stop");
  }

  takeControl() {
    const { holder } = this.page.control;
    const take = () => this.ask("Take control", "take_control", { from: holder?.session ?? null });
    if (!holder) return take();
    return openForm({ title: "Take control", summary: () => `${holder.name} has control, has not answered, and loses it.`, confirm: `Take control from ${holder.name}`, run: take });
  }

  acknowledge(ids) {
    const many = ids.length === 1 ? "alarm" : `${ids.length} alarms`;
    this.ask(`Acknowledge ${many}`, "acknowledge", { ids });
  }

  switchController() {
    const { controllers = [], actual_controller: actual } = this.page.state ?? {};
    const remark = (one) => [one.name === actual ? "commands now" : one.ready ? "ready" : "not ready", one.reason].filter(Boolean).join(", ");
    const choice = choiceField("Controller", controllers.map((one) => ({ value: one.name, text: one.name, remark: remark(one) })), controllers.find((one) => one.name !== actual)?.name);
    const wait = selectField("Wait until it is ready", SWITCH_WAITS_S.map((value) => ({ value, text: `at most ${value} s` })), "2");
    openForm({
      title: "Swap the controller",
      fields: [choice, wait],
      summary: () => `${actual || "nobody"} → ${choice.value}`,
      confirm: "Swap",
      run: () => this.ask(`Swap to ${choice.value}`, "switch", { controller: choice.value, wait_s: Number(wait.value) }),
    });
  }

  changeMode() {
    const { hello, values, state } = this.page;
    const drive = (key, name, unit, step) => {
      const [low, high] = hello?.limits[key].range ?? [];
      return numberField(`${name} in manual`, unit, values[`command_${key}`]?.toFixed(1), low, high, step);
    };
    const force = drive("force_kn", "Force", "kN", "any");
    const speed = drive("speed_rpm", "Speed", "rpm", "any");
    const mode = choiceField("Mode", MODES, state?.actual_mode);
    const by = () => (mode.value === "manual" ? ` with ${force.input.value} kN and ${speed.input.value} rpm` : "");
    openForm({
      title: "Change the mode",
      fields: [mode, force, speed],
      summary: () => {
        for (const field of [force, speed]) field.root.hidden = field.input.disabled = mode.value !== "manual";
        return `${words(state?.actual_mode) || "unknown"} → ${words(mode.value)}${by()}`;
      },
      confirm: "Change mode",
      run: () => {
        const byHand = mode.value === "manual" ? { force_kn: force.value, speed_rpm: speed.value } : {};
        return this.ask(`Mode ${words(mode.value)}`, "mode", { mode: mode.value, ...byHand });
      },
    });
  }

  weld(action) {
    const send = () => this.ask(`${action} weld`, "weld", { action });
    if (action === "hold") return send();
    if (action === "resume") return resume(this, send);
    return openForm({ title: "Abort the weld", summary: () => "The programme ends and the weld goes into safe stop. This cannot be undone.", confirm: "Abort the weld", run: send });
  }

  #button(text, onclick) {
    return el("button", { type: "button", onclick }, text);
  }
}
