// Forms over the page. They are not modal: the safe stop stays within reach of one click.
import { byId, el, renew, setText } from "./dom.js";

const PENDING = "… pending";
/** @type {{dialog: HTMLElement, opener: HTMLElement?, closed?: () => void}?} */ let opened = null;

/**
 * Show a form; only one is open at a time. It closes when `run()` resolves to "done".
 * @param {Form} form
 */
export function openForm({ title, fields = [], summary = () => "", lack = () => "", confirm, run,
    closed }) {
  closeForm();
  const heading = el("h2", { id: "dialog-title" }, title);
  const consequences = el("p", { className: "summary", "aria-live": "polite" });
  const answer = el("p", { className: "answer", role: "status" });
  const send = el("button", { type: "submit", className: "primary" }, confirm);
  const form = el("form", {}, el("div", { className: "fields" }, ...fields.map(
      (field) => field.root), consequences, answer), el("p", { className: "buttons" }, send,
      el("button", { type: "button", onclick: closeForm }, "Cancel")));
  const dialog = el("dialog", { "aria-labelledby": heading.id }, heading, form);
  const renew = () => {
    const text = summary();
    const wrong = [...form.querySelectorAll("input")].find(
        ({ validity }) => validity.rangeOverflow || validity.rangeUnderflow);
    send.title = wrong?.validationMessage ?? lack();
    send.disabled = Boolean(send.title) || answer.textContent === PENDING;
    setText(consequences, send.title || text);
  };
  form.addEventListener("input", renew);
  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    send.disabled = true;
    setText(answer, PENDING);
    const result = await run();
    send.disabled = false;
    setText(answer, result
        ? `${result.outcome === "refused" ? "✕ refused" : "? timed out"}: ${result.message}` : "");
    if (result?.outcome === "done" && opened?.dialog === dialog) closeForm();
  });
  dialog.addEventListener("keydown", (event) => event.key === "Escape" && closeForm());
  byId("dialogs").append(dialog);
  opened = { dialog, opener: /** @type {HTMLElement?} */ (document.activeElement), closed };
  renew();
  // the weld continues meanwhile
  const timer = setInterval(() => (dialog.isConnected ? renew() : clearInterval(timer)), 500);
  dialog.show();
}

export function closeForm() {
  if (!opened) return;
  const { dialog, opener, closed } = opened;
  opened = null;
  dialog.remove();
  closed?.();
  opener?.focus();
}

/**
 * Say something that wants an answer, beside a form that may be open, without taking the focus;
 * no key: no longer.
 * @param {string} key
 * @param {HTMLElement[]} buttons
 */
export function notice(key, text = "", ...buttons) {
  const root = byId("dialogs");
  const shown = /** @type {HTMLElement?} */ (root.querySelector(".notice:not(.end-screen)"));
  if (shown?.firstChild && shown.dataset.key === key) return setText(shown.firstChild, text);
  shown?.remove();
  if (!key) return;
  const dialog = el("dialog", { className: "notice", role: "alertdialog", "data-key": key,
      "aria-label": "Request for control" }, el("p", { "aria-live": "assertive" }, text),
      el("p", { className: "buttons" }, ...buttons));
  root.append(dialog);
  dialog.setAttribute("open", ""); // show() would take the focus
}

/** @type {string} */ let dismissed = "";

/**
 * The end screen, until it is closed; null: none.
 * @param {string} key what it is about
 * @param {{title: string, lines: string[]} | null} content
 */
export function endScreen(key, content) {
  const shown = /** @type {HTMLElement?} */ (byId("dialogs").querySelector(".end-screen"));
  if (!content || dismissed === key) {
    if (!content) dismissed = "";
    return shown?.remove();
  }
  const root = shown ?? el("dialog", { className: "notice end-screen",
      "aria-labelledby": "end-title" });
  renew(root, JSON.stringify(content), () => [
    el("h2", { id: "end-title" }, content.title),
    ...content.lines.map((line) => el("p", {}, line)),
    el("p", { className: "buttons" }, el("button",
        { type: "button", onclick: () => endScreen((dismissed = key), content) }, "Close")),
  ]);
  if (shown) return;
  byId("dialogs").append(root);
  root.setAttribute("open", ""); // show() would take the focus
}

function labelled(/** @type {string} */ text, /** @type {HTMLElement} */ input, hint = "") {
  return el("label", { className: "field" },
      el("span", {}, text, " ", el("span", { className: "detail" }, hint)), input);
}

/**
 * @param {string} text
 * @param {string} unit
 * @param {number | string} value
 * @param {number} low
 * @param {number} high
 * @param {number | "any"} step
 */
export function numberField(text, unit, value, low, high, step = "any") {
  const input = el("input", { type: "number", required: true, min: low, max: high, step, value,
      inputMode: "decimal" });
  const root = labelled(text, input, `${low} to ${high} ${unit}`);
  return {
    root,
    input,
    get value() { return input.valueAsNumber; },
    /** Show the field or hide it. */
    use(/** @type {boolean} */ shown) {
      root.hidden = input.disabled = !shown;
    },
  };
}

export function textField(/** @type {string} */ text, options = {}) {
  const input = el("input", { type: "text", required: true, maxLength: 100, ...options });
  return { root: labelled(text, input), input, get value() { return input.value.trim(); } };
}

export function checkField(/** @type {string} */ text, /** @type {boolean} */ checked) {
  const input = el("input", { type: "checkbox", checked });
  return { root: el("label", { className: "check" }, input, text),
      get value() { return input.checked; } };
}

export function selectField(/** @type {string} */ text, /** @type {Choice[]} */ choices,
    value = "") {
  const input = el("select", {}, ...choices.map((choice) =>
      el("option", { value: choice.value, selected: choice.value === value }, choice.text)));
  return { root: labelled(text, input), get value() { return input.value; } };
}

/**
 * Choices that are all in view, each with a remark.
 * @param {string} text
 * @param {Choice[]} choices
 */
export function choiceField(text, choices, value = "") {
  const inputs = choices.map((choice) => el("input",
      { type: "radio", name: "choice", value: choice.value, checked: choice.value === value }));
  const labels = choices.map((choice, i) => el("label", { className: "check" }, inputs[i],
      choice.text, " ", el("span", { className: "detail" }, choice.remark ?? "")));
  const root = el("fieldset", {}, el("legend", {}, text), ...labels);
  return { root, get value() { return inputs.find((input) => input.checked)?.value ?? ""; } };
}
