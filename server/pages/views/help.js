// Help: what the pages do, the catalogue of effects, the fingers.
import { get } from "../api.js";
import { el, fill, panel, problem, quiet, table } from "../dom.js";
import { compact } from "../format.js";

export async function view(main, { asked }) {
  const list = el("div");
  const one = el("div", { "aria-live": "polite" });
  fill(main, el("h1", {}, "Help"),
    panel("From readings to a model that fits",
      el("ol", {},
        el("li", {}, el("strong", {}, "Sessions."), " Begin one here, replay a recorded one (fingertwin replay FOLDER --to this address), or let a bench send its own (fingertwin log --protocol … --to)."),
        el("li", {}, el("strong", {}, "Bench."), " While weights hang: six traces, the force of each case as soon as its plateau is there, and a warning while there is still time. Predictions of validation cases stay hidden until the bench closes the session."),
        el("li", {}, el("strong", {}, "Compare."), " Predicted against measured. A point or a row leads to its case, its readings and windows; a window can be moved, and the move undone."),
        el("li", {}, el("strong", {}, "Find the missing effect."), " Where the model fails, what explains it, and how sure that is; or that the data cannot tell. One click adds an effect and refits."),
        el("li", {}, el("strong", {}, "The fall of the error."), " Each step with its evidence and errors on cases that were fitted and on cases that never were. Any step can be put in force again.")),
      quiet("Axes: x proximal, y dorsal, z radial. A reading is the force that the finger exerts on the cell.")),
    panel("The catalogue of effects", list), panel("The effect", one));
  try {
    const { effects } = await get("/effects");
    const show = (effect) => fill(one, el("h3", {}, `${effect.name} (${effect.stage})`), el("p", {}, effect.title),
      el("p", {}, el("code", {}, effect.formula)), el("p", {}, `Given away by: ${effect.tell}`), quiet(`Source: ${effect.source}`),
      table([
        { title: "parameter", cell: (p) => p.name }, { title: "unit", cell: (p) => p.unit }, { title: "null", n: true, cell: (p) => compact(p.null) },
        { title: "plausible", cell: (p) => (p.range ? `${compact(p.range[0])} to ${compact(p.range[1])}` : "–") },
      ], effect.parameters));
    fill(list, table([
      { title: "name", cell: (e) => e.name }, { title: "stage", cell: (e) => e.stage }, { title: "what happens", cell: (e) => e.title }, { title: "", cell: (e) => (e.own ? "your own" : "") },
    ], effects, { pick: show, key: (e) => e.name, picked: asked.effect }));
    show(effects.find((e) => e.name === asked.effect) || effects[0]);
  } catch (error) {
    fill(list, problem(error));
  }
  return {};
}
