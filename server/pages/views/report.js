// The report of a session on paper: every section and figure, printed or saved as PDF by the browser itself.
import { at, get } from "../api.js";
import { el, fill, problem, quiet, table } from "../dom.js";
import { compact, masses, norm, number, percent, vector, when, within, withUnit, words } from "../format.js";
import { figure } from "../plot.js";
import { before } from "./answer.js";

// Of a figure on the screen; on paper it is scaled down to the page.
const WIDTH = 960;
const COMPARISON = [["scatter", "Force components of fitted cases"], ["scatter_validation", "Force components of validation cases"],
  ["vectors", "Tip forces in each posture"], ["bone", "Net forces on the metacarpal"], ["errors", "Where the errors are"], ["z", "Each case against its uncertainty"]];
const DIAGNOSIS = [["sensitivity", "Sensitivity analysis"], ["residual_map", "Where the model fails"], ["missing_torque", "The joint torque that is missing"], ["ranking", "Which explanation"],
  ["size", "Size of the effect"], ["confounding", "What cannot be told apart"], ["held_out", "Validation cases, before and after"]];

export async function view(main, { session, asked }) {
  const path = at("sessions", session);
  const away = new AbortController();
  const [searches, { revisions }] = await Promise.all([get(`${path}/diagnoses`, { limit: 50 }, away.signal), get(`${path}/revisions`, { limit: 500 }, away.signal)]);
  const jobs = searches.jobs.filter((j) => j.state === "done");
  const known = asked.job === "none" ? null : asked.job || jobs[0]?.id;
  const job = known ? await get(at("jobs", known), {}, away.signal) : null;
  const model = asked.model || revisions.find((r) => r.in_force)?.id || null;
  const body = await get(`${path}/comparison`, { model }, away.signal);
  const plane = body.judged_in === "sagittal" ? "sagittal" : "space";
  const state = el("p", { class: "quiet", role: "status" }, "Drawing the figures …");
  const go = el("button", { class: "main", disabled: true, onclick: () => print() }, "Print or save as PDF");
  const pictures = [];
  const picture = (kind, query) => { const place = el("div", { class: "sheet-figure" }); pictures.push([place, kind, query]); return place; };
  const part = (title, ...inner) => el("section", {}, el("h2", {}, title), inner);
  const sheet = el("article", { class: "sheet", "aria-label": `Report of ${session}` });
  fill(main, el("h1", { class: "no-print" }, `${session}: report`),
    el("div", { class: "row no-print" }, go, el("a", { class: "button", href: `/api/v1/sessions/${encodeURIComponent(session)}/report?${new URLSearchParams({ ...(job ? { job: job.id } : {}), ...(model ? { model } : {}) })}`, download: "" }, "Save as one HTML file"),
      jobs.length ? choose() : null), state, sheet);

  function choose() {
    return el("div", {}, el("label", { htmlFor: "job" }, "With the search of"), el("select", { id: "job", onchange: (e) => {
      location.hash = `#/sessions/${encodeURIComponent(session)}/report?${new URLSearchParams({ job: e.target.value, ...(asked.model ? { model: asked.model } : {}) })}`;
    } }, el("option", { value: "none", selected: !job }, "no search"), jobs.map((j) => el("option", { value: j.id, selected: j.id === job?.id }, when(j.created_utc)))));
  }

  const used = { session, model };
  const chain = revisions.find((r) => r.id === model);
  fill(sheet, el("p", { class: "title" }, `${session}: predicted and measured forces`),
    quiet(`Model ${body.model}; friction factor c = ${number(body.tension_factor, 3)}, ${body.tension_factor_source}; axes x proximal, y dorsal, z radial. Made ${when(new Date().toISOString())}.`),
    job?.result ? part("Verdict", el("p", { class: "verdict" }, job.result.sentence),
      job.result.probability_of ? el("p", {}, `Probability ${percent(job.result.probability)}: ${job.result.probability_of}.`) : null, before(job.result), suspects(job.result), job.result.reasons.map((r) => el("p", {}, r)), job.result.notes.map(quiet)) : null,
    part("Summary", body.notes.map(quiet), table([
      { title: "cases", cell: ([k]) => words(k).replace("/", " at the ") }, { title: "", cell: ([k]) => (k.startsWith("validation") ? "not fitted" : "fitted") },
      { title: "number", n: true, cell: ([, e]) => String(e[plane].cases) }, { title: "RMSE [N]", n: true, cell: ([, e]) => number(e[plane].rmse_N) },
      { title: "RMSE [%]", n: true, cell: ([, e]) => number(e[plane].rmse_rel_pct, 1) }, { title: "direction [deg]", n: true, cell: ([, e]) => number(e[plane].direction_error_deg, 1) },
    ], Object.entries(body.summary), { caption: plane === "sagittal" ? "In the sagittal plane, in which this finger is judged" : "In space" })),
    chain ? part("The fall of the error", picture("revisions/waterfall", { revision: chain.id })) : null,
    chain ? part("Before and after, on the finger", picture("comparison/vectors", { ...used, before: chain.parent })) : null,
    job?.result ? [DIAGNOSIS.map(([n, title]) => part(title, picture(`diagnosis/${n}`, { job: job.id }), n === "ranking" ? explanations(job.result) : null)), measureNext(job.result)] : null,
    COMPARISON.filter(([n]) => !(chain && n === "vectors")).map(([n, title]) => part(title, picture(`comparison/${n}`, used))),
    part("Load cases", table([
      { title: "case", cell: (c) => c.id }, { title: "role", cell: (c) => c.role.slice(0, 5) }, { title: "posture", cell: (c) => words(c.posture) }, { title: "at", cell: (c) => c.location },
      { title: "hung", cell: (c) => masses(c.masses_g) }, { title: "measured [N]", n: true, cell: (c) => vector(c.measured_N) }, { title: "predicted [N]", n: true, cell: (c) => vector(c.predicted_N) },
      { title: "|resid.| [N]", n: true, cell: (c) => number(norm(c.residual_N)) }, { title: "z", n: true, cell: (c) => compact(c.z) },
    ], body.cases)));

  // One after another: the service draws them as they are asked for.
  (async () => {
    for (const [place, kind, query] of pictures) {
      if (away.signal.aborted) return;
      await figure(place, kind, query, { signal: away.signal, width: WIDTH, still: true, colours: "light" });
    }
    if (away.signal.aborted) return;
    const failed = sheet.querySelector(".problem");
    fill(state, failed ? "Some figures could not be drawn; what is there can be printed." : "Ready. The browser's own dialogue prints it, or saves it as PDF.");
    go.disabled = false;
  })().catch((error) => fill(state, problem(error)));
  return { leave: () => away.abort() };
}

