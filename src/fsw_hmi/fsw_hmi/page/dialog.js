// Forms over the page. They are not modal: the safe stop stays within reach of one click.
import { byId, el, setText } from "./dom.js";

/** @type {any} */
let opened = null;

/**
 * Show a form; only one is open at a time.
 *
 * `fields` are made by the functions below. `summary()` says what will be done; an empty text means that there is
 * nothing to do. `run()` resolves to `{outcome, message}`; the form closes when that is "done".
 * @param {Form} form
 */
export function openForm({ title, fields = [], summary = () => "", confirm, run, closed }) {
  closeForm();
  const opener = document.activeElement;
  const heading = el("h2", { id: "dialog-title" }, title);
  const told = el("p", { className: "summary", "aria-live": "polite" });
  const answer = el("p", { className: "answer", role: "status" });
  const send = el("button", { type: "submit", className: "primary" }, confirm);
  const cancel = el("button", { type: "button", onclick: closeForm }, "Cancel");
  const form = el("form", { noValidate: false }, ...fields.map((field) => field.root), told, answer, el("p", { className: "buttons" }, send, cancel));
  const dialog = el("dialog", { "aria-labelledby": heading.id }, heading, form);
  const renew = () => setText(told, summary());
  form.addEventListener("input", renew);
  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    send.disabled = true;
    setText(answer, "… pending");
    const { outcome, message } = await run();
    send.disabled = false;
    setText(answer, `${outcome === "refused" ? "✕ refused" : "? timed out"}: ${message}`);
    if (outcome === "done" && opened?.dialog === dialog) closeForm();
  });
  dialog.addEventListener("keydown", (event) => {
    if (event.key === "Escape") closeForm();
  });
  byId("dialogs").append(dialog);
  opened = { dialog, opener, closed };
  renew();
  dialog.show();
}

export function closeForm() {
  if (!opened) return;
  const { dialog, opener, closed } = opened;
  opened = null;
  dialog.remove();
  closed?.();
  opener?.focus?.();
}

/** Say something that wants an answer, beside a form that may be open, without taking the focus; null: no longer. */
export function notice(key, text, ...buttons) {
  const root = byId("dialogs");
  const shown = /** @type {HTMLElement?} */ (root.querySelector(".notice"));
  if (shown && shown.dataset.key === key) return setText(shown.firstChild, text);
  shown?.remove();
  if (!key) return;
  const dialog = el("dialog", { className: "notice", role: "alertdialog", "aria-label": "Request for control" }, el("p", { "aria-live": "assertive" }, text), el("p", { className: "buttons" }, ...buttons));
  dialog.dataset.key = key;
  root.append(dialog);
  dialog.setAttribute("open", ""); // show() would take the focus
}

function labelled(text, input, hint = "") {
  const note = hint ? [el("span", { className: "detail" }, hint)] : [];
  return el("label", { className: "field" }, el("span", {}, text, " ", ...note), input);
}

export function numberField(text, unit, value, low, high, step) {
  const input = el("input", { type: "number", required: true, min: low, max: high, step, value, inputMode: "decimal" });
  const root = labelled(text, input, `${low} to ${high} ${unit}`);
  return {
    root,
    input,
    get value() { return input.valueAsNumber; },
    /** Show the field or hide it, with the limits that hold now. */
    use(shown, lowest = low, highest = high, inUnit = unit) {
      root.hidden = !shown;
      Object.assign(input, { min: lowest, max: highest, disabled: !shown });
      root.querySelector(".detail").textContent = `${lowest} to ${highest} ${inUnit}`;
    },
  };
}

export function textField(text, options = {}) {
  const input = el("input", { type: "text", required: true, maxLength: 100, ...options });
  return { root: labelled(text, input), input, get value() { return input.value.trim(); } };
}

export function checkField(text, checked) {
  const input = el("input", { type: "checkbox", checked });
  return { root: el("label", { className: "check" }, input, text), input, get value() { return input.checked; } };
}

/** `choices` are `{value, text}`. */
export function selectField(text, choices, value) {
  const input = el("select", {}, ...choices.map((one) => el("option", { value: one.value, selected: one.value === value }, one.text)));
  return { root: labelled(text, input), input, get value() { return input.value; } };
}

/** Choices that are all in view, each with a remark. */
export function choiceField(text, choices, value) {
  const inputs = choices.map((one) => el("input", { type: "radio", name: "choice", value: one.value, checked: one.value === value }));
  const labels = choices.map((one, i) => el("label", { className: "check" }, inputs[i], one.text, " ", el("span", { className: "detail" }, one.remark ?? "")));
  const root = el("fieldset", {}, el("legend", {}, text), ...labels);
  return { root, get value() { return inputs.find((input) => input.checked)?.value ?? ""; } };
}
