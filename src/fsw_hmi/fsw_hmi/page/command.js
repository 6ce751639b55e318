// What an operator can do: log in, take control, command. Every request shows pending and then its answer.
import { el, panel, setText } from "./dom.js";
import { choiceField, closeForm, numberField, openForm, selectField, textField } from "./dialog.js";
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

export class Commands {
  /** @type {{token: string, name: string}?} */
  #credentials = null; // only here, so that a reload forgets them

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
    this.releaseButton = this.#button("Release control", () => this.ask("Release control", "release_control"));
    this.access.append(this.logInButton, this.takeButton, this.releaseButton);
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
    this.update();
  }

  /** Show what may be done now, and why not. */
  update() {
    const { hello, control, progress, state } = this.page;
    const live = this.connection.live;
    const { holder, you, authenticated } = control;
    const inForce = live && authenticated && you;
    const has = holder ? `${holder.name}${you ? " (you)" : ""} has control.` : "Nobody has control.";
    const why = hello?.commands === false ? " This server takes no commands." : !live ? " Not connected." : !authenticated ? " Log in to command." : inForce ? "" : " Take control to command.";
    setText(this.control, has + why);
    this.logInButton.hidden = authenticated || hello?.commands === false;
    this.takeButton.hidden = !authenticated || you;
    this.releaseButton.hidden = !you;
    for (const button of [this.logInButton, this.takeButton, this.releaseButton]) button.disabled = !live;
    for (const button of this.acting) button.disabled = !inForce;
    this.acknowledgeStopButton.hidden = state?.actual_mode !== "safe_stop" || state.acknowledged;
    for (const button of this.weldButtons) {
      button.disabled = !inForce;
      button.hidden = !progress;
    }
    for (const button of this.emulator) {
      button.disabled = !inForce;
      button.hidden = !hello?.emulator;
    }
    this.safeStopButton.disabled = !live;
    setText(this.safeStopButton.lastChild, live ? "Ctrl + ." : "not connected: stop at the machine");
    if (!live && you) closeForm(); // a login may go on
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
    if (answer.outcome === "refused") this.#credentials = null; // a token that is out of date is not tried for ever
  }

  /** @param {(() => Promise<Answer>)?} then what to do once logged in, and `purpose` its name */
  logIn(then = null, purpose = "") {
    const name = textField("Name", { autocomplete: "off", maxLength: 40, value: this.#credentials?.name ?? "" });
    const token = textField("Token", { type: "password", autocomplete: "off", maxLength: 200 });
    openForm({
      title: purpose ? `Log in: ${purpose}` : "Log in",
      fields: [name, token],
      summary: () => (purpose ? `${purpose} is sent as soon as you are logged in.` : "The token is printed where the server was started."),
      confirm: purpose ? `Log in and ${purpose.toLowerCase()}` : "Log in",
      run: async () => {
        const credentials = { token: token.value, name: name.value };
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
    return openForm({ title: "Take control", summary: () => `${holder.name} has control and loses it.`, confirm: `Take control from ${holder.name}`, run: take });
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
