// What a search found: the verdict in a sentence, where the model fails, what explains it, what to measure next.
import { el, fill, panel, quiet, table } from "../dom.js";
import { compact, masses, number, percent, within, withUnit, words } from "../format.js";
import { figure } from "../plot.js";

const FIGURES = [["residual_map", "Where the model fails"], ["missing_torque", "The joint torque that is missing"], ["ranking", "Which explanation"],
  ["size", "Size of the effect"], ["sensitivity", "Sensitivity analysis"], ["confounding", "What cannot be told apart"], ["held_out", "Validation cases, before and after"], ["own_curve", "What no effect explains"]];
const COLOURS = { found: "good", nothing_missing: "good", one_of: "warn", none_of_catalogue: "warn", undecided: "warn" };
const name = (r) => r.candidates.join(" + ") || (r.effects.length ? "something else" : "nothing is missing");

export function answer(job, { session, model, add, amend, amendBlocks, keep, planned, signal }) {
  const body = job.result;
  const plane = body.judged_in === "sagittal" ? "sagittal" : "space";
  // Of several that cannot be told apart, the one that the verdict names first.
  const names = body.verdict === "one_of" ? body.candidates.slice(0, 1) : body.candidates;
  const drawn = el("div", { class: "drawn" });
  const base = `#/sessions/${encodeURIComponent(session)}`;
  const draw = () => figure(drawn, `diagnosis/${which.value}`, { job: job.id, fit: after.value }, { signal, picked: (cases) => {
    const fit = after.value === "after" ? added.join("+") : "nothing";
    const model = body.ranking.some((r) => r.fit) ? { model: `${job.id}/${fit}` } : {};
    location.hash = `${base}/compare?${new URLSearchParams({ ...model, ...(cases.length > 1 ? { cases: cases.join(",") } : { case: cases[0] }) })}`;
  } });
  const added = body.where_after?.added || [];
  const after = el("select", { id: "after", onchange: draw }, el("option", { value: "before" }, "with nothing added"),
    added.length ? el("option", { value: "after" }, `with ${added.join(" + ")} added`) : null);
  const which = el("select", { id: "figure", onchange: draw }, FIGURES.map(([n, t]) => el("option", { value: n }, t)));
  const link = (r) => `${base}/effect?${new URLSearchParams({ name: r.candidates.join(","), job: job.id, ...(model() ? { model: model() } : {}) })}`;
  const sure = body.verdict === "found" || body.verdict === "one_of";
  const out = [
    before(body),
    body.suspects?.length || body.session_faults?.length ? panel("Suspect load cases", suspects(body, base, amend, amendBlocks)) : null,
    panel("The verdict", el("p", { class: `verdict ${COLOURS[body.verdict] || ""}` }, body.sentence),
      body.without_amendments ? quiet(`Without the amendments of entries: ${body.without_amendments.text}.`) : null,
      body.probability_of ? el("p", {}, `Probability ${percent(body.probability)}: ${body.probability_of}.`) : null,
      body.reasons.map((r) => el("p", {}, r)), body.notes.map(quiet),
      body.robustness.flips_when.slice(0, 3).map((f) => quiet(`It would be less probable than not if ${f}.`)),
      body.robustness.rests_on?.length ? quiet(`It would be less probable than not ${body.robustness.rests_on.slice(0, 3).join(", or ")}${body.robustness.rests_on.length > 3 ? `, or without ${body.robustness.rests_on.length - 3} others` : ""}.`) : null,
      body.confirmation ? el("p", {}, `Predictions made beforehand: ${body.confirmation.text}.`) : null,
      el("div", { class: "row no-print" },
        names.length ? el("button", { class: sure ? "main" : "", onclick: () => add(names) }, `Add ${names.join(" and ")}, and refit`) : null,
        names.length ? el("a", { class: "button", href: link({ candidates: names }) }, "What is that?") : null,
        el("a", { class: "button", href: `${base}/report?job=${encodeURIComponent(job.id)}` }, "Report, to print or save"))),
    panel("Error before and after", table([
      { title: "cases", cell: ([k]) => words(k).replace("/", " at the ") }, { title: "", cell: ([k]) => (k.startsWith("validation") ? "not fitted" : "fitted") },
      { title: "RMSE before [N]", n: true, cell: ([, e]) => number(e[plane].rmse_N) }, { title: "after [N]", n: true, cell: ([k]) => number(body.after[k]?.[plane].rmse_N) },
    ], Object.entries(body.before), { caption: (added.length ? `Refitted both times: with nothing added, and with ${added.join(" + ")}` : "Refitted with nothing added, which is what the verdict leaves") + (body.suspects.length ? `. Not counted: ${body.suspects.map((s) => s.case).join(", ")}` : "") })),
    panel(null, el("div", { class: "row no-print" }, el("div", {}, el("label", { htmlFor: "figure" }, "Figure"), which),
      el("div", {}, el("label", { htmlFor: "after" }, "Residuals after a refit"), after)), quiet("A click on a cell or a point leads to its load cases, after the same refit."), drawn, bent(body)),
    panel("Explanations", ranking(body, link), included(body)),
    panel("The rig, as the readings have it", rig(body)),
    panel("Tested and ruled out", ruledOut(body, link)),
    panel("Tests that need no tendon points", body.nulls_beside ? el("p", {}, body.nulls_beside) : null, body.nulls.filter((n) => n.verdict !== "not_tested").map((n) =>
      el("p", {}, el("strong", { class: n.verdict === "holds" ? "good" : "bad" }, n.verdict === "holds" ? "holds: " : "fails: "), n.text)),
    body.nulls.every((n) => n.verdict === "not_tested") ? quiet("This session's load cases allow none.") : null),
    body.ready_made?.length ? panel("Known to happen in rigs, outside the catalogue", body.ready_made.map((k) => el("p", {}, k.text, `; probability ${percent(k.probability)}. `,
      el("button", { class: "small", onclick: () => add([k.effect]) }, `Add ${k.effect}, and refit`)))) : null,
    body.hints.length ? panel("Hints: a place and a formula", body.curve ? el("p", {}, body.curve.sentence, " See the figure “What no effect explains”.") : null, body.hints.map((h) => el("p", {}, h.text, " ", el("code", {}, h.effect.formula), " ",
      el("button", { class: "small", onclick: () => keep({ formula: h.effect.formula }) }, "Take it in as an effect")))) : null,
    panel("What to measure next", quiet(body.next_sentence), body.next_cases.length ? next(body, planned) : null,
      body.next_cases.length && body.instruments.length ? el("p", {}, `Or: ${body.instruments.join("; ")}.`) : null),
  ];
  queueMicrotask(draw);
  return out;
}

