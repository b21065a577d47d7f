// The report of a session on paper: the page of the command line, printed or saved as PDF by the browser itself.
import { at, get } from "../api.js";
import { el, fill, problem } from "../dom.js";
import { when } from "../format.js";
import { plotted } from "../plot.js";
import { OUTDATED, since } from "./changes.js";

export async function view(main, { session, asked }) {
  const path = at("sessions", session);
  const away = new AbortController();
  const [searches, { revisions }, { edits }] = await Promise.all([get(`${path}/diagnoses`, { limit: 50 }, away.signal), get(`${path}/revisions`, { limit: 500 }, away.signal),
    get(`${path}/edits`, {}, away.signal)]);
  const jobs = searches.jobs.filter((j) => j.state === "done");
  const job = asked.job === "none" ? null : asked.job || jobs[0]?.id || null;
  const shown = jobs.find((j) => j.id === job);
  const model = asked.model || revisions.find((r) => r.in_force)?.id || null;
  const state = el("p", { class: "quiet", role: "status" }, "Drawing the figures …");
  const go = el("button", { class: "main", disabled: true, onclick: () => print() }, "Print or save as PDF");
  const sheet = el("article", { class: "sheet report", "aria-label": `Report of ${session}` });
  const query = { ...(job ? { job } : {}), ...(model ? { model } : {}) };
  fill(main, el("h1", { class: "no-print" }, `${session}: report`),
    el("div", { class: "row no-print" }, go, el("a", { class: "button", href: `/api/v1/sessions/${encodeURIComponent(session)}/report?${new URLSearchParams(query)}`, download: "" }, "Save as one HTML file"),
      jobs.length ? choose() : null),
    shown && since(shown, edits).length ? el("p", { class: "warn" }, OUTDATED) : null, state, sheet);

  function choose() {
    return el("div", {}, el("label", { htmlFor: "job" }, "With the search of"), el("select", { id: "job", onchange: (e) => {
      location.hash = `#/sessions/${encodeURIComponent(session)}/report?${new URLSearchParams({ job: e.target.value, ...(asked.model ? { model: asked.model } : {}) })}`;
    } }, el("option", { value: "none", selected: !job }, "no search"), jobs.map((j) => el("option", { value: j.id, selected: j.id === job }, when(j.created_utc)))));
  }

  const folds = (open) => sheet.querySelectorAll("details").forEach((d) => { d.open = open; });
  addEventListener("beforeprint", () => folds(true), { signal: away.signal });

  const body = await get(`${path}/report/sheet`, query, away.signal);
  // The service has escaped every text in it, and no script in it would run.
  sheet.innerHTML = body.html;
  (async () => {
    const places = sheet.querySelectorAll(".plot");
    for (const [i, figure] of body.figures.entries()) {
      if (away.signal.aborted) return;
      await plotted(places[i], figure);
    }
    folds(false);
    fill(state, "Ready. The browser's own dialogue prints it, or saves it as PDF.");
    go.disabled = false;
  })().catch((error) => fill(state, problem(error)));
  return { leave: () => away.abort() };
}
