// Predicted against measured: table, figures, filters; from any point to its case, readings and windows, with an undo.
import { at, get, post, put } from "../api.js";
import { el, empty, fill, notice, panel, problem, quiet, table } from "../dom.js";
import { masses, norm, number, vector, words } from "../format.js";
import { figure } from "../plot.js";
import { models } from "./models.js";
import { windows } from "./windows.js";

const FIGURES = [["scatter", "Measured and predicted, fitted cases"], ["scatter_validation", "Measured and predicted, cases never fitted"],
  ["errors", "Errors by tendon, posture and role"], ["vectors", "Tip forces in each posture"], ["bone", "Forces on the metacarpal"], ["z", "Residual against uncertainty"]];

export async function view(main, { session, asked }) {
  const path = at("sessions", session);
  const away = new AbortController();
  let model = asked.model || null;
  let picked = asked.case || null;
  let body = null;
  let plane = null;
  const only = { role: "", location: "", posture: "", tendons: "" };
  const head = el("div");
  const summary = el("div");
  const filters = el("div", { class: "row" });
  const rows = el("div");
  const one = el("div", { id: "case", "aria-live": "polite" });
  const drawn = el("div");
  const which = el("select", { id: "figure", onchange: () => draw() }, FIGURES.map(([name, title]) => el("option", { value: name }, title)));
  const chosen = await models(session, model, (name) => { model = name; load(); });

  fill(main, el("h1", {}, `${session}: predicted against measured`), head,
    panel(null, el("div", { class: "row" }, chosen.node, el("div", {}, el("label", { htmlFor: "figure" }, "Figure"), which))),
    panel("Errors", summary), panel(null, drawn), panel("The case", one),
    panel("Load cases", filters, rows));

  const tendons = (c) => Object.entries(c.masses_g).filter(([, g]) => g).map(([t]) => t).join("+") || "none";

  async function load() {
    try {
      body = await get(`${path}/comparison`, { model }, away.signal);
      plane = body.judged_in === "sagittal" ? "sagittal" : "space";
      tell();
      draw();
    } catch (error) {
      if (error.name === "AbortError") return;
      body = null;
      fill(head, problem(error), el("button", { onclick: load }, "Try again"));
      fill(summary, quiet("Nothing to compare yet."));
      fill(rows);
      fill(drawn);
    }
  }

  function tell() {
    const told = [];
    if (body.blinded.length) told.push(`${body.blinded.length} validation cases are hidden until the bench closes the session.`);
    for (const state of ["waiting", "failed", "excluded"]) {
      const names = Object.entries(body[state]);
      if (names.length) told.push(`${names.length} ${state}: ${names.slice(0, 3).map(([i, why]) => `${i} (${why})`).join("; ")}${names.length > 3 ? " …" : ""}`);
    }
    fill(head, quiet(`Model ${body.model}; friction factor c = ${number(body.tension_factor, 3)}, ${body.tension_factor_source}; x proximal, y dorsal, z radial.`),
      told.map((t) => el("p", { class: "warn" }, t)), body.notes.map(quiet));
    fill(summary, table([
      { title: "cases", cell: ([name]) => words(name).replace("/", " at the ") },
      { title: "", cell: ([name]) => (name.startsWith("validation") ? "never fitted" : "fitted") },
      { title: "number", n: true, cell: ([, e]) => String(e[plane].cases) },
      { title: "RMSE [N]", n: true, cell: ([, e]) => number(e[plane].rmse_N) },
      { title: "RMSE [%]", n: true, cell: ([, e]) => number(e[plane].rmse_rel_pct, 1) },
      { title: "size [%]", n: true, cell: ([, e]) => number(e[plane].magnitude_error_pct, 1) },
      { title: "direction [deg]", n: true, cell: ([, e]) => number(e[plane].direction_error_deg, 1) },
    ], Object.entries(body.summary), { caption: plane === "sagittal" ? "In the sagittal plane, in which this finger is judged" : "In space" }));
    const choice = (name, title, value) => {
      const values = [...new Set(body.cases.map(value))].sort();
      return el("div", {}, el("label", { htmlFor: `only-${name}` }, title), el("select", { id: `only-${name}`, onchange: (e) => { only[name] = e.target.value; list(); } },
        el("option", { value: "" }, "all"), values.map((v) => el("option", { value: v, selected: only[name] === v }, words(v)))));
    };
    fill(filters, choice("role", "Role", (c) => c.role), choice("location", "Mount", (c) => c.location), choice("posture", "Posture", (c) => c.posture), choice("tendons", "Tendons", tendons));
    list();
    if (picked) show(picked);
    else fill(one, empty("Pick a case in the table or a point of the figure."));
  }

  function list() {
    const shown = body.cases.filter((c) => (!only.role || c.role === only.role) && (!only.location || c.location === only.location) && (!only.posture || c.posture === only.posture) && (!only.tendons || tendons(c) === only.tendons));
    fill(rows, table([
      { title: "case", cell: (c) => c.id }, { title: "role", cell: (c) => c.role }, { title: "posture", cell: (c) => words(c.posture) },
      { title: "at", cell: (c) => c.location }, { title: "hung", cell: (c) => masses(c.masses_g) },
      { title: "measured [N]", n: true, cell: (c) => vector(c.measured_N) }, { title: "predicted [N]", n: true, cell: (c) => vector(c.predicted_N) },
      { title: "|residual| [N]", n: true, cell: (c) => number(norm(c.residual_N)) }, { title: "z", n: true, cell: (c) => number(c.z, 1) },
    ], shown, { caption: `${shown.length} of ${body.cases.length} load cases; z: residual in standard uncertainties of the reading`, pick: (c) => show(c.id), picked, key: (c) => c.id }));
  }

  async function show(id) {
    picked = id;
    list();
    fill(one, quiet("Loading …"));
    try {
      const c = await get(`${path}/cases/${encodeURIComponent(id)}`, {}, away.signal);
      const finger = el("div");
      const traces = el("div");
      fill(one, el("h3", {}, `${c.id}: ${masses(c.masses_g)}, ${words(c.posture)}, ${c.location}`),
        c.why ? el("p", { class: "warn" }, c.why) : null,
        el("p", {}, el("span", { class: "big" }, `${number(norm(c.measured_N), 2)} N`), " measured; ", c.blinded ? "the prediction is hidden" : `${number(norm(c.predicted_N), 2)} N predicted by the session's own model`),
        el("div", { class: "columns" }, finger, traces),
        c.state === "excluded" ? el("button", { onclick: () => edit(post(`${path}/cases/${encodeURIComponent(id)}/include`)) }, "Take it in again") : exclusion(id));
      figure(finger, "finger", { session, case: id, model }, { signal: away.signal });
      if (Object.keys(c.windows).length) {
        windows(traces, session, id, (name, span) => edit(put(`${path}/cases/${encodeURIComponent(id)}/windows`, { [name]: span })), away.signal);
      } else fill(traces, quiet("Published data: an averaged force without readings."));
    } catch (error) {
      if (error.name !== "AbortError") fill(one, problem(error));
    }
  }

  function exclusion(id) {
    const why = el("input", { id: "why", placeholder: "such as: the suture slipped" });
    return el("div", { class: "row" }, el("div", {}, el("label", { htmlFor: "why" }, "Leave it out, because"), why),
      el("button", { onclick: () => edit(post(`${path}/cases/${encodeURIComponent(id)}/exclude`, { reason: why.value })) }, "Exclude"));
  }

  async function edit(asked_) {
    try {
      const done = await asked_;
      await load();
      const undo = el("button", { onclick: async () => {
        try { await post(`${path}/edits/${done.edit}/undo`); await load(); } catch (error) { notice(error); }
      } }, "Undo");
      head.append(el("p", { role: "status" }, "Changed, and computed anew. ", undo));
    } catch (error) {
      notice(error);
    }
  }

  function draw() {
    if (body) figure(drawn, `comparison/${which.value}`, { session, model }, { signal: away.signal, picked: (point) => {
      const text = [point.customdata, point.text, point.id].flat().filter((t) => typeof t === "string");
      const hit = body.cases.find((c) => text.some((t) => t === c.id || t.startsWith(`${c.id} `) || t.includes(`>${c.id}<`) || t.split(/[^\w-]/).includes(c.id)));
      if (hit) show(hit.id);
    } });
  }

  await load();
  return {
    leave: () => away.abort(),
    hear: (m) => {
      if (m.kind === "revision") chosen.refresh();
      if (m.kind === "session" && m.session === session && body && document.activeElement?.id !== "why") load();
    },
  };
}
