// Forces inside the finger: what muscles and joints must have borne, by the measured tip forces, beside what really hung.
import { at, get } from "../api.js";
import { el, fill, keep, panel, problem, quiet, table } from "../dom.js";
import { masses, number, within, words } from "../format.js";
import { figuresOf, theme } from "../plot.js";
import { before } from "./answer.js";
import { models } from "./models.js";

const CLOSURES = [["chao", "the hood's sharing laws"], ["minimal", "four muscles, no hood"], ["least_squares", "least stress, any tendon"]];

export async function view(main, { session, asked }) {
  const path = at("sessions", session);
  const away = new AbortController();
  const place = el("div", { "aria-live": "polite" });
  let model = asked.model || null;
  let turn = 0;
  const closure = el("select", { id: "closure", onchange: () => { keep({ closure: closure.value }); load(); } }, CLOSURES.map(([v, t]) => el("option", { value: v, selected: v === asked.closure }, t)));
  const chosen = await models(session, model, (name) => { model = name; load(); }, away.signal);
  fill(main, el("h1", {}, `${session}: forces inside the finger`),
    panel(null, quiet("From the force and moment read at the tip back to the muscles and joints. More tendons than equations: an assumption settles which of them pulls. What really hung stands beside it, so the assumption can be judged."),
      el("div", { class: "row no-print" }, el("div", {}, el("label", { htmlFor: "closure" }, "What settles it"), closure), chosen.node)), place);

  async function load() {
    const mine = ++turn;
    fill(place, quiet("Inverting every case at the tip …"), el("progress", { "aria-label": "Inverting" }));
    const ask = (figures) => get(`${path}/inversion`, { closure: closure.value, model, figures }, away.signal);
    try {
      const body = await ask(theme());
      if (mine === turn) fill(place, shown(body, ask, session, away.signal));
    } catch (error) {
      if (error.name !== "AbortError" && mine === turn) fill(place, problem(error), el("button", { onclick: load }, "Try again"));
    }
  }

  await load();
  return { leave: () => away.abort() };
}

function shown(body, ask, session, signal) {
  const muscles = body.muscles.map((m) => m.name);
  const joints = Object.keys(body.cases[0]?.contacts || {});
  const force = (f) => [within(f.force_N, f.sd_N), f.hung_N ? ` (${number(f.hung_N, 1)})` : ""].join("");
  const href = (c) => `#/sessions/${encodeURIComponent(session)}/compare?case=${encodeURIComponent(c.id)}`;
  return [
    before(body),
    panel("What came of it", el("p", { class: "verdict" }, body.sentences[0]), body.sentences.slice(1).map((s) => el("p", {}, s)), body.inversion_notes.map(quiet), quiet(`${body.closure_title}; model ${body.model}.`)),
    panel("How well each muscle was found", table([
      { title: "muscle", cell: (m) => m.name }, { title: "stands for", cell: (m) => m.merged.join(" + ") },
      { title: "RMS of assigned less hung [N]", n: true, cell: (m) => number(m.rms_error_N, 2) }, { title: "within 2 sd", n: true, cell: (m) => String(m.within_2sd) },
      { title: "asked to push", n: true, cell: (m) => String(m.pushes) }, { title: "by more than 2 sd", n: true, cell: (m) => String(m.pushes_beyond_2sd) },
    ], body.muscles, { caption: `Over ${body.cases.length} cases at the tip` })),
    figuresOf(body, ask, signal),
    panel("Load cases", table([
      { title: "case", cell: (c) => el("a", { href: href(c) }, c.id) }, { title: "posture", cell: (c) => words(c.posture) }, { title: "hung", cell: (c) => masses(c.masses_g) },
      ...muscles.map((m) => ({ title: `${m} [N]`, n: true, cell: (c) => el("span", { class: c.pushes.includes(m) ? "warn" : "" }, force(c.muscles[m])) })),
      ...joints.map((j) => ({ title: `${j} contact [N]`, n: true, cell: (c) => force(c.contacts[j]) })),
    ], body.cases, { caption: "Force ± standard deviation, in brackets what really hung; of contacts what the model makes of the weights that hung" })),
  ];
}