function suspects(body) {
  const like = (s) => (s.reads_like.length ? `; reads like: ${s.reads_like[0].words}` : "");
  const named = (body.suspects || []).map((s) => `${s.case} (${percent(s.probability)}${like(s)})`);
  const faults = (body.session_faults || []).map((f) => el("p", {}, `The whole session: ${f.words} (probability ${percent(f.probability)}).`));
  return [named.length ? el("p", {}, `Suspect load case${named.length > 1 ? "s" : ""}: ${named.join(", ")}.`) : null, faults];
}

function explanations(body) {
  return table([
    { title: "what is missing", cell: (r) => r.candidates.join(" + ") || (r.effects.length ? "something else" : "nothing") },
    { title: "probability", n: true, cell: (r) => percent(r.probability) }, { title: "ln evidence", n: true, cell: (r) => number(r.log_evidence_gain, 1) },
    { title: "value", wrap: true, cell: (r) => r.parameters.slice(0, 3).map((p) => withUnit(`${p.name} ${within(p.value, p.sd)}`, p.unit)).join("; ") },
    { title: "cannot be told from", wrap: true, cell: (r) => r.indistinguishable_from?.join(", ") || "" },
  ], body.ranking.filter((r) => r.log_evidence_gain !== null).slice(0, 10));
}

function measureNext(body) {
  return el("section", {}, el("h2", {}, "What to measure next"), el("p", {}, body.next_sentence), body.next_cases.length ? table([
    { title: "posture", cell: (c) => words(c.posture) }, { title: "at", cell: (c) => c.location }, { title: "hang", cell: (c) => masses(c.masses_g) }, { title: "parts", wrap: true, cell: (c) => c.separates.join(" / ") },
  ], body.next_cases) : null);
}
