// Find the missing effect: where it fails, what explains it and how surely, the verdict in a sentence, add and refit.
import { at, finished, get, post } from "../api.js";
import { el, empty, fill, notice, panel, problem, quiet, table } from "../dom.js";
import { compact, masses, number, percent, within, words } from "../format.js";
import { figure } from "../plot.js";
import { models } from "./models.js";

const FIGURES = [["ranking", "Which explanation"], ["residual_map", "Where the model fails"], ["missing_torque", "The joint torque that is missing"],
  ["confounding", "What cannot be told apart"], ["held_out", "Cases that were never fitted"]];
const VERDICTS = { found: "good", nothing_missing: "good", one_of: "warn", none_of_catalogue: "warn", undecided: "warn" };

export async function view(main, { session, asked }) {
  const path = at("sessions", session);
  const away = new AbortController();
  let model = asked.model || null;
  let running = null;
  let own = new Set();
  const work = el("div", { "aria-live": "polite" });
  const answer = el("div");
  const chosen = await models(session, model, (name) => { model = name; });
  const thorough = el("input", { type: "checkbox", id: "thorough" });
  const start = el("button", { class: "main", onclick: () => diagnose() }, "Find the missing effect");
  fill(main, el("h1", {}, `${session}: find the missing effect`),
    panel(null, el("div", { class: "row" }, chosen.node, el("label", { htmlFor: "thorough", class: "check" }, thorough, " thorough (up to a minute)"), start), work), answer, ownEffect());

  async function run(asked_, title) {
    start.disabled = true;
    try {
      const job = await asked_;
      running = job.id;
      const bar = el("progress", { max: 1, value: 0, "aria-label": title });
      const told = el("span", {});
      fill(work, el("p", {}, told), bar, el("button", { onclick: () => post(`${at("jobs", job.id)}/cancel`).catch(notice) }, "Cancel"));
      const done = await finished(job, (now) => {
        bar.value = now.progress;
        told.textContent = now.state === "queued" ? `${title}: waiting for a free worker …` : `${title}: ${now.stage || now.state} (${Math.round(100 * now.progress)} %)`;
      }, away.signal);
      if (done.state === "failed") fill(work, problem(done.problem));
      else if (done.state === "cancelled") fill(work, quiet("Cancelled."));
      else fill(work);
      return done.state === "done" ? done : null;
    } catch (error) {
      if (error.name !== "AbortError") fill(work, problem(error));
      return null;
    } finally {
      running = null;
      start.disabled = false;
    }
  }

  async function diagnose() {
    const done = await run(post(`${path}/diagnoses`, { model, thorough: thorough.checked, effects: [...own] }), "Fitting every effect");
    if (done) show(done);
  }

  async function add(names) {
    const done = await run(post(`${path}/revisions`, { add: names, model }), `Adding ${names.join(" and ")}, refitting`);
    if (done) location.hash = `#/sessions/${encodeURIComponent(session)}/fall?revision=${encodeURIComponent(done.result.model)}`;
  }

  function show(job) {
    const body = job.result;
    const plane = body.judged_in === "sagittal" ? "sagittal" : "space";
    const names = (body.ranking.find((r) => r.effects.length) || { candidates: [] }).candidates;
    const drawn = el("div");
    const which = el("select", { id: "figure", onchange: () => draw() }, FIGURES.map(([n, t]) => el("option", { value: n }, t)));
    const draw = () => figure(drawn, `diagnosis/${which.value}`, { job: job.id }, { signal: away.signal });
    const effect = el("div", { "aria-live": "polite" });
    fill(answer,
      panel("The verdict", el("p", { class: `verdict ${VERDICTS[body.verdict]}` }, body.sentence),
        body.reasons.map((r) => el("p", {}, r)),
        body.notes.map(quiet), body.robustness.flips_when.slice(0, 3).map((f) => quiet(`It would be another if ${f}.`)),
        body.robustness.rests_on?.length ? quiet(`It rests on ${body.robustness.rests_on.join(", ")}.`) : null,
        names.length ? el("button", { class: "main", onclick: () => add(names) }, `Add ${names.join(" and ")}, and refit`) : null, " ",
        el("a", { class: "button", href: `/api/v1/sessions/${encodeURIComponent(session)}/report?job=${job.id}` }, "Report as HTML")),
      panel("Error before and after, without and with it", table([
        { title: "cases", cell: ([k]) => words(k).replace("/", " at the ") }, { title: "", cell: ([k]) => (k.startsWith("validation") ? "never fitted" : "fitted") },
        { title: "RMSE before [N]", n: true, cell: ([, e]) => number(e[plane].rmse_N) }, { title: "after [N]", n: true, cell: ([k]) => number(body.after[k]?.[plane].rmse_N) },
      ], Object.entries(body.before))),
      panel(null, el("div", { class: "row" }, el("div", {}, el("label", { htmlFor: "figure" }, "Figure"), which)), drawn),
      panel("Explanations", ranking(body, effect), effect),
      panel("Tests that need no tendon points", body.nulls.filter((n) => n.verdict !== "not_tested").map((n) => el("p", {}, el("span", { class: n.verdict === "holds" ? "good" : "bad" }, n.verdict === "holds" ? "holds: " : "fails: "), n.text))),
      body.hints.length ? panel("Hints: a place and a formula", body.hints.map((h) => el("p", {}, h.text, " ", el("button", { onclick: () => keep({ formula: h.effect.formula }) }, "Take it in as an effect")))) : null,
      panel("What to measure next", quiet(body.next_sentence), body.next_cases.length ? table([
        { title: "posture", cell: (c) => words(c.posture) }, { title: "at", cell: (c) => c.location }, { title: "hang", cell: (c) => masses(c.masses_g) },
        { title: "tells [nat]", n: true, cell: (c) => number(c.information_nat, 2) }, { title: "parts", cell: (c) => c.separates.join(" / ") },
        { title: "", cell: (c) => el("button", { onclick: () => plan(c) }, "Onto the checklist") },
      ], body.next_cases) : null));
    draw();
  }

  function ranking(body, place) {
    const rows = body.ranking.filter((r) => r.log_evidence_gain !== null).slice(0, 12);
    return table([
      { title: "what is missing", cell: (r) => r.candidates.join(" + ") || (r.effects.length ? "something else" : "nothing") },
      { title: "probability", n: true, cell: (r) => el("span", {}, el("span", { class: "bar", style: `width:${Math.round(60 * r.probability)}px` }), " ", percent(r.probability)) },
      { title: "ln evidence", n: true, cell: (r) => number(r.log_evidence_gain, 1) },
      { title: "RMSE never fitted [N]", n: true, cell: (r) => number(r.validation_rmse_N.after) },
      { title: "value", cell: (r) => r.parameters.slice(0, 3).map((p) => `${p.name} ${within(p.value, p.sd)} ${p.unit}`).join("; ") },
      { title: "cannot be told from", cell: (r) => r.indistinguishable_from.join(", ") || "" },
    ], rows, { caption: `${body.candidates_searched} explanations searched; pick one to see what it would change in these very data`, pick: (r) => r.candidates.length && open(r, place), key: (r) => r.candidates.join("+") });
  }

  async function open(row, place) {
    const name = row.candidates[0].split(".")[0];
    const change = el("div");
    fill(place, quiet("Looking it up …"));
    try {
      const e = await get(at("effects", name), {}, away.signal);
      fill(place, el("h3", {}, `${row.candidates.join(" + ")}: ${e.title}`), el("p", {}, el("code", {}, e.formula)), el("p", {}, `Given away by: ${e.tell}`), quiet(`Source: ${e.source}`),
        change, el("button", { onclick: () => add(row.candidates) }, `Add ${row.candidates.join(" and ")}, and refit`));
      figure(change, `effect/${encodeURIComponent(row.candidates[0])}`, { session, model }, { signal: away.signal });
      place.scrollIntoView({ block: "nearest" });
    } catch (error) {
      if (error.name !== "AbortError") fill(place, problem(error));
    }
  }

  async function plan(c) {
    const kept = JSON.parse(localStorage.getItem(`next ${session}`) || "[]");
    kept.push({ posture: c.posture, location: c.location, masses_g: c.masses_g });
    localStorage.setItem(`next ${session}`, JSON.stringify(kept));
    notice(new Error(`${masses(c.masses_g)}, ${words(c.posture)}, ${c.location} is on the bench's checklist in this browser.`), "good");
  }

  function ownEffect() {
    const text = el("textarea", { id: "formula", spellcheck: false, placeholder: "torque[PIP] += k * t_EDC * sin(q_PIP)" });
    const said = el("div", { "aria-live": "polite" });
    text.value = sessionStorage.getItem("formula") || "";
    let timer = null;
    text.oninput = () => {
      sessionStorage.setItem("formula", text.value);
      clearTimeout(timer);
      timer = setTimeout(async () => {
        if (!text.value.trim()) return fill(said);
        try {
          const e = await post("/effects/check", { formula: text.value });
          fill(said, el("p", { class: "good" }, `Sound: ${e.stage}; ${e.parameters.map((p) => `${p.name} [${p.unit}] from ${compact(p.range?.[0])} to ${compact(p.range?.[1])}`).join(", ")}.`));
        } catch (error) { fill(said, problem(error)); }
      }, 300);
    };
    return panel("An effect of your own", quiet("A formula with one coefficient k. It is checked against a list of what it may use, and never run as code."),
      el("label", { htmlFor: "formula" }, "Formula"), text, said,
      el("button", { onclick: () => keep({ formula: text.value }) }, "Let it take part"));
  }

  async function keep(document_) {
    try {
      const e = await post("/effects", document_);
      own.add(e.name);
      notice(new Error(`${e.name} takes part in the next search.`), "good");
    } catch (error) { notice(error); }
  }

  try {
    const before = await get(`${path}/diagnoses`, { limit: 20 }, away.signal);
    const last = before.jobs.find((j) => ["queued", "running"].includes(j.state)) || before.jobs.find((j) => j.state === "done");
    if (last?.state === "done") show(await get(at("jobs", last.id), {}, away.signal));
    else if (last) run(Promise.resolve(last), "Fitting every effect").then((done) => done && show(done));
    else fill(answer, empty("Nothing was searched for yet. The search fits every effect of the catalogue, and pairs of them, to the fitted cases; cases that were never fitted judge."));
  } catch (error) {
    if (error.name !== "AbortError") fill(answer, problem(error));
  }
  return { leave: () => away.abort(), hear: (m) => { if (m.kind === "revision") chosen.refresh(); } };
}
