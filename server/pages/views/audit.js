// Who changed what, when and from where, as the service has kept it.
import { get } from "../api.js";
import { el, empty, fill, panel, problem, quiet, table } from "../dom.js";
import { when } from "../format.js";

const AT_ONCE = 200;

/** Details in words; checksums are long, and their beginning tells them apart. */
const worded = (details) => Object.entries(details).filter(([, v]) => v !== null && v !== "").map(([k, v]) => {
  const text = typeof v === "string" ? v : JSON.stringify(v);
  return `${k.replaceAll("_", " ")} ${text.length > 40 ? `${text.slice(0, /^[0-9a-f]+$/.test(text) ? 12 : 40)}…` : text}`;
}).join(", ");

export async function view(main, { asked }) {
  const away = new AbortController();
  const list = el("div");
  const told = el("div", { role: "status" });
  const more = el("div");
  const rows = [];
  const session = asked.session || "";
  fill(main, el("h1", {}, session ? `${session}: who changed what` : "Who changed what"),
    quiet("Every change is kept with the name of the token that asked for it. Each entry holds the checksum of the one before, and none is ever removed."),
    el("div", { class: "row no-print" }, el("button", { onclick: check }, "Check the trail"),
      el("a", { class: "button", href: `/api/v1/audit/export${session ? `?${new URLSearchParams({ session })}` : ""}`, download: "audit.jsonl" }, "As a file")),
    told, panel("", list, more));

  async function load() {
    try {
      const { entries } = await get("/audit", { session, after: rows.at(-1)?.number || 0, limit: AT_ONCE }, away.signal);
      rows.push(...entries);
      fill(more, entries.length < AT_ONCE ? null : el("button", { onclick: load }, "More"));
      fill(list, rows.length ? table([
        { title: "n", n: true, cell: (e) => e.number }, { title: "when", cell: (e) => when(e.at_utc) }, { title: "who", cell: (e) => e.who },
        { title: "from", cell: (e) => e.origin }, { title: "what", cell: (e) => e.what }, { title: "session", cell: (e) => e.about ?? "" },
        { title: "", wrap: true, cell: (e) => worded(e.details) },
      ], rows, { caption: "Oldest first", key: (e) => e.number }) : empty(el("p", {}, "Nothing was changed yet.")));
    } catch (error) {
      if (error.name !== "AbortError") fill(list, problem(error));
    }
  }

  async function check() {
    try {
      const { faults } = await get("/audit", { limit: 1, check: true }, away.signal);
      fill(told, el("p", { class: faults.length ? "bad" : "good" }, faults.length ? `Not as it was written: ${faults.join("; ")}.` : "Every entry is as it was written."));
    } catch (error) {
      if (error.name !== "AbortError") fill(told, problem(error));
    }
  }

  await load();
  return { leave: () => away.abort() };
}
