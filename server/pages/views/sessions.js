// Sessions and specimens: list, search, begin one from a file, open, export.
import { at, get, post } from "../api.js";
import { el, empty, fill, notice, panel, problem, quiet, table } from "../dom.js";
import { when } from "../format.js";

export async function view(main) {
  const list = el("div");
  const found = el("input", { id: "search", type: "search", autocomplete: "off", oninput: () => draw() });
  const file = el("input", { id: "file", type: "file", accept: ".json,application/json", onchange: () => begin() });
  let rows = null;
  let specimens = [];

  fill(main, el("h1", {}, "Sessions"),
    panel(null, el("div", { class: "row" }, el("div", {}, el("label", { htmlFor: "search" }, "Search"), found),
      el("div", {}, el("label", { htmlFor: "file" }, "Begin one from a bench-session/1 as JSON"), file)),
    quiet("Folders with readings come in by the command line: fingertwin replay FOLDER --to this address; a bench sends its own: fingertwin log --to."),
    list), el("div", { id: "specimens" }));

  async function load() {
    try {
      rows = [];
      let after = "";
      do {
        const page = await get("/sessions", { limit: 500, after });
        rows.push(...page.sessions);
        after = page.next;
      } while (after);
      specimens = (await get("/specimens")).specimens;
      draw();
    } catch (error) {
      fill(list, problem(error), el("button", { onclick: load }, "Try again"));
    }
  }

  function draw() {
    const text = found.value.trim().toLowerCase();
    const shown = rows.filter((r) => `${r.id} ${r.specimen ?? ""}`.toLowerCase().includes(text));
    if (!rows.length) {
      fill(list, empty(el("p", {}, "No session yet."), el("p", {}, "Try a recorded one: "),
        el("p", {}, el("code", {}, `fingertwin replay DEV-02 --to ${location.origin}`))));
      return;
    }
    fill(list, shown.length ? table([
      { title: "session", cell: (r) => el("a", { href: `#/sessions/${encodeURIComponent(r.id)}/${r.source === "bench" && !r.closed_utc ? "bench" : "compare"}` }, r.id) },
      { title: "specimen", cell: (r) => r.specimen },
      { title: "from", cell: (r) => (r.source === "bench" ? (r.closed_utc ? "a bench" : "a bench, running") : "a document") },
      { title: "began", cell: (r) => when(r.created_utc) },
      { title: "streams", n: true, cell: (r) => String(r.streams) },
      { title: "export", cell: (r) => exports(r.id) },
    ], shown, { caption: `${shown.length} of ${rows.length} sessions` }) : quiet("Nothing matches."));
    fill(main.querySelector("#specimens"), specimens.length ? panel("Specimens", table([
      { title: "specimen", cell: (s) => s.id },
      { title: "model in force", cell: (s) => s.revision },
      { title: "how it came to be", cell: (s) => s.steps.at(-1).why },
      { title: "steps", n: true, cell: (s) => String(s.steps.length) },
    ], specimens)) : null);
  }

  function exports(id) {
    return el("select", { "aria-label": `Export ${id}`, onchange: (e) => {
      if (e.target.value) location.href = `/api/v1/sessions/${encodeURIComponent(id)}/export?format=${e.target.value}`;
      e.target.value = "";
    } }, el("option", { value: "" }, "as …"), ["csv", "parquet", "hdf5", "c3d", "mat", "folder", "supplement"].map((f) => el("option", { value: f }, f)));
  }

  async function begin() {
    const [given] = file.files;
    if (!given) return;
    try {
      const document_ = JSON.parse(await given.text());
      await post("/sessions", { id: document_.id, document: document_ });
      location.hash = `#/sessions/${encodeURIComponent(document_.id)}/compare`;
    } catch (error) {
      notice(error instanceof SyntaxError ? new Error(`${given.name} is no JSON (${error.message}); expected a bench-session/1.`) : error);
    }
    file.value = "";
  }

  await load();
  return { hear: (m) => { if (m.kind === "session" || m.kind === "revision") load(); } };
}
