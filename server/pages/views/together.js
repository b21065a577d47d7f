// Several sessions together: what they share, also a law that is in no catalogue.
import { get, post } from "../api.js";
import { el, empty, fill, panel, problem, quiet, table } from "../dom.js";
import { number, percent, withUnit } from "../format.js";
import { figure } from "../plot.js";
import { awaited } from "./work.js";

const FEWEST = 2;

export async function view(main) {
  const away = new AbortController();
  const list = el("div");
  const place = el("div", { "aria-live": "polite" });
  const answer = el("div");
  const chosen = new Set();
  const start = el("button", { class: "primary", disabled: true, onclick: () => diagnose() }, "Diagnose together");
  fill(main, el("h1", {}, "Several sessions together"),
    quiet("Sessions of specimens that were loaded in the same way: which effect all have, and what they miss alike that no effect describes."),
    panel("Sessions", list, el("div", { class: "row" }, start), place), answer);

  try {
    const rows = (await get("/sessions", { limit: 500 }, away.signal)).sessions;
    const box = (r) => el("input", { type: "checkbox", "aria-label": `Take ${r.id}`, onchange: (e) => {
      if (e.target.checked) chosen.add(r.id); else chosen.delete(r.id);
      start.disabled = chosen.size < FEWEST;
    } });
    fill(list, rows.length ? table([
      { title: "", cell: box }, { title: "session", cell: (r) => r.id }, { title: "specimen", cell: (r) => r.specimen },
    ], rows, { caption: "Two or more; three show whether one alone carries it" }) : empty(el("p", {}, "No session yet.")));
  } catch (error) {
    if (error.name !== "AbortError") fill(list, problem(error));
  }

  async function diagnose() {
    start.disabled = true;
    fill(answer);
    const asked = post("/diagnoses", { sessions: [...chosen], model: null });
    const job = await awaited(place, asked, "Diagnosing the sessions", away.signal, diagnose);
    start.disabled = chosen.size < FEWEST;
    if (!job || away.signal.aborted) return;
    const body = job.result;
    fill(answer, ...told(body));
    if (body.shared) {
      for (const name of ["shared_curve", "shared_chance"]) {
        figure(answer.querySelector(`[data-figure=${name}]`), `shared/${name}`, { job: job.id }, { signal: away.signal });
      }
    }
  }

  return { leave: () => away.abort() };
}

function told(body) {
  const shared = body.shared;
  const of = (name) => `#/sessions/${encodeURIComponent(name)}/find`;
  return [
    panel("Which effect all have", el("p", { class: "verdict" }, body.sentence), body.short.map((s) => quiet(`Short of more: ${s}.`)),
      body.ranking.length ? table([
        { title: "effect", cell: (r) => r.candidates.join(" + ") }, { title: "probability", n: true, cell: (r) => percent(r.probability) },
        { title: "ln evidence, one size", n: true, cell: (r) => number(r.log_evidence_gain, 1) }, { title: "own sizes", n: true, cell: (r) => number(r.log_evidence_gain_own_sizes, 1) },
      ], body.ranking.slice(0, 8), { caption: `Nothing shared: ${percent(body.p_nothing_shared)}` }) : null),
    shared ? panel("What they miss alike, beyond the catalogue", el("p", { class: "verdict" }, shared.sentence),
      shared.lacking.length ? el("p", {}, `It does not help ${shared.lacking.join(", ")}.`) : null,
      el("div", { "data-figure": "shared_curve" }), el("div", { "data-figure": "shared_chance" })) : null,
    shared && shared.laws.length ? panel("Which law it resembles", laws(body.sessions, shared.laws)) : null,
    shared && shared.would_decide.readings.length ? panel("What would decide", el("p", {}, `On a specimen like ${shared.would_decide.on}, by expected information:`),
      el("ul", {}, shared.would_decide.readings.map((r) => el("li", {}, r.text)))) : null,
    panel("Each by itself", table([
      { title: "session", cell: ([name]) => el("a", { href: of(name) }, name) }, { title: "", wrap: true, cell: ([, one]) => one.sentence },
    ], Object.entries(body.each))),
  ];
}

function laws(sessions, found) {
  const fall = (e) => (e ? `${number(e.before, 3)} → ${number(e.after, 3)}` : "–");
  const left = (name) => ({ title: `left out: ${name}`, wrap: true, cell: (law) => {
    const errors = law.unseen_rmse_N[name] || {};
    return `${number(law.left_out_gain[name], 1)} nat${Object.entries(errors).map(([at, e]) => `; ${at} ${fall(e)}`).join("")}`;
  } });
  return table([
    { title: "law", wrap: true, cell: (law) => law.formula + (law.rivals.length ? ` (${law.rivals.length} more alike)` : "") },
    { title: "value of all", cell: (law) => withUnit(`${number(law.value, 3)} ± ${number(law.sd, 2)}`, law.unit) },
    ...sessions.map(left),
  ], found, { caption: "Each learned from the other sessions: ln density that it adds to the one left out, and RMSE [N] of its validation forces. Alike: laws that these load cases cannot part from it" });
}
