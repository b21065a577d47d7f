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

/** Keep what was chosen in the page's address: loaded again, or come back to, it shows the same. Empty values leave it. */
export function keep(chosen) {
  const [path, query] = location.hash.split("?");
  const asked = new URLSearchParams(query || "");
  for (const [name, value] of Object.entries(chosen)) {
    if (value) asked.set(name, value);
    else asked.delete(name);
  }
  history.replaceState(null, "", asked.size ? `${path}?${asked}` : path);
}

/** By which column each table was sorted last: it is drawn anew, and stays so. */
const sorted = new Map();

/** What a cell sorts by: its number where it begins with one, else its text. */
function sortKey(cell) {
  const text = cell.textContent.trim().replaceAll("−", "-").replace(/^[<>] /, "");
  const number = parseFloat(text);
  return Number.isNaN(number) ? text.toLowerCase() : number;
}

/** Sort a table's rows by a column, up or down. */
function sortRows(body, column, down) {
  const rows = [...body.rows].map((row) => [sortKey(row.cells[column]), row]);
  const order = ([a], [b]) => (typeof a === typeof b ? (a < b ? -1 : a > b ? 1 : 0) : typeof a === "number" ? -1 : 1);
  rows.sort((a, b) => (down ? order(b, a) : order(a, b)));
  body.append(...rows.map(([, row]) => row));
}

/**
 * A table: `columns` are {title, n (right-aligned), wrap (sentences), cell(row)}. A click on a heading sorts by it.
 *
 * With `pick`, a click anywhere in a row picks it; for the keyboard its first cell is a button.
 */
export function table(columns, rows, { caption, pick, picked, key } = {}) {
  const name = `${location.hash.split("?")[0]} ${columns.map((c) => c.title).join()}`;
  const sortable = rows.length > 2;
  const sort = (column, down) => {
    sortRows(lines, column, down);
    for (const [i, cell] of [...head.cells].entries()) if (i === column) cell.setAttribute("aria-sort", down ? "descending" : "ascending"); else cell.removeAttribute("aria-sort");
  };
  const heading = (c, i) => (sortable ? el("button", { class: "sort", onclick: () => {
    const down = head.cells[i].getAttribute("aria-sort") === "ascending";
    sorted.set(name, [i, down]);
    sort(i, down);
  } }, c.title) : c.title);
  const head = el("tr", {}, columns.map((c, i) => (c.title ? el("th", { scope: "col", class: c.n ? "n" : "" }, heading(c, i)) : el("td", { class: "head" }))));
  const body = rows.map((row) => {
    const line = el("tr", pick ? { class: "pickable", "aria-current": (key ? key(row) : null) === picked ? "true" : null } : {},
      columns.map((c, i) => el("td", { class: c.n ? "n" : c.wrap ? "wrap" : "" }, pick && !i ? el("button", { class: "pick" }, c.cell(row)) : c.cell(row) ?? "–")));
    if (pick) line.addEventListener("click", () => pick(row));
    return line;
  });
  const lines = el("tbody", {}, body);
  if (sortable && sorted.has(name)) sort(...sorted.get(name));
  return el("div", { class: "scroll", tabIndex: 0, role: "region", "aria-label": caption || columns[0].title || "Table" }, el("table", {}, caption ? el("caption", {}, caption) : null,
    el("thead", {}, head), lines));
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
