// Find the missing effect: search, and show what was found; add it and refit, or propose what to measure next.
import { at, get, post } from "../api.js";
import { el, empty, fill, notice, panel, problem } from "../dom.js";
import { answer } from "./answer.js";
import { OUTDATED, since } from "./changes.js";
import { models } from "./models.js";
import { ownEffect, taking } from "./own.js";
import { proposals } from "./proposals.js";
import { awaited } from "./work.js";

export async function view(main, { session, asked }) {
  const path = at("sessions", session);
  const away = new AbortController();
  let model = asked.model || null;
  let shown = null;
  let busy = false;
  // A session whose bench is running cannot be searched.
  let running = false;
  const work = el("div", { "aria-live": "polite" });
  const told = el("div", { role: "status" });
  const found = el("div");
  const chosen = await models(session, model, (name) => { model = name; }, away.signal);
  const thorough = el("input", { type: "checkbox", id: "thorough" });
  const start = el("button", { class: "main", onclick: () => diagnose() }, "Find the missing effect");
  const planned = proposals(path, away.signal);
  const own = ownEffect(session, away.signal, (name) => add([name]));
  fill(main, el("h1", {}, `${session}: find the missing effect`),
    panel(null, el("div", { class: "row no-print" }, chosen.node, el("label", { htmlFor: "thorough", class: "check" }, thorough, " thorough (up to a minute)"), start), work, told),
    found, panel("On the checklist", planned.node), own.node);

  async function run(job, title, again) {
    start.disabled = busy = true;
    if (!shown) fill(found);
    const done = await awaited(work, job, title, away.signal, again);
    busy = false;
    start.disabled = running;
    if (!done && !shown) nothing();
    return done;
  }

  const nothing = () => fill(found, empty(el("p", {}, "Nothing was searched for yet."), el("p", {}, "The search fits every effect of the catalogue, and several together, to the fitted load cases; the validation cases are a predictive check. It takes some seconds, the first time on a machine up to a minute.")));

  async function diagnose() {
    const done = await run(post(`${path}/diagnoses`, { model, thorough: thorough.checked, effects: taking(session) }), "Fitting every effect", diagnose);
    if (done) show(done);
  }

  async function add(names) {
    window.scrollTo({ top: 0 });
    const from = shown?.result.model && names.every((n) => shown.result.ranking.some((r) => r.candidates.includes(n))) ? revision(shown.result) : model;
    const done = await run(post(`${path}/revisions`, { add: names, model: from }), `Adding ${names.join(" and ")}, refitting`, () => add(names));
    if (done && !away.signal.aborted) location.hash = `#/sessions/${encodeURIComponent(session)}/fall?revision=${encodeURIComponent(done.result.model)}`;
  }

  // The effect goes into the model that was searched, if that is one that can be named.
  const revision = (result) => (chosen.names().includes(result.model) ? result.model : model);

  function show(job) {
    shown = job;
    fill(found, answer(job, { session, model: () => revision(job.result), add, amend, amendBlocks, keep, planned, signal: away.signal }));
    mark();
  }

  /** Say where the session was changed since the search; what was amended then is not offered again. */
  async function mark() {
    if (!shown || running) return;
    try {
      const changed = since(shown, (await get(`${path}/edits`, {}, away.signal)).edits);
      const amended = changed.filter((e) => e.in_force && ["amend", "exclude"].includes(e.kind)).flatMap((e) => e.body.amendments?.map((a) => a.case) ?? e.case);
      fill(told, changed.length ? el("p", { class: "warn" }, OUTDATED) : null);
      for (const button of found.querySelectorAll("[data-case]")) button.disabled = amended.includes(button.dataset.case) || (button.dataset.case === "all" && amended.length > 0);
    } catch (error) {
      if (error.name !== "AbortError") notice(error);
    }
  }

  async function amend(id, like, leftOut, why) {
    const where = `${path}/cases/${encodeURIComponent(id)}`;
    const body = like.exchanged_with ? { exchanged_with: like.exchanged_with, why } : { masses_g: like.masses_g, posture: like.posture, location: like.location, why };
    return edit(leftOut ? `${where}/exclude` : `${where}/amend`, leftOut ? { reason: why } : body, `${id} is ${leftOut ? "left out" : "amended"}: ${like.words}`);
  }

  // One mistake in many cases is one edit.
  const amendBlocks = (fault, why) => edit(`${path}/amend`, { amend: fault.amend, why }, `Amended: ${fault.words}`);

  async function edit(address, body, said) {
    try {
      const done = await post(address, body);
      notice(new Error(`${said}. Search again to see what changes.`), "good", ["Undo", async () => {
        try { await post(`${path}/edits/${done.edit}/undo`); await mark(); } catch (error) { notice(error); }
      }]);
      await mark();
      return true;
    } catch (error) {
      notice(error);
      return false;
    }
  }

  async function keep(document_) {
    try {
      const e = await post("/effects", document_);
      own.take(e.name);
      notice(new Error(`${e.name} takes part in the next search.`), "good");
    } catch (error) { notice(error); }
  }

  async function load() {
    try {
      const { source, closed } = await get(path, {}, away.signal);
      running = source === "bench" && !closed;
      start.disabled = busy || running;
      if (running) fill(told, el("p", { class: "warn" }, "The bench is still running: close the session there, then search."));
      else if (!shown) fill(told);
      planned.load();
      const { jobs } = await get(`${path}/diagnoses`, { limit: 20 }, away.signal);
      const under = jobs.find((j) => ["queued", "running"].includes(j.state));
      const last = jobs.find((j) => j.state === "done");
      const failed = jobs[0]?.state === "failed" ? jobs[0] : null;
      if (last && last.id !== shown?.id) show(await get(at("jobs", last.id), {}, away.signal));
      else if (!last && !under && !busy) nothing();
      if (under && !busy) run(Promise.resolve(under), "Fitting every effect", diagnose).then((done) => done && show(done));
      else if (failed && !under) fill(work, problem(failed.problem), el("button", { onclick: diagnose }, "Try again"));
    } catch (error) {
      if (error.name === "AbortError") return;
      start.disabled = error.status === 404;
      fill(found, problem(error), el("button", { onclick: load }, "Try again"), " ", el("a", { class: "button", href: "#/" }, "To the sessions"));
    }
  }

  await load();
  return {
    leave: () => away.abort(),
    hear: (m) => {
      if (m.session !== session) return;
      if (m.kind === "revision") chosen.refresh();
      if (m.kind === "session") { planned.load(); mark(); }
      // The bench has closed it.
      if (m.kind === "event" && running) load();
      // A search that somebody else began or finished.
      if (m.kind === "job" && m.body.kind === "diagnose" && !busy) load();
    },
    link: (state) => { if (state === "live" && !shown && !busy) load(); },
  };
}
