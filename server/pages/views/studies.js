// Published studies: every figure that they print beside ours, computed again on this machine.
import { at, get, post } from "../api.js";
import { el, empty, fill, panel, problem, quiet, table } from "../dom.js";
import { compact, number } from "../format.js";
import { figure } from "../plot.js";
import { awaited } from "./work.js";

const VERDICTS = new Map([[true, ["agrees", "good"]], [false, ["differs", "bad"]], [null, ["no comparison", "quiet"]]]);

export async function view(main, { asked }) {
  const away = new AbortController();
  const list = el("div");
  const one = el("section", { id: "study", tabIndex: -1, "aria-label": "The study" });
  fill(main, el("h1", {}, "Published studies"),
    quiet("Systems of the literature, computed again with this software's model: what the papers print, and what comes out here."), panel("", list), one);
  let studies = [];
  let now = asked.study || null;

  const told = (s) => (s.state === null ? "not yet" : s.state === "done" ? "computed" : s.state);
  const draw = () => fill(list, table([
    { title: "study", cell: (s) => s.citation }, { title: "of", wrap: true, cell: (s) => s.about }, { title: "computed", cell: told },
  ], studies, { pick: (s) => { location.hash = `#/studies?study=${encodeURIComponent(s.name)}`; }, key: (s) => s.name, picked: now, caption: "Pick one to see its figures beside ours" }));

  const load = async () => {
    studies = (await get("/studies", {}, away.signal)).studies;
    draw();
  };

  async function show() {
    if (!now) return fill(one);
    try {
      const study = await get(at("studies", now), {}, away.signal);
      const place = el("div", { "aria-live": "polite" });
      const compute = async () => {
        again.disabled = true;
        const done = await awaited(place, post(`${at("studies", study.name)}/reproductions`, {}), "Computing the study", away.signal, compute);
        again.disabled = false;
        if (!done || away.signal.aborted) return;
        await load();
        await show();
      };
      const again = el("button", { class: study.rows.length ? "" : "main", onclick: compute }, study.rows.length ? "Compute again" : "Compute it");
      fill(one, panel(study.citation, quiet(`${study.about[0].toUpperCase()}${study.about.slice(1)}.`), el("div", { class: "row" }, again), place,
        study.rows.length ? null : empty(el("p", {}, "It was not computed on this service yet. That takes from a second to a minute."))), parts(study));
      for (const place of one.querySelectorAll("[data-figure]")) figure(place, `study/${study.name}/${place.dataset.figure}`, {}, { signal: away.signal });
    } catch (error) {
      if (error.name !== "AbortError") fill(one, problem(error));
    }
  }

  try {
    await load();
    await show();
  } catch (error) {
    if (error.name !== "AbortError") fill(list, problem(error));
  }
  return {
    leave: () => away.abort(),
    asked: async (given) => { now = given.study || null; draw(); await show(); one.focus({ preventScroll: true }); one.scrollIntoView({ block: "nearest" }); },
  };
}

/** What came out: the published figures, what was assumed, further tables, figures. */
function parts(study) {
  if (!study.rows.length) return [];
  const judged = study.rows.filter((r) => r.agrees !== null);
  const good = judged.filter((r) => r.agrees).length;
  const verdict = (r) => { const [text, kind] = VERDICTS.get(r.agrees); return el("span", { class: kind, title: r.note }, text); };
  return [
    panel("Published and ours",
      el("p", { class: "verdict" }, `${good} of ${judged.length} figures that can be recomputed agree.`),
      table([
        { title: "quantity", wrap: true, cell: (r) => r.quantity }, { title: "published", n: true, cell: (r) => r.printed },
        { title: "ours", n: true, cell: (r) => number(r.ours, digits(r.printed)) }, { title: "unit", cell: (r) => r.unit },
        { title: "", cell: verdict }, { title: "note", wrap: true, cell: (r) => r.note },
      ], study.rows, { caption: `Every published figure, computed by version ${study.version}` })),
    study.assumptions.length ? panel("What the paper leaves out", el("ul", {}, study.assumptions.map((text) => el("li", {}, text)))) : null,
    study.sheets.map((sheet) => panel(sheet.title,
      table(sheet.columns.map((title, i) => ({ title, n: sheet.lines.every((line) => typeof line[i] !== "string"), wrap: true, cell: (line) => shown(line[i]) })), sheet.lines, { caption: sheet.title }),
      sheet.notes.map(quiet))),
    study.figures.map((f) => panel(f.heading, el("div", { "data-figure": f.name }))),
  ].flat(2).filter(Boolean);
}

/** One digit more than is printed. */
const digits = (printed) => (printed.match(/\.(\d+)/)?.[1].length ?? 0) + 1;
const shown = (value) => (value === null ? "–" : typeof value === "number" ? compact(value) : value);
