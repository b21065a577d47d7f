// Sessions and specimens: list, search, import a folder, open, export.
import { get, post, turns } from "../api.js";
import { el, empty, fill, notice, panel, problem, quiet, table } from "../dom.js";
import { when } from "../format.js";
import { dropZone, importing } from "./importing.js";
import { handed } from "./new.js";

const FORMATS = [["csv", "cases, CSV"], ["columns", "what the CSV's columns are"], ["xlsx", "cases, Excel"], ["parquet", "cases, Parquet"], ["hdf5", "cases and readings, HDF5"], ["mat", "cases and readings, MATLAB"],
  ["c3d", "the six channels, C3D"], ["folder", "the session's folder"], ["supplement", "supplement for a paper"]];

const EXAMPLE = "DEV-02";

export async function view(main) {
  const away = new AbortController();
  const list = el("div");
  const specimens = el("div");
  const found = el("input", { id: "search", type: "search", autocomplete: "off", oninput: () => draw() });
  let rows = [];
  let known = [];
  const turn = turns();
  let loaded = false;

  fill(main, el("h1", {}, "Sessions"),
    panel(null, el("div", { class: "row" }, el("div", {}, el("label", { htmlFor: "search" }, "Search by session or specimen"), found)), list),
    panel("New session from a recording", quiet("Drop what the rig recorded (CSV, TDMS, LVM, Parquet, Excel): it is drawn, columns and units are proposed, and your notebook is laid onto its plateaus."),
      el("div", { class: "row" }, el("a", { class: "button", href: "#/new" }, "Choose recordings"), dropZone("or drop them here", (files) => { handed(files); location.hash = "#/new"; }))),
    panel("Import a session", importing(away.signal)), specimens);

  async function load() {
    const newest = turn();
    try {
      const now = [];
      let after = "";
      do {
        const page = await get("/sessions", { limit: 500, after }, away.signal);
        now.push(...page.sessions);
        after = page.next;
      } while (after);
      const { specimens: whole } = await get("/specimens", {}, away.signal);
      if (!newest()) return;
      [rows, known] = [now, whole];
      loaded = true;
      draw();
    } catch (error) {
      if (error.name !== "AbortError") fill(list, problem(error), el("button", { onclick: load }, "Try again"));
    }
  }

  async function example(event) {
    event.target.disabled = true;
    try {
      await post(`/imports/examples/${EXAMPLE}`);
      if (!away.signal.aborted) location.hash = href(EXAMPLE, "compare");
    } catch (error) {
      event.target.disabled = false;
      notice(error);
    }
  }

  const href = (id, page) => `#/sessions/${encodeURIComponent(id)}/${page}`;

  function draw() {
    if (!loaded) return;
    const text = found.value.trim().toLowerCase();
    const shown = rows.filter((r) => `${r.id} ${r.specimen ?? ""}`.toLowerCase().includes(text));
    if (!rows.length) {
      fill(list, empty(el("p", {}, el("strong", {}, "No session yet.")), el("p", {}, el("button", { class: "main", onclick: example }, "Load an example")),
        el("p", {}, `${EXAMPLE} comes with the software: a recorded session with a hidden effect. Or choose a session's folder below.`)));
    } else {
      fill(list, shown.length ? table([
        { title: "session", cell: (r) => el("a", { href: href(r.id, r.closed ? "compare" : "bench") }, r.id) },
        { title: "specimen", cell: (r) => r.specimen },
        { title: "from", cell: from },
        { title: "began", cell: (r) => when(r.created_utc) },
        { title: "streams", n: true, cell: (r) => String(r.streams) },
        { title: "export", cell: (r) => exports(r.id) },
      ], shown, { caption: `${shown.length} of ${rows.length} sessions` }) : quiet(`No session or specimen is called anything like “${found.value.trim()}”.`));
    }
    fill(specimens, known.length ? panel("Specimens", table([
      { title: "specimen", cell: (s) => s.id },
      { title: "sessions", cell: (s) => rows.filter((r) => r.specimen === s.id).map((r, i) => [i ? ", " : "", el("a", { href: href(r.id, "fall") }, r.id)]) },
      { title: "model in force", cell: (s) => el("a", { href: `/api/v1/revisions/${encodeURIComponent(s.revision)}/document`, download: `${s.revision}.json` }, s.revision) },
      { title: "how it came to be", wrap: true, cell: (s) => s.steps.at(-1).why },
      { title: "steps", n: true, cell: (s) => String(s.steps.length) },
    ], known, { caption: "Each with the revision of its model that stands for it" })) : null);
  }

  /** A bench that was cut off is not closed either, so that nothing is said here of whether one runs. */
  function from(r) {
    if (r.source === "bench") return r.closed ? "a bench" : "a bench, not closed";
    return r.source === "document" ? "a document" : r.streams ? "a log without a protocol" : "nothing yet";
  }

  function exports(id) {
    const at = (format) => `/api/v1/sessions/${encodeURIComponent(id)}/export?format=${format}`;
    return el("details", { class: "menu" }, el("summary", { "aria-label": `Export ${id}` }, "as …"),
      el("ul", {}, FORMATS.map(([f, title]) => el("li", {}, el("a", { href: at(f), download: "" }, title))),
        el("li", {}, el("a", { href: href(id, "report") }, "report, HTML or PDF"))));
  }

  await load();
  return { leave: () => away.abort(), hear: (m) => { if (m.kind === "session" || m.kind === "revision") load(); }, link: (state) => { if (state === "live" && !loaded) load(); } };
}
