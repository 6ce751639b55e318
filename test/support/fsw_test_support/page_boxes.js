// What is wrong with the layout of the page, by measured boxes: faults by kind, nothing where all
// is well.

/** @param {boolean} mayScroll whether the page may be higher than the screen */
function layoutFaults(mayScroll) {
  const found = {
    "too small for a finger": tooSmall(),
    clipped: clipped(),
    overfull: overfull(),
    overlapping: overlapping(),
    "stop hidden": stopHidden(),
    "verdict covered": verdictCovered(),
    "wider than the screen": document.documentElement.scrollWidth > innerWidth
        ? [document.documentElement.scrollWidth] : [],
    "higher than the screen": !mayScroll && document.documentElement.scrollHeight > innerHeight
        ? [document.documentElement.scrollHeight] : [],
  };
  return Object.fromEntries(Object.entries(found).filter(([, names]) => names.length));
}

const all = (what) => [...document.querySelectorAll(what)].filter(
    (one) => one.checkVisibility({ visibilityProperty: true }) && !one.closest(".hidden, #veil"));
const name = (one) =>
    `${one.tagName.toLowerCase()}#${one.id || one.className} "${one.textContent.slice(0, 40)}"`;
const isFixed = (one) => getComputedStyle(one).position === "fixed";

/**
 * The box of what is in view of an element, whatever scrolls or cuts it on the way up; null where
 * nothing is.
 */
function inView(one) {
  let { left, top, right, bottom } = one.getBoundingClientRect();
  for (let up = one; !isFixed(up) && (up = up.parentElement) && up !== document.body; ) {
    if (getComputedStyle(up).overflowY === "visible") continue;
    const box = up.getBoundingClientRect();
    [left, top, right, bottom] = [Math.max(left, box.left), Math.max(top, box.top),
        Math.min(right, box.right), Math.min(bottom, box.bottom)];
  }
  return right - left < 1 || bottom - top < 1 ? null : { left, top, right, bottom };
}

function tooSmall() {
  const controls = all("button, select, input").filter(
      (one) => one.type !== "radio" && one.type !== "checkbox");
  return controls.map((one) => [one, one.getBoundingClientRect()]).filter(
      ([, box]) => box.width < 44 || box.height < 44).map(([one]) => name(one));
}

/**
 * Texts that do not fit what holds them: the element itself where it cuts, else the panel, button
 * or form around.
 */
function clipped() {
  const own = all("body *").filter((one) =>
      [...one.childNodes].some((node) => node.nodeType === Node.TEXT_NODE && node.data.trim()));
  return own.filter((one) => {
    if (one.closest(".uplot, .reading, option")) return false;
    // ends in an ellipsis, and is whole where one points
    if (one.title && one.title === one.textContent) return false;
    if (getComputedStyle(one).overflowX !== "visible" && (one.scrollWidth > one.clientWidth + 1
        || one.scrollHeight > one.clientHeight + 1)) return true;
    const range = document.createRange();
    range.selectNodeContents(one);
    const text = range.getBoundingClientRect();
    const around = (one.closest("button, td, th, .scroll > *, .panel, #status > *, dialog")
        ?? document.body).getBoundingClientRect();
    return text.left < around.left - 1 || text.right > around.right + 1
        || text.top < around.top - 1 || text.bottom > around.bottom + 1;
  }).map(name);
}

/**
 * Panels, lists and forms whose content is wider than they are; panels do not scroll downwards
 * either.
 */
function overfull() {
  const wide = (one) => one.scrollWidth > one.clientWidth + 1;
  return all(".panel, .scroll, dialog").filter((one) => wide(one)
      || (one.matches(".panel") && one.scrollHeight > one.clientHeight + 1)).map(name);
}

/**
 * Controls, panels and texts over each other; what is fixed lies over what scrolls, and a form
 * over the page.
 */
function overlapping() {
  const named =
      all("button, select, input, .panel, #status > section, h2, #values p, .tick").filter(
      (one) => !isFixed(one) && !one.closest("dialog"));
  const boxes = named.map((one) => ({ one, box: inView(one) })).filter(({ box }) => box);
  const cross = (p, q) => p.left < q.right - 1 && q.left < p.right - 1 && p.top < q.bottom - 1
      && q.top < p.bottom - 1;
  const found = [];
  boxes.forEach(({ one: a, box: p }, i) => {
    for (const { one: b, box: q } of boxes.slice(i + 1)) if (
        !a.contains(b) && !b.contains(a) && cross(p, q)) found.push(`${name(a)} over ${name(b)}`);
  });
  return found;
}

/**
 * Whether the stop is whole on the screen with nothing over it, at the top, in the middle and at
 * the end of the page.
 */
function stopHidden() {
  const stop = document.querySelector("#safe-stop");
  const found = [];
  const whole = document.documentElement.scrollHeight - innerHeight;
  for (const at of [0, whole / 2, whole]) {
    scrollTo(0, at);
    const { left, top, right, bottom } = stop.getBoundingClientRect();
    if (left < 0 || top < 0 || right > innerWidth || bottom > innerHeight) found.push(
        `out of view at ${at}`);
    for (const x of [left + 8, (left + right) / 2, right - 8]) {
      for (const y of [top + 8, (top + bottom) / 2, bottom - 8]) {
        const above = document.elementFromPoint(x, y);
        if (!stop.contains(above)) found.push(`${above && name(above)} lies over it at ${at}`);
      }
    }
  }
  const below = isFixed(stop) ? all("button, .panel").filter((one) => one !== stop && !one.closest(
      "dialog") && inView(one)?.bottom > stop.getBoundingClientRect().top + 1) : [];
  scrollTo(0, 0);
  return [...found, ...below.map((one) => `${name(one)} cannot be scrolled out from under it`)];
}

/** Forms that lie over the verdict. */
function verdictCovered() {
  const verdict = document.querySelector("#verdict")?.getBoundingClientRect();
  return verdict ? all("dialog").filter(
      (one) => one.getBoundingClientRect().top < verdict.bottom).map(name) : [];
}

/** Where everything is that must not move, by name: panels, controls, numerals, charts. */
function places() {
  const fixed =
      all(
      "#status > *, .panel, #commands .acting button, #alarms > button, #values output, .scale, .toolbar button, .plot, .axis");
  return Object.fromEntries(fixed.map((one, i) => {
    const { x, y, width, height } = one.getBoundingClientRect();
    return [`${i} ${one.id || one.className}`,
        [x, y, one.matches("output") ? 0 : width, height].map(Math.round)];
  }));
}
