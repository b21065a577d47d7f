// What an effect is: where it acts, its formula, parameters and source, and what it would change in these very data.
import { at, get, post } from "../api.js";
import { el, fill, panel, problem, quiet, table } from "../dom.js";
import { compact, number, percent, within, withUnit } from "../format.js";
import { figure } from "../plot.js";
import { stages } from "./stages.js";
import { awaited } from "./work.js";

export async function view(main, { session, asked }) {
  const path = at("sessions", session);
  const away = new AbortController();
  const names = (asked.name || "").split(",").filter(Boolean);
  const model = asked.model || null;
  const base = `#/sessions/${encodeURIComponent(session)}`;
  const work = el("div", { "aria-live": "polite" });
  const [effects, job] = await Promise.all([Promise.all(names.map((n) => get(at("effects", n.split(".")[0]), {}, away.signal))),
    asked.job ? get(at("jobs", asked.job), {}, away.signal).catch(() => null) : null]);
  if (!names.length) throw new Error("No effect is named. Pick one among the explanations.");
  const row = job?.result?.ranking.find((r) => r.candidates.join(",") === names.join(","));
  // Residuals are drawn after the search's own refit: with this effect where it was fitted, else with nothing added.
  const refit = row?.fit ? names.join("+") : job?.result?.ranking.some((r) => r.fit) ? "nothing" : null;
  const drawn = refit ? `${job.id}/${refit}` : model;

  async function add() {
    const done = await awaited(work, post(`${path}/revisions`, { add: names, model }), `Adding ${names.join(" and ")}, refitting`, away.signal, add);
    if (done && !away.signal.aborted) location.hash = `${base}/fall?revision=${encodeURIComponent(done.result.model)}`;
  }

  fill(main, el("h1", {}, names.join(" + ")),
    el("div", { class: "row no-print" }, el("a", { class: "button", href: `${base}/find` }, "Back to what was found"), el("button", { class: "main", onclick: add }, "Add and refit")), work,
    row ? panel("In these data", el("p", {}, row.log_evidence_gain === null ? "It was fitted by itself, and explains less than others." :
      `Probability that it acts by its known law, whatever else does: ${names.map((n) => percent(job.result.inclusion[n] ?? 0)).join(", ")}; that it acts alone: ${percent(row.probability)}. ln evidence ${number(row.log_evidence_gain, 1)} against nothing missing; it changes the forces by ${number(row.size_N)} N (root mean square).`),
    row.parameters?.length ? el("p", {}, row.parameters.map((p) => withUnit(`${p.name} = ${within(p.value, p.sd)}`, p.unit)).join("; "), ".") : null,
    row.indistinguishable_from?.length ? el("p", { class: "warn" }, `In this session it cannot be told from ${row.indistinguishable_from.join(", ")}.`) : null) : null,
    effects.map((e, i) => one(e, names[i])));

  function one(e, name) {
    const change = el("div", { class: "drawn" });
    const finger = el("div", { class: "drawn" });
    const most = el("p", { class: "quiet" });
    const out = panel(e.title, stages(e.stage), el("h3", {}, "Formula"), el("p", {}, el("code", { class: "formula" }, e.formula)),
      el("p", {}, el("strong", {}, "What gives it away: "), e.tell), quiet(`Source: ${e.source}`),
      table([{ title: "parameter", cell: (p) => p.name }, { title: "unit", cell: (p) => p.unit }, { title: "without it", n: true, cell: (p) => compact(p.null) },
        { title: "plausible", cell: (p) => (p.range ? `${compact(p.range[0])} to ${compact(p.range[1])}` : "–") }, { title: "prior sd", n: true, cell: (p) => compact(p.prior_sd) },
      ], e.parameters.filter((p) => p.name === name || p.name.startsWith(`${name}.`) || name === e.name || !e.parameters.some((q) => q.name.startsWith(name)))),
      el("h3", {}, "What it would change in this session"), change, most, finger);
    queueMicrotask(async () => {
      const open = (cases) => { location.hash = `${base}/compare?${new URLSearchParams({ case: cases[0], ...(drawn ? { model: drawn } : {}) })}`; };
      const plot = await figure(change, `effect/${encodeURIComponent(name)}`, { session, model: drawn }, { signal: away.signal, picked: open });
      const { case: found, held } = plot?.layout.meta ?? {};
      if (!found) return;
      // Only what the model holds can be taken out of it.
      most.textContent = `It changes case ${found} most. That is drawn here with its weights and its measured force, ${held ? "and with what is predicted with and without the effect" : "and with what is predicted without the effect"}.`;
      figure(finger, "finger", { session, case: found, model: drawn, without: held ? name : null }, { signal: away.signal, picked: open });
    });
    return out;
  }

  return { leave: () => away.abort() };
}
