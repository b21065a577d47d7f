// Several sessions together: what they share, also a law that is in no catalogue.
import { at, get, post } from "../api.js";
import { el, empty, fill, panel, problem, quiet, table } from "../dom.js";
import { masses, number, percent, when, withUnit, words } from "../format.js";
import { figure } from "../plot.js";
import { before } from "./answer.js";
import { awaited } from "./work.js";

const FEWEST = 2;
// Of so many newest jobs those of several sessions are offered again.
const JOBS = 200;

export async function view(main, { asked }) {
  const away = new AbortController();
  const list = el("div");
  const place = el("div", { "aria-live": "polite" });
  const earlierOnes = el("div");
  const answer = el("div");
  const chosen = new Set();
  const start = el("button", { class: "main", disabled: true, onclick: () => diagnose() }, "Diagnose together");
  fill(main, el("h1", {}, "Several sessions together"),
    quiet("Sessions of specimens that were loaded in the same way: which effect all have, and what they miss alike that no effect describes."),
    panel("Sessions", list, el("div", { class: "row" }, start), earlierOnes, place), answer);

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

  async function earlier() {
    const { jobs } = await get("/jobs", { limit: JOBS }, away.signal);
    const pooled = jobs.filter((j) => j.kind === "pooled" && ["queued", "running", "done"].includes(j.state));
    fill(earlierOnes, pooled.length ? el("details", {}, el("summary", {}, `Diagnosed before (${pooled.length})`), el("ul", {}, pooled.map((j) =>
      el("li", {}, el("a", { href: address(j.id) }, j.request.sessions.join(", ")), ` ${when(j.created_utc)}${j.state === "done" ? "" : ` (${j.state})`}`)))) : null);
  }

  async function diagnose() {
    start.disabled = true;
    fill(answer);
    const job = post("/diagnoses", { sessions: [...chosen], model: null });
    // The address keeps the job: loaded again, the page shows the same answer.
    job.then(({ id }) => history.replaceState(null, "", address(id)), () => {});
    await show(job, diagnose);
    start.disabled = chosen.size < FEWEST;
    if (!away.signal.aborted) await earlier();
  }

  async function show(asking, again) {
    fill(answer);
    const job = await awaited(place, asking, "Diagnosing the sessions", away.signal, again);
    if (!job || away.signal.aborted) return;
    const body = job.result;
    fill(answer, ...told(body));
    if (body.shared) {
      for (const drawn of answer.querySelectorAll("[data-figure]")) figure(drawn, `shared/${drawn.dataset.figure}`, { job: job.id }, { signal: away.signal });
    }
  }

  const kept = (id) => show(get(at("jobs", id), {}, away.signal));
  await earlier();
  if (asked.job) kept(asked.job);
  return { leave: () => away.abort(), asked: ({ job }) => { if (job) kept(job); } };
}

const address = (job) => `#/together?job=${encodeURIComponent(job)}`;

function told(body) {
  const shared = body.shared;
  const of = (name) => `#/sessions/${encodeURIComponent(name)}/find`;
  return [
    before(body),
    panel("Which effect all have", el("p", { class: "verdict" }, body.sentence), body.short.map((s) => quiet(`Short of more: ${s}.`)),
      body.ranking.length ? table([
        { title: "effect", cell: (r) => r.candidates.join(" + ") }, { title: "probability", n: true, cell: (r) => percent(r.probability) },
        { title: "ln evidence, one size", n: true, cell: (r) => number(r.log_evidence_gain, 1) }, { title: "own sizes", n: true, cell: (r) => number(r.log_evidence_gain_own_sizes, 1) },
      ], body.ranking.slice(0, 8), { caption: `Nothing shared: ${percent(body.p_nothing_shared)}` }) : null),
    shared ? panel("What they miss alike, beyond the catalogue", el("p", { class: "verdict" }, shared.sentence),
      shared.lacking.length ? el("p", {}, `It does not help ${shared.lacking.join(", ")}.`) : null,
      el("div", { "data-figure": "shared_curve" }), el("div", { "data-figure": "shared_chance" })) : null,
    shared && shared.laws.length ? panel("Which law it resembles", laws(body.sessions, shared.laws), el("div", { "data-figure": "shared_law" })) : null,
    shared && shared.laws.length ? panel("What would decide", ...deciding(shared.would_decide)) : null,
    panel("Each by itself", table([
      { title: "session", cell: ([name]) => el("a", { href: of(name) }, name) }, { title: "", wrap: true, cell: ([, one]) => one.sentence },
    ], Object.entries(body.each))),
  ];
}

function laws(sessions, found) {
  const fall = (e) => (e ? `${number(e.before, 3)} → ${number(e.after, 3)}` : "–");
  const left = found.flatMap((law) => sessions.map((name) => ({ law, name, errors: law.unseen_rmse_N[name] || {} })));
  return [table([
    { title: "law", wrap: true, cell: (law) => law.formula },
    { title: "value of all", cell: (law) => withUnit(`${number(law.value, 3)} ± ${number(law.sd, 2)}`, law.unit) },
    { title: "agreement", n: true, cell: (law) => number(law.agreement, 2) },
    { title: "not to be parted from", wrap: true, cell: (law) => law.rivals.slice(0, 4).join("; ") },
  ], found, { caption: "One coefficient k for all sessions. Agreement: mean squared distance of the sessions' own values from the common one, 1 is chance" }),
  table([
    { title: "law", wrap: true, cell: (r) => r.law.formula }, { title: "left out", cell: (r) => r.name },
    { title: "gain [nat]", n: true, cell: (r) => number(r.law.left_out_gain[r.name], 1) },
    { title: "tip [N]", n: true, cell: (r) => fall(r.errors.tip) }, { title: "bone [N]", n: true, cell: (r) => fall(r.errors.bone) },
  ], left, { caption: "Each law learned from the other specimens: ln density that it adds to the one left out, and RMSE of its validation forces, before → after" })];
}

function deciding(found) {
  if (!found.readings.length) return [quiet("No load case that this rig has shown parts these laws.")];
  return [found.between?.length ? el("p", {}, `Held against each other: ${found.between.join("; ")}.`) : null, table([
    { title: "posture", cell: (r) => words(r.posture) }, { title: "at", cell: (r) => r.location }, { title: "hang", cell: (r) => masses(r.masses_g) },
    { title: "read", wrap: true, cell: (r) => r.reading }, { title: "information [nat]", n: true, cell: (r) => number(r.information_nat, 2) },
  ], found.readings, { caption: `On a specimen like ${found.on}, best first. Information: what a reading is expected to tell of the law; 0.69 nat (ln 2) decide between two that are equally probable` })];
}
