// Small helpers for the document. Styles are set through CSSOM: the content security policy
// forbids style attributes.

const SVG = "http://www.w3.org/2000/svg";

/**
 * Make an element; keys of `options` are properties, or attributes where the name has a dash or
 * is `role`.
 * @template {keyof HTMLElementTagNameMap} Tag
 * @param {Tag} tag
 * @param {Record<string, any>} options
 * @param {(Node | string)[]} children
 */
export function el(tag, options = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(options)) {
    if (name.includes("-") || name === "role") made.setAttribute(name, value);
    else Object.assign(made, { [name]: value });
  }
  made.append(...children);
  return made;
}

/**
 * @param {string} tag
 * @param {Record<string, string | number>} attributes
 * @param {Node[]} children
 */
export function svg(tag, attributes = {}, ...children) {
  const made = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, String(value));
  made.append(...children);
  return made;
}

/** What index.html has under this id. */
export const byId = (/** @type {string} */ id) =>
    /** @type {HTMLElement} */ (document.getElementById(id));

export const meta = (/** @type {string} */ name) =>
    /** @type {HTMLMetaElement} */ (document.querySelector(`meta[name="${name}"]`)).content;

/**
 * Set a text only if it differs, so that nothing is laid out or announced again without need.
 * @param {Node} node
 * @param {string} text
 */
export function setText(node, text) {
  if (node.textContent !== text) node.textContent = text;
}

/**
 * Set a text of which long ones are cut, so that the whole is found, too.
 * @param {HTMLElement} node
 * @param {string} text
 */
export function setShort(node, text) {
  setText(node, text);
  node.title = text;
}

/**
 * Replace the children only if `key` differs from that of the last call.
 * @param {HTMLElement} node
 * @param {string} key
 * @param {() => Node[]} makeChildren
 */
export function renew(node, key, makeChildren) {
  if (node.dataset.key === key) return;
  node.dataset.key = key;
  node.replaceChildren(...makeChildren());
}

/**
 * Put a node at a share of the length of what it is in.
 * @template {HTMLElement} Made
 * @param {Made} node
 * @param {number} share
 */
export function at(node, share) {
  node.style.setProperty("--at", `${(100 * share).toFixed(2)}%`);
  return node;
}

/**
 * A titled panel of the page.
 * @param {string} id
 * @param {string} title
 * @param {Node[]} children
 */
export function panel(id, title, ...children) {
  const heading = el("h2", { id: `${id}-title` }, title);
  return el("section", { id, className: "panel", "aria-labelledby": heading.id }, heading,
      ...children);
}

/** A list that scrolls, also by keys. @param {string} label @param {Node[]} children */
export const scroll = (label, ...children) => el(
    "div", { className: "scroll", tabIndex: 0, role: "region", "aria-label": label }, ...children);
