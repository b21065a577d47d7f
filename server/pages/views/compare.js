// Predicted against measured: figures, filters, table; from any point to its cases, their readings and windows.
import { at, get, turns } from "../api.js";
import { el, empty, fill, keep, panel, problem, quiet, table } from "../dom.js";
import { compact, masses, norm, number, vector, words, zOf } from "../format.js";
import { figure } from "../plot.js";
import { before } from "./answer.js";
import { oneCase } from "./case.js";
import { changes } from "./changes.js";
import { models } from "./models.js";

const FIGURES = [["scatter", "Measured and predicted, fitted cases"], ["scatter_validation", "Measured and predicted, validation cases"],
  ["vectors", "Tip forces in each posture"], ["bone", "Forces on the metacarpal"],
  ["errors", "Errors by tendon, posture and role"], ["z", "Each case against its uncertainty"]];
const PLANES = [["", "as the finger is judged"], ["sagittal", "sagittal plane (x, y)"], ["space", "in space (x, y, z)"]];
const SUMMARIES = [["summary", "role and mount"], ["by_muscle", "tendon"], ["by_posture", "posture"], ["by_location", "mount"]];
const FILTERS = [["role", "Role", (c) => c.role], ["location", "Mount", (c) => c.location], ["posture", "Posture", (c) => c.posture],
  ["muscles", "Tendons", (c) => tendons(c)]];
const tendons = (c) => Object.entries(c.masses_g || {}).filter(([, g]) => g).map(([t]) => t).sort().join("+") || "none";