// What has to be known before a result: warnings of the check, and what was amended.
export function before(body) {
  const warned = (body.warnings || []).map((w) => el("p", { class: w.level === "error" ? "bad" : "warn" }, w.level === "error" ? "Error found by the check: " : "", `${w.place}: ${w.words}`));
  const alike = {};
  for (const a of body.amendments || []) (alike[`${a.words}; ${a.why}`] ||= []).push(a.case);
  const amended = Object.entries(alike).map(([what, cases]) => el("p", {}, `${some(cases)} ${cases.length > 1 ? "are" : "is"} amended: ${what}`));
  return warned.length || amended.length ? panel("Before you read on", warned, amended) : null;
}

// Some cases, the first of them by name where they are many.
const some = (cases) => (cases.length > 4 ? `${cases.slice(0, 3).join(", ")} and ${cases.length - 3} more` : cases.join(", "));

function ranking(body, link) {
  const rows = body.ranking.filter((r) => r.log_evidence_gain !== null && (r.probability >= 0.01 || !r.effects.length)).slice(0, 12);
  return table([
    { title: "what is missing", cell: (r) => (r.candidates.length ? el("a", { href: link(r) }, name(r)) : name(r)) },
    { title: "alone", n: true, cell: (r) => el("span", {}, el("span", { class: "bar", style: `width:${Math.round(60 * r.probability)}px`, "aria-hidden": "true" }), " ", percent(r.probability)) },
    { title: "ln evidence", n: true, cell: (r) => number(r.log_evidence_gain, 1) },
    { title: "validation RMSE [N]", n: true, cell: (r) => number(r.validation_rmse_N.after) },
    { title: "value", wrap: true, cell: (r) => values(r) },
    { title: "cannot be told from", wrap: true, cell: (r) => r.indistinguishable_from?.join(", ") || "" },
  ], rows, { caption: `${body.candidates_searched} explanations searched, fitted or by the linearised model. Alone: probability that this acts and nothing beside it. A name leads to what the effect is.` });
}

