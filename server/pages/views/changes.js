// What was changed of a session, by whom, and each change's undo.
import { get, post, turns } from "../api.js";
import { el, fill, notice, problem, quiet, table } from "../dom.js";
import { masses, when, words } from "../format.js";

const NAMES = { windows: "window moved", exclude: "left out", include: "taken in again", amend: "amended", case: "load case added", plan: "proposed to measure", undo: "undone" };

/**
 * The list of changes; `edit` awaits a change, tells of it with an undo, and calls `done`.
 *
 * One's own change is shown at once, whatever was typed for it; what is typed while it is under way stays.
 * `begun` says that one begins, and gives what takes that back.
 */
export function changes(path, { begun, done }, signal) {
  const turn = turns();
  const list = el("div");
  const told = el("div", { role: "status" });
  const node = el("div", {}, told, list);

  async function edit(asked, text) {
    const back = begun();
    try {
      const made = await asked;
      document.querySelectorAll("#case input, #case textarea").forEach((e) => e.blur?.());
      document.getElementById("told")?.remove();
      const box = el("div", { id: "told", class: "toast", role: "status" }, "Changed, and computed anew. ", text ? `${text} ` : "",
        el("button", { onclick: () => undo(made.edit) }, "Undo"), " ", el("button", { onclick: () => box.remove() }, "Close"));
      document.getElementById("notices").append(box);
      signal.addEventListener("abort", () => box.remove());
      await done();
    } catch (error) {
      back();
      if (error.name !== "AbortError") notice(error);
    }
  }

  async function undo(number) {
    const back = begun();
    try {
      await post(`${path}/edits/${number}/undo`);
      document.getElementById("told")?.remove();
      await done();
    } catch (error) {
      back();
      notice(error);
    }
  }

  async function load() {
    const newest = turn();
    try {
      const { edits } = await get(`${path}/edits`, {}, signal);
      if (!newest()) return;
      const kept = edits.filter((e) => e.kind !== "undo").reverse();
      fill(list, kept.length ? table([
        { title: "when", cell: (e) => when(e.created_utc) }, { title: "what", cell: (e) => NAMES[e.kind] || e.kind }, { title: "case", cell: (e) => e.case },
        { title: "", wrap: true, cell: (e) => said(e) }, { title: "by", cell: (e) => e.author },
        { title: "", cell: (e) => (e.in_force ? el("button", { class: "small", "aria-label": `Undo: ${e.case} ${NAMES[e.kind]}`, onclick: () => undo(e.number) }, "Undo") : "undone") },
      ], kept, { caption: "Newest first; nothing is ever overwritten" }) : quiet("Nothing was changed since it was measured."));
    } catch (error) {
      if (error.name !== "AbortError") fill(list, problem(error));
    }
  }

  return { node, edit, load };
}

/** The changes by which a session differs from what a search took of it; what is proposed to measure is none. */
export function since(job, edits) {
  const undone = new Set();
  for (const e of edits.filter((x) => x.kind === "undo" && x.created_utc <= job.started_utc).reverse()) if (!undone.has(e.number)) undone.add(e.undoes);
  return edits.filter((e) => !["undo", "plan"].includes(e.kind) && e.in_force !== (e.created_utc <= job.started_utc && !undone.has(e.number)));
}

export const OUTDATED = "The session was changed since this search: search again.";

function said(e) {
  if (e.kind === "exclude") return e.body.reason;
  if (e.kind === "windows") return Object.entries(e.body).map(([k, v]) => `${k.replace("_s", "").replaceAll("_", " ")}: ${v ? `${v[0]} to ${v[1]} s` : "none"}`).join("; ");
  if (e.kind === "plan") return e.body.why || "";
  if (e.kind === "amend") return e.body.amendments.map((a) => `${a.case}: ${[a.masses_g ? masses(a.masses_g) : "", a.posture ? words(a.posture) : "", a.location ? `the cell at the ${a.location}` : ""].filter(Boolean).join(", ")}; ${a.why}`).join("; ");
  return "";
}