export async function view(main, { session, asked }) {
  const path = at("sessions", session);
  const away = new AbortController();
  let model = asked.model || null;
  let picked = asked.case || null;
  let these = asked.cases ? asked.cases.split(",") : null;
  let body = null;
  const turn = turns();
  let cases = [];
  let first = true;
  let listed = null;
  const only = { role: asked.role || "", location: asked.location || "", posture: asked.posture || "", muscles: asked.muscles || "" };
  const head = el("div", { "aria-live": "polite" });
  const summary = el("div");
  const filters = el("div", { class: "row" });
  const rows = el("div");
  const drawn = el("div", { class: "drawn" });
  const choice = (id, title, options, changed, value = "") => el("div", {}, el("label", { htmlFor: id }, title),
    el("select", { id, onchange: changed }, options.map(([v, t]) => el("option", { value: v, selected: v === value }, t))));
  const which = choice("figure", "Figure", FIGURES, () => { keep({ figure: value(which) }); draw(); }, asked.figure);
  const plane = choice("plane", "Forces", PLANES, () => { keep({ plane: value(plane) }); draw(); tell(); }, asked.plane);
  const by = choice("by", "by", SUMMARIES, () => tell());
  const value = (node) => node.querySelector("select").value;
  const chosen = await models(session, model, (name) => { model = name; load(); }, away.signal);
  const log = changes(path, { begun: () => one.settle(), done: load }, away.signal);
  const one = oneCase({ session, path, model: () => model, changed: log.edit, signal: away.signal });

  fill(main, el("h1", {}, `${session}: predicted against measured`), head,
    panel(null, el("div", { class: "row no-print" }, which, chosen.node, plane), filters, drawn),
    el("section", { class: "panel", id: "case", "aria-label": "The load case", tabIndex: -1 }, one.node),
    panel("Errors", el("div", { class: "row no-print" }, by), summary),
    panel("Load cases", rows), panel("Changes", log.node));

  async function load() {
    const newest = turn();
    try {
      const [listed, compared] = await Promise.all([get(`${path}/cases`, {}, away.signal),
        get(`${path}/comparison`, { model }, away.signal).catch((error) => { if (error.name === "AbortError") throw error; return { problem: error }; })]);
      if (!newest()) return;
      cases = listed.cases;
      body = compared.problem ? null : compared;
      if (body) tell();
      else nothing(compared.problem);
      choices();
      list();
      draw();
      log.load();
      if (first && picked) show(picked, true);
      else if (picked && cases.some((c) => c.id === picked)) one.again(picked);
      else one.none(cases.length ? "Pick a load case in the table, or a point of the figure: its readings and windows open here." : "No load case yet.");
      first = false;
    } catch (error) {
      if (error.name === "AbortError") return;
      fill(head, problem(error), el("button", { onclick: load }, "Try again"), " ", el("a", { class: "button", href: "#/" }, "To the sessions"));
      for (const place of [summary, rows, drawn, filters]) fill(place);
      listed = null;
      one.none("Nothing to show.");
    }
  }

  function nothing(error) {
    fill(head, problem(error), cases.length ? quiet("What each load case waits for stands in the table below.") : el("p", {},
      "A bench sends its load cases as they are measured: ", el("a", { href: `#/sessions/${encodeURIComponent(session)}/bench` }, "to the bench"), "."),
    el("button", { onclick: load }, "Try again"));
    fill(summary, quiet("Nothing to compare yet."));
    fill(drawn, empty("The figure is drawn with the first measured load case."));
  }

  function tell() {
    if (!body) return;
    const told = [];
    if (body.blinded.length) told.push(`${body.blinded.length} validation cases are hidden until the bench closes the session.`);
    for (const state of ["waiting", "failed", "excluded"]) {
      const names = Object.entries(body[state]);
      if (names.length) told.push(`${names.length} ${state}: ${names.slice(0, 3).map(([i, why]) => `${i} (${why})`).join("; ")}${names.length > 3 ? " …" : ""}`);
    }
    fill(head, before(body), quiet(`Model: ${body.residuals_after}; friction factor c = ${number(body.tension_factor, 3)}, ${body.tension_factor_source}; axes x proximal, y dorsal, z radial.`),
      told.map((t) => el("p", { class: "warn" }, t)), body.notes.map(quiet));
    const shown = value(plane) || (body.judged_in === "sagittal" ? "sagittal" : "space");
    const found = Object.entries(body[value(by)]);
    fill(summary, table([
      { title: "cases", cell: ([name]) => words(name).replace("/", " at the ") },
      ...(value(by) === "summary" ? [{ title: "", cell: ([name]) => (name.startsWith("validation") ? "never fitted" : "fitted") }] : []),
      { title: "number", n: true, cell: ([, e]) => String(e[shown].cases) },
      { title: "RMSE [N]", n: true, cell: ([, e]) => number(e[shown].rmse_N) },
      { title: "RMSE [%]", n: true, cell: ([, e]) => number(e[shown].rmse_rel_pct, 1) },
      { title: "magnitude [%]", n: true, cell: ([, e]) => number(e[shown].magnitude_error_pct, 1) },
      { title: "direction [deg]", n: true, cell: ([, e]) => number(e[shown].direction_error_deg, 1) },
    ], found, { caption: `Errors ${shown === "sagittal" ? "in the sagittal plane" : "in space"}${shown === body.judged_in ? ", in which this finger is judged" : ""}; RMSE over force components (Synek et al. 2019, Eqs 6 and 7)` }));
  }

  function choices() {
    fill(filters, FILTERS.map(([name, title, of]) => {
      const values = [...new Set(cases.map(of))].filter(Boolean).sort();
      return choice(`only-${name}`, title, [["", "all"], ...values.map((v) => [v, words(v)])], (e) => { only[name] = e.target.value; keep({ [name]: only[name] }); list(); draw(); }, only[name]);
    }), these ? el("p", { class: "chip" }, `the ${these.length} load cases of that point or cell `, el("button", { class: "small", onclick: () => { these = null; keep({ cases: "" }); choices(); list(); } }, "Show all")) : null);
  }

  function list() {
    const compared = new Map((body?.cases || []).map((c) => [c.id, c]));
    const shown = cases.filter((c) => FILTERS.every(([name, , of]) => !only[name] || of(c) === only[name]) && (!these || these.includes(c.id)))
      .map((c) => ({ ...c, residual_N: null, z: null, z_sagittal: null, ...compared.get(c.id) }));
    const found = shown.map((c) => zOf(c, body)).filter((z) => z !== null);
    // Drawn anew while a button is pressed, it would lose the click.
    const now = JSON.stringify([shown, found, cases.length, picked, body?.residuals_after]);
    if (now === listed) return;
    listed = now;
    const rms = found.length ? `, root mean square ${number(Math.sqrt(found.reduce((s, z) => s + z * z, 0) / found.length), 1)}` : "";
    fill(rows, table([
      { title: "case", cell: (c) => c.id }, { title: "role", cell: (c) => c.role }, { title: "posture", cell: (c) => words(c.posture) },
      { title: "at", cell: (c) => c.location }, { title: "hung", cell: (c) => masses(c.masses_g) },
      { title: "measured [N]", n: true, cell: (c) => vector(c.measured_N) },
      { title: "predicted [N]", n: true, cell: (c) => (c.blinded ? "hidden" : vector(compared.has(c.id) ? c.predicted_N : null)) },
      { title: "|residual| [N]", n: true, cell: (c) => number(norm(c.residual_N)) }, { title: "z", n: true, cell: (c) => compact(zOf(c, body)) },
      { title: "state", cell: (c) => el("span", { class: { failed: "bad", excluded: "warn", waiting: "warn" }[c.state] || "", title: c.why || null }, c.state) },
    ], shown, { caption: `${shown.length} of ${cases.length} load cases. z: norm of the residual in standard uncertainties${rms}. ${body ? `Model: ${body.residuals_after}.` : ""}`, pick: (c) => show(c.id, true), picked, key: (c) => c.id }));
  }

  function show(id, lead) {
    picked = id;
    keep({ case: id });
    list();
    one.show(id);
    if (lead) {
      const place = document.getElementById("case");
      place.scrollIntoView({ block: "start", behavior: "instant" });
      place.focus({ preventScroll: true });
    }
  }

  function draw() {
    if (!body) return;
    const query = { session, model, plane: value(plane), ...only, role: only.role || "all" };
    figure(drawn, `comparison/${value(which)}`, query, { signal: away.signal, picked: (found) => {
      these = found.length > 1 ? found : null;
      keep({ cases: these?.join(",") });
      choices();
      list();
      if (found.length === 1) show(found[0], true);
      else rows.scrollIntoView({ block: "start" });
    } });
  }

  await load();
  return {
    leave: () => away.abort(),
    asked: async (query) => {
      these = query.cases ? query.cases.split(",") : null;
      if ((query.model || null) !== model) {
        model = query.model || null;
        await chosen.choose(model);
        picked = query.case || null;
        await load();
        // Whoever has left meanwhile has another page's address.
        if (away.signal.aborted) return;
      } else list();
      choices();
      if (query.case) show(query.case, true);
    },
    hear: (m) => {
      if (m.kind === "revision") chosen.refresh();
      if (m.session === session && (m.kind === "session" || m.kind === "case")) later();
    },
    link: (state) => { if (state === "live" && !cases.length) load(); },
  };

  // Many cases may come at once.
  function later() {
    clearTimeout(later.timer);
    later.timer = setTimeout(() => { if (!away.signal.aborted) load(); }, 250);
  }
}