// What is known of the rig by name is amended; a load that is only estimated, or a wrong window, is left out.
const LEFT_OUT = new Set(["amount", "window"]);

function suspects(body, base, amend, amendBlocks) {
  const like = (s) => s.reads_like.map((r) => {
    const leftOut = LEFT_OUT.has(r.kind);
    return el("div", {}, `${r.words} (${percent(r.probability)}) `, because(s.case, leftOut ? "Leave it out" : "Amend",
      `${s.case}: ${leftOut ? "leave out" : "amend"}, ${r.words}`, (why) => amend(s.case, r, leftOut, why)));
  });
  const without = (s) => [words(s.verdict_without?.verdict), ...(s.verdict_without?.effects || [])].filter(Boolean).join(", ");
  return [
    (body.session_faults || []).map((f) => el("p", {}, `The whole session: ${f.words} (probability ${percent(f.probability)}). ${f.settled_by ? `To be sure, ${f.settled_by}. ` : ""}`,
      f.amend?.length ? because("all", "Amend all these cases", `Amend all these cases: ${f.words}`, (why) => amendBlocks(f, why)) : null)),
    body.suspects?.length ? table([
      { title: "load case", cell: (s) => el("a", { href: `${base}/compare?${new URLSearchParams({ case: s.case })}` }, s.case) },
      { title: "probability that it is bad", n: true, cell: (s) => percent(s.probability) },
      { title: "reads like", wrap: true, cell: (s) => (s.reads_like.length ? like(s) : "nothing known; look at its notes") },
      { title: "verdict without it", wrap: true, cell: without },
    ], body.suspects, { caption: "They count for nothing in the verdict. An amendment keeps the entry and can be undone; search again after it." }) : null,
  ];
}

/** A button that asks how one knows before it changes a case, or all: the reason is kept with the change. */
function because(id, title, label, act) {
  const place = el("span", { class: "no-print" });
  const button = el("button", { class: "small", "aria-label": label, "data-case": id, onclick: () => {
    const why = el("input", { required: true, placeholder: "such as: seen on video" });
    const form = el("form", { class: "row", "aria-label": label, onsubmit: async (e) => {
      e.preventDefault();
      if (!(await act(why.value))) return;
      button.disabled = true;
      form.replaceWith(button);
    } }, el("label", { class: "above" }, `${title}, because`, why), el("button", {}, title),
    el("button", { type: "button", onclick: () => { form.replaceWith(button); button.focus(); } }, "Cancel"));
    button.replaceWith(form);
    why.focus();
  } }, title);
  return fill(place, button);
}

/** Errors of the rig that the refits take to be far beyond what is stated. */
function bent(body) {
  const fits = [body.where, body.where_after].filter((w) => w?.bent).filter((w, i, all) => !i || w.added.join() !== all[0].added.join());
  const found = [...new Map(fits.flatMap((w) => w.bent).map((b) => [b.name, b])).values()];
  const at = (w, name) => { const b = w.bent.find((x) => x.name === name); return b ? `${withUnit(number(b.value, 3), b.unit)} (${Math.abs(b.widths).toFixed(0)} sd)` : "within 2 sd"; };
  return found.length ? table([
    { title: "error of the rig", cell: (b) => b.name }, { title: "stated sd", cell: (b) => withUnit(number(b.stated_sd, 3), b.unit) },
    ...fits.map((w) => ({ title: `with ${w.added.join(" + ") || "nothing"} added`, cell: (b) => at(w, b.name) })),
    { title: "what would settle it", wrap: true, cell: (b) => b.remedy },
  ], found, { caption: "Errors of the rig that a refit takes to be more than two stated standard deviations, the most bent first" }) : null;
}

function included(body) {
  const rows = Object.entries(body.inclusion).filter(([, p]) => p >= 0.01).slice(0, 12);
  return rows.length ? table([{ title: "effect", cell: ([n]) => n }, { title: "acts by its name", n: true, cell: ([, p]) => percent(p) }], rows,
    { caption: "Probability that the effect acts by its known law, whatever else does" }) : null;
}

