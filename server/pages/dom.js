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

/** A table: `columns` are {name, title, n (right-aligned), cell(row)}. */
export function table(columns, rows, { caption, pick, picked, key } = {}) {
  const head = el("tr", {}, columns.map((c) => el("th", { scope: "col", class: c.n ? "n" : "" }, c.title)));
  const body = rows.map((row) => {
    const name = key ? key(row) : null;
    const line = el("tr", pick ? { tabIndex: 0, role: "button", "aria-selected": String(name === picked) } : {},
      columns.map((c) => el("td", { class: c.n ? "n" : "" }, c.cell(row) ?? "–")));
    if (pick) {
      line.addEventListener("click", () => pick(row));
      line.addEventListener("keydown", (e) => { if (e.key === "Enter" || e.key === " ") { e.preventDefault(); pick(row); } });
    }
    return line;
  });
  return el("div", { class: "scroll" }, el("table", {}, caption ? el("caption", {}, caption) : null,
    el("thead", {}, head), el("tbody", {}, body)));
}

export function problem(error) {
  const text = error?.detail || error?.message || String(error);
  return el("p", { class: "problem", role: "alert" }, text);
}

export function notice(error, kind = "bad") {
  const box = el("div", {}, el("span", { class: kind }, error?.detail || error?.message || String(error)), " ",
    el("button", { onclick: () => box.remove() }, "Close"));
  document.getElementById("notices").append(box);
  setTimeout(() => box.remove(), 15000);
}

export const quiet = (text) => el("p", { class: "quiet" }, text);
export const empty = (...text) => el("div", { class: "empty" }, ...text);
export const panel = (title, ...children) => el("section", { class: "panel" }, title ? el("h2", {}, title) : null, ...children);
