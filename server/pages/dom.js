// Elements of the page from plain values; text is always text, never markup.

export function el(name, given = {}, ...children) {
  const node = document.createElement(name);
  for (const [key, value] of Object.entries(given)) {
    if (value === undefined || value === null || value === false) continue;
    if (key.startsWith("on")) node.addEventListener(key.slice(2), value);
    else if (key === "class") node.className = value;
    else if (key in node && key !== "list" && !key.startsWith("aria")) node[key] = value;
    else node.setAttribute(key, value === true ? "" : value);
  }
  node.append(...children.flat(Infinity).filter((c) => c !== null && c !== undefined && c !== false));
  return node;
}

export function fill(node, ...children) {
  node.replaceChildren(...children.flat(Infinity).filter((c) => c !== null && c !== undefined && c !== false));
  return node;
}

/**
 * A table: `columns` are {title, n (right-aligned), wrap (sentences), cell(row)}.
 *
 * With `pick`, a click anywhere in a row picks it; for the keyboard its first cell is a button.
 */
export function table(columns, rows, { caption, pick, picked, key } = {}) {
  const head = el("tr", {}, columns.map((c) => (c.title ? el("th", { scope: "col", class: c.n ? "n" : "" }, c.title) : el("td", { class: "head" }))));
  const body = rows.map((row) => {
    const name = key ? key(row) : null;
    const line = el("tr", pick ? { class: "pickable", "aria-current": name === picked ? "true" : null } : {},
      columns.map((c, i) => el("td", { class: c.n ? "n" : c.wrap ? "wrap" : "" }, pick && !i ? el("button", { class: "pick" }, c.cell(row)) : c.cell(row) ?? "–")));
    if (pick) line.addEventListener("click", () => pick(row));
    return line;
  });
  return el("div", { class: "scroll", tabIndex: 0, role: "region", "aria-label": caption || columns[0].title || "Table" }, el("table", {}, caption ? el("caption", {}, caption) : null,
    el("thead", {}, head), el("tbody", {}, body)));
}

export function problem(error) {
  const text = error?.detail || error?.message || String(error);
  return el("p", { class: "problem", role: "alert" }, text);
}

/** A word in passing, with something to do about it: `act` is [title, function]. */
export function notice(error, kind = "bad", act = null) {
  const box = el("div", { class: kind === "good" ? "toast" : "" }, el("span", { class: kind }, error?.detail || error?.message || String(error)), " ",
    act ? [el("button", { onclick: () => { box.remove(); act[1](); } }, act[0]), " "] : null,
    el("button", { onclick: () => box.remove() }, "Close"));
  document.getElementById("notices").append(box);
  setTimeout(() => box.remove(), 15000);
}

export const quiet = (text) => el("p", { class: "quiet" }, text);
/** The same of several parts. */
export const note = (...parts) => el("p", { class: "quiet" }, parts);
export const empty = (...text) => el("div", { class: "empty" }, ...text);
export const panel = (title, ...children) => el("section", { class: "panel" }, title ? el("h2", {}, title) : null, ...children);