const SCATTER = [["Scatter of each component by itself", "component", "pct"], ["Scatter of forces in every direction", "direction", "pct"],
  ["Scatter of joint angles", "angle", "deg"], ["Error of each weight", "weight", "pct"],
  ["Turn of each tendon's line at the bone", "line", "deg"], ["Zero, from setting to setting", "zero", "mN"], ["Zero, within a setting", "drift", "mN"],
  ["Turn of the cell from setting to setting", "mounting", "deg"],
  ["Place where the tip is held, from setting to setting", "hold", "mm"], ["Joint angles of a setting at tip and bone", "apart", "deg"]];

function rig(body) {
  const { beyond, repeatability: r, budget_multiple: b, anatomy_multiple: a, noise_multiple: n, predictive_check: p } = body;
  const rows = [
    r && ["Repeatability of the tensions", `${number(r.value_pct, 2)} ± ${number(r.sd_pct, 2)} %`, r.stated_pct ? `${number(r.stated_pct, 1)} %` : "none stated"],
    ...(r ? SCATTER : []).filter(([, of, unit]) => r[`${of}_${unit}`] >= (unit === "mN" ? 1 : 0.1)).map(([name, of, unit]) =>
      [name, `${number(r[`${of}_${unit}`], 2)} ± ${number(r[`${of}_sd_${unit}`], 2)}${{ deg: "°", pct: " %", mm: " mm", mN: " mN" }[unit]}`, "none stated"]),
    b && ["Multiple of the budget", `${number(b.value, 2)} ± ${number(b.sd, 2)}`, b.carried_by.length ? `bent most: ${b.carried_by.slice(0, 3).join(", ")}` : "1"],
    a && ["Multiple of the anatomy's spread", `${number(a.value, 2)} ± ${number(a.sd, 2)}`, "1"],
    n && ["Multiple of the noise", `${number(n.value, 2)} ± ${number(n.sd, 2)}`, n.assumed ? "no uncertainty stated" : "1"],
    beyond && ["Something that no effect describes, alone or beside", `probability ${percent(beyond.probability)}`, beyond.probability >= 0.05 ? `about ${number(beyond.amplitude_N, 2)} N` : ""],
    p && p.p_value_before !== null && ["Predictive check on the validation cases", `p = ${compact(p.p_value_after)}`, `without any effect p = ${compact(p.p_value_before)}`],
  ].filter(Boolean);
  return table([{ title: "", wrap: true, cell: ([t]) => t }, { title: "by the readings", cell: ([, v]) => v }, { title: "stated", wrap: true, cell: ([, , s]) => s }], rows);
}

function ruledOut(body, link) {
  const kept = new Set(body.ranking.filter((r) => r.probability >= 0.01).flatMap((r) => r.candidates));
  const fitted = body.ranking.filter((r) => r.candidates.length === 1 && !(r.probability >= 0.01) && !kept.has(r.candidates[0]));
  const known = new Set([...kept, ...fitted.map((r) => r.candidates[0])]);
  const promised = Object.keys(body.detectability || {}).filter((n) => !known.has(n)).map((n) => ({ candidates: [n], effects: [n], parameters: [], linearised: true }));
  const rows = [...fitted, ...promised];
  const best = body.ranking.find((r) => r.log_evidence_gain !== null && r.effects.length);
  if (!rows.length) return quiet("Nothing: every effect that was tested is still possible.");
  return table([
    { title: "effect", cell: (r) => el("a", { href: link(r) }, r.candidates[0]) },
    { title: "why not", wrap: true, cell: (r) => why(r, best) },
    { title: "its value, fitted by itself", wrap: true, cell: (r) => values(r) },
  ], rows.slice(0, 40), { caption: `${rows.length} single effects: ${fitted.length} fitted by themselves, the others weighed by the linearised model` });
}

const values = (r) => r.parameters.slice(0, 3).map((p) => withUnit(`${p.name} ${within(p.value, p.sd)}`, p.unit)).join("; ");

function why(r, best) {
  if (r.linearised) return "the linearised model promises too little of it to be fitted";
  if (r.in_range === false) return "it would need a value beyond what is plausible";
  if (r.log_evidence_gain === null) return "it falls so far behind the others that it was weighed no further";
  if (r.log_evidence_gain <= 0) return "the readings are explained no better with it than with nothing";
  const better = best ? best.log_evidence_gain - r.log_evidence_gain : 0;
  if (better > 0) return `${name(best)} explains the same readings better by ${number(better, 1)} in ln evidence`;
  return "it explains the readings only with another law than its own, or with something unknown beside it";
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
