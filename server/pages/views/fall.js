// The fall of the error: the chain of revisions, step back and forth, any two compared, any one put in force again.
import { at, get, post, turns } from "../api.js";
import { el, empty, fill, notice, note, panel, problem, quiet, table } from "../dom.js";
import { number, when, words } from "../format.js";
import { figure } from "../plot.js";
import { named } from "./models.js";
import { awaited } from "./work.js";

export async function view(main, { session, asked }) {
  const path = at("sessions", session);
  const base = `#/sessions/${encodeURIComponent(session)}`;
  const away = new AbortController();
  const turn = turns();
  let rows = [];
  let now = asked.revision || null;
  let against = null;
  const head = el("div");
  const work = el("div", { "aria-live": "polite" });
  const state = el("div", { "aria-live": "polite" });
  const chain = el("div");
  const waterfall = el("div", { class: "drawn" });
  const step = el("div", { "aria-live": "polite" });
  const panels = el("div", { hidden: true }, panel("Step by step", waterfall), panel("The step", step), panel("All steps", chain));
  fill(main, el("h1", {}, `${session}: the fall of the error`), head, work, state, panels);

  async function load() {
    const newest = turn();
    try {
      const [{ revisions }, { fingers }] = await Promise.all([get(`${path}/revisions`, { limit: 500 }, away.signal), get("/fingers", {}, away.signal)]);
      const steps = revisions.length ? [await begun(revisions[0], fingers), ...revisions] : [];
      if (!newest()) return;
      rows = steps;
      draw();
    } catch (error) {
      if (error.name === "AbortError") return;
      panels.hidden = true;
      fill(head, problem(error), el("button", { onclick: load }, "Try again"), " ", el("a", { class: "button", href: "#/" }, "To the sessions"));
    }
  }

  function draw() {
    panels.hidden = !rows.length;
    fill(state);
    if (!rows.length) {
      fill(head, empty(el("p", {}, "No revision of this session's model yet: there is no error that could have fallen."), el("p", {},
        el("a", { class: "button", href: `${base}/find` }, "Find the missing effect"), " ", el("button", { onclick: refit }, "Refit the model without any"))));
      return;
    }
    if (!rows.some((r) => r.id === now)) now = (rows.find((r) => r.in_force) || rows.at(-1)).id;
    const i = index();
    fill(head, el("div", { class: "row no-print" },
      el("button", { id: "back", onclick: () => move(-1), disabled: i === 0 }, "◀ Step back"), el("button", { id: "forth", onclick: () => move(1), disabled: i === rows.length - 1 }, "Step forth ▶"),
      el("span", { class: "chip" }, i ? `step ${i} of ${rows.length - 1}; ← and → step too` : "the start; ← and → step too"),
      el("button", { onclick: refit }, "Refit once more"),
      el("a", { class: "button", href: `${base}/report?${new URLSearchParams(modelOf(now) ? { model: now } : {})}` }, "Report, to print or save")));
    figure(waterfall, "revisions/waterfall", { revision: rows[Math.max(i, 1)].id }, { signal: away.signal });
    const places = Object.keys(rows.at(-1).history.at(-1)?.rmse_N || {});
    fill(chain, table([
      { title: "revision", cell: (r) => r.id || "refit alone" }, { title: "change", cell: changeOf },
      { title: "made", cell: (r) => (r.start ? "" : when(r.created_utc)) }, { title: "ln evidence", n: true, cell: (r) => number(r.evidence?.log_evidence_gain, 1) },
      ...places.map((p) => ({ title: `${words(p).replace("/", ", ")} [N]`, n: true, cell: (r) => number(r.history.at(-1)?.rmse_N?.[p]) })),
      { title: "", cell: (r) => (r.in_force ? "in force" : "") },
    ], rows.flatMap((r) => [...alone(r), r]), { caption: "RMSE after each step, of the session as it was then; validation cases were never fitted", pick: (r) => go(r.id), picked: now, key: (r) => r.id }));
    one();
  }

  /** What the first revision was made from; a finger that came with the session is named by leaving the model out. */
  async function begun(first, fingers) {
    const id = first.parent;
    const shipped = fingers.some((f) => f.name === id);
    const kept = shipped ? null : await get(at("revisions", id), {}, away.signal).catch(() => null);
    const mine = kept?.specimen === first.specimen;
    return { id, model: shipped || kept ? id : null, mine, start: true, added: [], removed: [], history: first.history.filter((s) => s.id).slice(0, -1), in_force: mine && kept.in_force };
  }

  /** The refit without what a revision adds, which is no revision itself: so that nobody takes its share for the effect's. */
  const alone = (r) => r.history.slice(-2, -1).filter((s) => !s.id).map((s) => ({ ...s, id: "", start: false, history: [s] }));

  const modelOf = (id) => { const row = rows.find((r) => r.id === id); return row?.start ? row.model : id; };
  const changeOf = (r) => (r.start ? "start" : [...r.added.map((a) => `+${a}`), ...r.removed.map((a) => `−${a}`)].join(" ") || "refit");
  const index = () => rows.findIndex((r) => r.id === now);
  const move = (by) => go(rows[Math.max(0, Math.min(rows.length - 1, index() + by))]?.id);

  function go(id) {
    if (!id || id === now) return;
    const focused = document.activeElement?.id;
    now = id;
    against = null;
    draw();
    if (focused) (document.getElementById(focused)?.disabled ? main : document.getElementById(focused))?.focus();
  }

  function one() {
    const r = rows[index()];
    if (r.start) return begin(r);
    const other = against || r.parent;
    const vectors = el("div", { class: "drawn" });
    const errors = el("div");
    const select = el("select", { id: "other", onchange: () => { against = select.value; compare(); } },
      el("option", { value: r.parent }, `${r.parent}, what it was made from`),
      rows.filter((x) => x.id !== r.id && x.id !== r.parent).map((x) => el("option", { value: x.id }, x.start ? `${x.id}, the start` : named(x))));
    select.value = other;
    const show = el("select", { id: "vectors", onchange: () => compare() }, [["vectors", "Tip forces on the finger"], ["bone", "Forces on the metacarpal"], ["scatter", "Fitted cases, component by component"], ["scatter_validation", "Cases never fitted"], ["errors", "Errors by tendon, posture and role"], ["z", "Each case against its uncertainty"]]
      .map(([v, t]) => el("option", { value: v }, t)));
    show.value = step.dataset.figure || "vectors";
    fill(step, el("h3", {}, `${r.id}: ${r.added.length ? `with ${r.added.join(" and ")}` : r.removed.length ? `without ${r.removed.join(" and ")}` : "refitted"}`),
      note(`Made ${when(r.created_utc)} from ${r.parent} by ${r.method}; ${r.outcome}. It holds ${r.effects.length ? r.effects.join(", ") : "no effect"}.`,
        r.evidence?.log_evidence_gain ? ` The readings speak for the step by ${number(r.evidence.log_evidence_gain, 1)} in ln evidence. A search tells of fits of its own, which allow for what no effect describes too: its evidence and its errors with nothing added differ from these.` : ""),
      el("div", { class: "row no-print" }, el("div", {}, el("label", { htmlFor: "other" }, "Compared with"), select), el("div", {}, el("label", { htmlFor: "vectors" }, "Figure"), show)),
      errors, vectors,
      el("p", { class: "no-print" }, el("a", { href: `/api/v1/revisions/${encodeURIComponent(r.id)}/document`, download: `${r.id}.json` }, "The revision as a file"), "; ",
        el("a", { href: `${base}/compare?model=${encodeURIComponent(r.id)}` }, "compare case by case with it"), "; ",
        el("a", { href: `${base}/find?model=${encodeURIComponent(r.id)}` }, "ask whether more is missing")),
      again(r));

    async function compare() {
      step.dataset.figure = show.value;
      figure(vectors, `comparison/${show.value}`, { session, model: r.id, before: modelOf(select.value) }, { signal: away.signal,
        picked: (cases) => { location.hash = `${base}/compare?${new URLSearchParams({ model: r.id, ...(cases.length > 1 ? { cases: cases.join(",") } : { case: cases[0] }) })}`; } });
      try {
        const [before, after] = await Promise.all([modelOf(select.value), r.id].map((model) => get(`${path}/comparison`, { model }, away.signal)));
        const plane = after.judged_in === "sagittal" ? "sagittal" : "space";
        const older = [[select.value, before], [r.id, after]].filter(([, c]) => c.outdated).map(([id]) => id);
        fill(state, older.length ? el("p", { class: "warn" }, `The session was changed since the fit of ${older.join(" and ")}. “The step” is of the session as it is now; the rest of this page is of it as it was at each fit.`, after.outdated ? " Refit once more to take the change in." : "") : null);
        // What a fit kept is of the session as it was then, and stands beside nothing of today's.
        const between = select.value === r.parent && !after.outdated ? alone(r)[0] : null;
        const change = (k) => after.summary[k][plane].rmse_N - (before.summary[k]?.[plane].rmse_N ?? NaN);
        fill(errors, table([
          { title: "cases", cell: (k) => words(k).replace("/", " at the ") }, { title: "", cell: (k) => (k.startsWith("validation") ? "never fitted" : "fitted") },
          { title: `RMSE with ${select.value} [N]`, n: true, cell: (k) => number(before.summary[k]?.[plane].rmse_N) },
          ...(between ? [{ title: "refitted alone [N]", n: true, cell: (k) => number(between.history[0].rmse_N[k]) }] : []),
          { title: `with ${r.id} [N]`, n: true, cell: (k) => number(after.summary[k][plane].rmse_N) },
          { title: "change [N]", n: true, cell: (k) => el("span", { class: change(k) > 0 ? "bad" : "good" }, `${change(k) > 0 ? "+" : ""}${number(change(k))}`) },
        ], Object.keys(after.summary), { caption: plane === "sagittal" ? "In the sagittal plane, in which this finger is judged" : "In space" }));
      } catch (error) {
        if (error.name !== "AbortError") fill(errors, problem(error));
      }
    }
    compare();
  }

  function begin(r) {
    const vectors = el("div", { class: "drawn" });
    fill(step, el("h3", {}, `${r.id}: the start`), quiet("Nothing was fitted or added yet. Solid arrows are measured, dashed ones predicted."), vectors, r.mine ? again(r) : without(rows[1]));
    figure(vectors, "comparison/vectors", { session, model: r.model }, { signal: away.signal });
  }

  function again(r) {
    if (r.in_force) return quiet("It stands for the specimen.");
    const why = el("input", { id: "why", required: true, placeholder: "such as: the suture had slipped" });
    return el("form", { class: "row no-print", onsubmit: (e) => { e.preventDefault(); restore(r.id, why.value); } },
      el("div", {}, el("label", { htmlFor: "why" }, "Put it in force again, because"), why), el("button", {}, "Put it in force again"));
  }

  // A finger is no revision of the specimen: what the first step added is taken out of it again, and that is fitted.
  function without(first) {
    if (!first.added.length) return null;
    const effects = first.added.join(" and ");
    const added = (e) => first.added.some((a) => a === e || a.startsWith(`${e}.`));
    const current = rows.find((r) => r.in_force);
    if (current?.effects.every((e) => first.effects.includes(e) && !added(e))) return quiet(`${current.id} stands for the specimen: it is fitted without ${effects}.`);
    const take = () => fit(post(`${path}/revisions`, { without: first.added, model: first.id }), `Taking out ${effects}, refitting`, take);
    return el("button", { class: "no-print", onclick: take }, `Put it in force again, refitted without ${effects}`);
  }

  async function restore(id, why) {
    try { await post(`${at("revisions", id)}/restore`, { why }); await load(); } catch (error) { notice(error); }
  }

  const refit = () => fit(post(`${path}/fits`, {}), "Refitting", refit);

  async function fit(job, title, retry) {
    const done = await awaited(work, job, title, away.signal, retry);
    if (done) now = done.result?.model || now;
    if (!away.signal.aborted) await load();
  }

  function keyed(e) {
    if (e.altKey || e.ctrlKey || e.metaKey || e.target.closest("input, select, textarea, [contenteditable]")) return;
    const by = { ArrowLeft: -1, ArrowRight: 1 }[e.key];
    if (by && rows.length) { e.preventDefault(); move(by); }
  }

  addEventListener("keydown", keyed);
  await load();
  return {
    leave: () => { away.abort(); removeEventListener("keydown", keyed); },
    asked: (query) => { if (query.revision) go(query.revision); },
    hear: (m) => { if (m.session === session && (m.kind === "revision" || (m.kind === "session" && rows.length)) && !typing()) load(); },
    link: (state) => { if (state === "live" && !rows.length) load(); },
  };

  function typing() { return Boolean(document.getElementById("why")?.value); }
}
