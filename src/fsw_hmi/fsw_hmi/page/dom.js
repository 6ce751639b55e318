// Small helpers for the document. Styles are set through CSSOM: the content security policy forbids style attributes.

const SVG = "http://www.w3.org/2000/svg";

/** Make an element; keys of `options` are properties, or attributes where the name has a dash or is `role`. */
export function el(tag, options = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(options)) {
    if (name.includes("-") || name === "role") made.setAttribute(name, value);
    else made[name] = value;
  }
  made.append(...children);
  return made;
}

export function svg(tag, attributes = {}, ...children) {
  const made = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  made.append(...children);
  return made;
}

/** What index.html has under this id. */
export const byId = (/** @type {string} */ id) => /** @type {HTMLElement} */ (document.getElementById(id));

export const meta = (/** @type {string} */ name) => /** @type {HTMLMetaElement} */ (document.querySelector(`meta[name="${name}"]`)).content;

/** Set a text only if it differs, so that nothing is laid out or announced again without need. */
export function setText(node, text) {
  if (node.textContent !== text) node.textContent = text;
}

/** Replace the children only if `key` differs from that of the last call. */
export function renew(node, key, makeChildren) {
  if (node.dataset.key === key) return;
  node.dataset.key = key;
  node.replaceChildren(...makeChildren());
}

/** A titled panel of the page. */
export function panel(id, title, ...children) {
  const heading = el("h2", { id: `${id}-title` }, title);
  return el("section", { id, className: "panel", "aria-labelledby": heading.id }, heading, ...children);
}
