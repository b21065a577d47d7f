// What a search found: the verdict in a sentence, where the model fails, what explains it, what to measure next.
import { el, panel, quiet, table } from "../dom.js";
import { masses, number, percent, within, withUnit, words } from "../format.js";
import { figure } from "../plot.js";

const FIGURES = [["residual_map", "Where the model fails"], ["missing_torque", "The joint torque that is missing"], ["ranking", "Which explanation"],
  ["confounding", "What cannot be told apart"], ["held_out", "Cases that were never fitted"]];
const COLOURS = { found: "good", nothing_missing: "good", one_of: "warn", none_of_catalogue: "warn", undecided: "warn" };
const name = (r) => r.candidates.join(" + ") || (r.effects.length ? "something else" : "nothing is missing");

export function answer(job, { session, model, add, keep, planned, signal }) {
  const body = job.result;
  const plane = body.judged_in === "sagittal" ? "sagittal" : "space";
  const best = (body.ranking.find((r) => r.candidates.length) || { candidates: [] }).candidates;
  // Of several that cannot be told apart, the one that the verdict names first.
  const names = body.verdict === "found" ? body.candidates : best;
  const drawn = el("div", { class: "drawn" });
  const base = `#/sessions/${encodeURIComponent(session)}`;
  const draw = () => figure(drawn, `diagnosis/${which.value}`, { job: job.id }, { signal, picked: (cases) => {
    location.hash = `${base}/compare?${new URLSearchParams(cases.length > 1 ? { cases: cases.join(",") } : { case: cases[0] })}`;
  } });
  const which = el("select", { id: "figure", onchange: draw }, FIGURES.map(([n, t]) => el("option", { value: n }, t)));
  const link = (r) => `${base}/effect?${new URLSearchParams({ name: r.candidates.join(","), job: job.id, ...(model() ? { model: model() } : {}) })}`;
  const sure = body.verdict === "found" || body.verdict === "one_of";
  const out = [
    panel("The verdict", el("p", { class: `verdict ${COLOURS[body.verdict] || ""}` }, body.sentence),
      body.reasons.map((r) => el("p", {}, r)), body.notes.map(quiet),
      body.robustness.flips_when.slice(0, 3).map((f) => quiet(`It would be another if ${f}.`)),
      body.robustness.rests_on?.length ? quiet(`It rests on ${body.robustness.rests_on.join(", ")}.`) : null,
      body.confirmation ? el("p", {}, `Predictions made beforehand: ${body.confirmation.text}.`) : null,
      el("div", { class: "row no-print" },
        names.length ? el("button", { class: sure ? "main" : "", onclick: () => add(names) }, `Add ${names.join(" and ")}, and refit`) : null,
        names.length ? el("a", { class: "button", href: link({ candidates: names }) }, "What is that?") : null,
        el("a", { class: "button", href: `${base}/report?job=${encodeURIComponent(job.id)}` }, "Report, to print or save"))),
    panel("Error before and after", table([
      { title: "cases", cell: ([k]) => words(k).replace("/", " at the ") }, { title: "", cell: ([k]) => (k.startsWith("validation") ? "never fitted" : "fitted") },
      { title: "RMSE before [N]", n: true, cell: ([, e]) => number(e[plane].rmse_N) }, { title: "after [N]", n: true, cell: ([k]) => number(body.after[k]?.[plane].rmse_N) },
    ], Object.entries(body.before), { caption: best.length ? `Refitted both times: without, and with ${best.join(" + ")}` : "With nothing added, refitted" })),
    panel(null, el("div", { class: "row no-print" }, el("div", {}, el("label", { htmlFor: "figure" }, "Figure"), which), quiet("A click on a cell or a point leads to its load cases.")), drawn),
    panel("Explanations", ranking(body, link)),
    panel("Tested and ruled out", ruledOut(body, link)),
    panel("Tests that need no tendon points", body.nulls.filter((n) => n.verdict !== "not_tested").map((n) =>
      el("p", {}, el("strong", { class: n.verdict === "holds" ? "good" : "bad" }, n.verdict === "holds" ? "holds: " : "fails: "), n.text)),
    body.nulls.every((n) => n.verdict === "not_tested") ? quiet("This session's load cases allow none.") : null),
    body.ready_made?.length ? panel("Known to happen in rigs, outside the catalogue", body.ready_made.map((k) => el("p", {}, k.text, `; probability ${percent(k.probability)}. `,
      el("button", { class: "small", onclick: () => add([k.effect]) }, `Add ${k.effect}, and refit`)))) : null,
    body.hints.length ? panel("Hints: a place and a formula", body.hints.map((h) => el("p", {}, h.text, " ", el("code", {}, h.effect.formula), " ",
      el("button", { class: "small", onclick: () => keep({ formula: h.effect.formula }) }, "Take it in as an effect")))) : null,
    panel("What to measure next", quiet(body.next_sentence), body.next_cases.length ? next(body, planned) : null,
      body.instruments.length ? el("p", {}, `Or: ${body.instruments.join("; ")}.`) : null),
  ];
  queueMicrotask(draw);
  return out;
}

