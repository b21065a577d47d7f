// The fall of the error: the chain of revisions, step back and forth, any two compared, any one put in force again.
import { at, finished, get, post } from "../api.js";
import { el, empty, fill, notice, panel, problem, quiet, table } from "../dom.js";
import { number, when, words } from "../format.js";
import { figure } from "../plot.js";

export async function view(main, { session, asked }) {
  const path = at("sessions", session);
  const away = new AbortController();
  let rows = [];
  let at_ = asked.revision || null;
  const head = el("div");
  const chain = el("div");
  const waterfall = el("div");
  const step = el("div", { "aria-live": "polite" });
  fill(main, el("h1", {}, `${session}: the fall of the error`), head, panel("Step by step", waterfall), panel("The steps", chain), panel("The step", step));

  async function load() {
    try {
      rows = (await get(`${path}/revisions`, { limit: 500 }, away.signal)).revisions;
      draw();
    } catch (error) {
      if (error.name !== "AbortError") fill(head, problem(error), el("button", { onclick: load }, "Try again"));
    }
  }

  function draw() {
    if (!rows.length) {
      fill(head, empty(el("p", {}, "No revision of this session's model yet."), el("p", {}, el("button", { class: "main", onclick: refit }, "Refit the model"), " or ",
        el("a", { href: `#/sessions/${encodeURIComponent(session)}/find` }, "find the missing effect"))));
      fill(waterfall); fill(chain); fill(step);
      return;
    }
    if (!rows.some((r) => r.id === at_)) at_ = (rows.find((r) => r.in_force) || rows.at(-1)).id;
    fill(head, el("div", { class: "row" },
      el("button", { onclick: () => move(-1), disabled: index() === 0 }, "Step back"), el("button", { onclick: () => move(1), disabled: index() === rows.length - 1 }, "Step forth"),
      el("button", { onclick: refit }, "Refit once more"),
      el("a", { class: "button", href: `/api/v1/sessions/${encodeURIComponent(session)}/report?model=${encodeURIComponent(at_)}` }, "Report as HTML"),
      el("button", { onclick: () => print() }, "Print or PDF")));
    figure(waterfall, "revisions/waterfall", { revision: at_ }, { signal: away.signal });
    const places = Object.keys(rows.at(-1).after || {});
    fill(chain, table([
      { title: "revision", cell: (r) => r.id }, { title: "change", cell: (r) => [...r.added.map((a) => `+${a}`), ...r.removed.map((a) => `−${a}`)].join(" ") || "refit" },
      { title: "made", cell: (r) => when(r.created_utc) }, { title: "ln evidence", n: true, cell: (r) => number(r.evidence?.log_evidence_gain, 1) },
      ...places.map((p) => ({ title: `${words(p)} [N]`, n: true, cell: (r) => number(r.history.at(-1)?.rmse_N?.[p]) })),
      { title: "", cell: (r) => (r.in_force ? "in force" : "") },
    ], rows, { caption: "RMSE after each step; validation cases were never fitted", pick: (r) => { at_ = r.id; draw(); }, picked: at_, key: (r) => r.id }));
    one();
  }

  const index = () => rows.findIndex((r) => r.id === at_);
  const move = (by) => { at_ = rows[Math.max(0, Math.min(rows.length - 1, index() + by))].id; draw(); };

  async function one() {
    const r = rows[index()];
    const vectors = el("div");
    const other = el("select", { id: "other", onchange: () => show() }, el("option", { value: r.parent }, `its parent, ${r.parent}`),
      rows.filter((x) => x.id !== r.id && x.id !== r.parent).map((x) => el("option", { value: x.id }, x.id)));
    const show = () => figure(vectors, "comparison/vectors", { session, model: r.id, before: other.value }, { signal: away.signal });
    const why = el("input", { id: "why", placeholder: "why it is to stand for the specimen again" });
    fill(step, el("h3", {}, `${r.id}: ${r.added.length ? `with ${r.added.join(" and ")}` : "refitted"}`),
      quiet(`Made ${when(r.created_utc)} from ${r.parent} by ${r.method}; ${r.outcome}. It holds ${r.effects.length ? r.effects.join(", ") : "no effect"}.`),
      el("div", { class: "row" }, el("div", {}, el("label", { htmlFor: "other" }, "Before, in the figure"), other)), vectors,
      el("p", {}, el("a", { href: `/api/v1/revisions/${encodeURIComponent(r.id)}/document` }, "The revision as a file"), ", ",
        el("a", { href: `#/sessions/${encodeURIComponent(session)}/compare?model=${encodeURIComponent(r.id)}` }, "compare with it")),
      r.in_force ? quiet("It stands for the specimen.") : el("div", { class: "row" }, el("div", {}, el("label", { htmlFor: "why" }, "Why"), why),
        el("button", { onclick: () => restore(r.id, why.value) }, "Put it in force again")));
    show();
  }

  async function restore(id, why) {
    try { await post(`${at("revisions", id)}/restore`, { why }); await load(); } catch (error) { notice(error); }
  }

  async function refit() {
    try {
      const job = await post(`${path}/fits`, {});
      const bar = el("progress", { max: 1, value: 0, "aria-label": "Refitting" });
      fill(head, quiet("Refitting; the first time on a machine the model is compiled …"), bar, el("button", { onclick: () => post(`${at("jobs", job.id)}/cancel`).catch(notice) }, "Cancel"));
      const done = await finished(job, (now) => { bar.value = now.progress; }, away.signal);
      if (done.state === "failed") notice(done.problem);
      at_ = done.result?.model || at_;
      await load();
    } catch (error) { notice(error); await load(); }
  }

  await load();
  return {
    leave: () => away.abort(),
    asked: (query) => { if (query.revision) { at_ = query.revision; draw(); } },
    hear: (m) => { if (m.kind === "revision" && m.session === session) load(); },
  };
}