function ranking(body, link) {
  const rows = body.ranking.filter((r) => r.log_evidence_gain !== null && (r.probability >= 0.01 || !r.effects.length)).slice(0, 12);
  return table([
    { title: "what is missing", cell: (r) => (r.candidates.length ? el("a", { href: link(r) }, name(r)) : name(r)) },
    { title: "probability", n: true, cell: (r) => el("span", {}, el("span", { class: "bar", style: `width:${Math.round(60 * r.probability)}px`, "aria-hidden": "true" }), " ", percent(r.probability)) },
    { title: "ln evidence", n: true, cell: (r) => number(r.log_evidence_gain, 1) },
    { title: "RMSE never fitted [N]", n: true, cell: (r) => number(r.validation_rmse_N.after) },
    { title: "value", wrap: true, cell: (r) => values(r) },
    { title: "cannot be told from", wrap: true, cell: (r) => r.indistinguishable_from?.join(", ") || "" },
  ], rows, { caption: `${body.candidates_searched} explanations searched; of simulated sessions like this one without any effect, ${percent(body.false_finding_rate)} were given one. A name leads to what the effect is.` });
}

function ruledOut(body, link) {
  const kept = new Set(body.ranking.filter((r) => r.probability >= 0.01).flatMap((r) => r.candidates));
  const rows = body.ranking.filter((r) => r.candidates.length === 1 && !(r.probability >= 0.01) && !kept.has(r.candidates[0]));
  const best = body.ranking.find((r) => r.log_evidence_gain !== null && r.effects.length);
  if (!rows.length) return quiet("Nothing: every effect that was tested is still possible.");
  return table([
    { title: "effect", cell: (r) => el("a", { href: link(r) }, r.candidates[0]) },
    { title: "why not", wrap: true, cell: (r) => why(r, best) },
    { title: "its value, fitted by itself", wrap: true, cell: (r) => values(r) },
  ], rows.slice(0, 40), { caption: `${rows.length} single effects, each fitted by itself` });
}

const values = (r) => r.parameters.slice(0, 3).map((p) => withUnit(`${p.name} ${within(p.value, p.sd)}`, p.unit)).join("; ");

function why(r, best) {
  if (r.in_range === false) return "it would need a value beyond what is plausible";
  if (r.log_evidence_gain === null) return "it falls so far behind the others that it was weighed no further";
  if (r.log_evidence_gain <= 0) return "the readings are explained no better with it than with nothing";
  if (best?.log_evidence_gain !== null && best) return `${best.candidates.join(" + ") || "another"} explains the same readings better by ${number(best.log_evidence_gain - r.log_evidence_gain, 1)} in ln evidence`;
  return "it is less probable than 1 %";
}

function next(body, planned) {
  const body_ = (c) => ({ posture: c.posture, location: c.location, masses_g: c.masses_g, why: c.text });
  return table([
    { title: "posture", cell: (c) => words(c.posture) }, { title: "at", cell: (c) => c.location }, { title: "hang", cell: (c) => masses(c.masses_g) },
    { title: "tells [nat]", n: true, cell: (c) => number(c.information_nat, 2) }, { title: "then sure", n: true, cell: (c) => percent(c.expected_probability) },
    { title: "parts", wrap: true, cell: (c) => c.separates.join(" / ") },
    { title: "", cell: (c) => planned.button(body_(c)) },
  ], body.next_cases, { caption: "Best first; one click puts a case on the bench's checklist, where everybody sees it" });
}
