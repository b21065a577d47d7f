// Help: how to find a hidden effect in ten minutes, the words and keys, the catalogue of effects.
import { get } from "../api.js";
import { el, fill, panel, problem, table } from "../dom.js";
import { compact } from "../format.js";
import { stages } from "./stages.js";

export async function view(main, { asked }) {
  const away = new AbortController();
  const list = el("div");
  const one = el("div", { "aria-live": "polite" });
  const step = (title, ...text) => el("li", {}, el("strong", {}, title), " ", text);
  fill(main, el("h1", {}, "Help"),
    panel("Find a hidden effect in ten minutes",
      el("ol", {},
        step("Get a session.", "In a terminal: ", el("code", {}, `fingertwin replay DEV-02 --to ${location.origin}`), ", or choose a session's folder under Sessions. Then open it from the list."),
        step("Compare.", "Each point is one load case. On the grey line prediction and measurement agree. Look which tendon, posture or mount lies off it; the filters above the figure narrow it down."),
        step("Look into a case.", "Click a point or a row of the table. Its readings open with the windows that were averaged. Drag a window, or type its times; every change can be undone."),
        step("Find the missing effect.", "One click fits every effect of the catalogue. The verdict is the large sentence; below it stand its reasons, what else could explain the readings, and what was ruled out."),
        step("Look at the effect.", "Its name leads to its formula, source, and what it would change in these very data: bars that follow the circles take up what the model misses."),
        step("Add and refit.", "The error falls, or it does not. The validation cases are a check on it."),
        step("The fall of the error.", "Step back and forth, compare any two steps, print the report. Any step can be put in force again: nothing is overwritten.")),
      el("p", {}, "If the data cannot tell, the verdict says so, and lists what to measure next. One click puts such a case on the bench's checklist.")),
    panel("Words", el("dl", {}, [
      ["identification, validation", "Load cases that are fitted, and load cases that never are. Only the second kind shows whether a model is right."],
      ["RMSE", "Root mean square of measured minus predicted force components, in N; in percent of the mean measured force."],
      ["z", "A residual in standard uncertainties of its reading. Noise alone stays below 2.8 in 95 of 100 cases; below 2.4 where only Fx and Fy are judged."],
      ["ln evidence", "How strongly the readings speak for an explanation against nothing missing. 3 is clear, 10 is overwhelming."],
      ["window", "The stretch of readings that is averaged: once with the weight on, once without."],
      ["tip, bone", "Where the load cell is: at the fingertip (axes of the distal phalanx) or at the clamped bone (axes of the metacarpal)."],
      ["revision", "A fitted state of a specimen's model, with what it came from."],
      ["in force", "Of a specimen's revisions, its current model: the one made last, until an older one is put in force again."],
      ["blind", "A validation case whose prediction nobody sees before the session is closed."],
    ].map(([word, text]) => [el("dt", {}, word), el("dd", {}, text)])), el("p", {}, "Axes: x proximal, y dorsal, z radial. A reading is the force that the finger exerts on the cell.")),
    panel("Keys", el("ul", {}, el("li", {}, el("kbd", {}, "Tab"), " and ", el("kbd", {}, "Enter"), " reach everything; rows of tables open with ", el("kbd", {}, "Enter"), "."),
      el("li", {}, el("kbd", {}, "←"), " and ", el("kbd", {}, "→"), " step through the fall of the error."))),
    panel("The catalogue of effects", list), el("section", { class: "panel", id: "effect", tabIndex: -1, "aria-label": "The effect" }, one));
  try {
    const { effects } = await get("/effects", {}, away.signal);
    let now = asked.effect || effects[0]?.name;
    const draw = () => fill(list, table([
      { title: "name", cell: (e) => e.name }, { title: "acts on", cell: (e) => e.stage }, { title: "what happens", wrap: true, cell: (e) => e.title }, { title: "", cell: (e) => (e.own ? "your own" : "") },
    ], effects, { pick: (e) => { show(e); document.getElementById("effect").scrollIntoView({ block: "nearest" }); document.getElementById("effect").focus({ preventScroll: true }); }, key: (e) => e.name, picked: now, caption: "Pick one to see its formula, parameters and source" }));
    const show = (effect) => {
      now = effect.name;
      draw();
      fill(one, el("h2", {}, `${effect.name}: ${effect.title}`), stages(effect.stage), el("p", {}, el("code", { class: "formula" }, effect.formula)),
        el("p", {}, el("strong", {}, "What gives it away: "), effect.tell), el("p", { class: "quiet" }, `Source: ${effect.source}`),
        table([
          { title: "parameter", wrap: true, cell: (p) => p.name }, { title: "unit", cell: (p) => p.unit }, { title: "without it", n: true, cell: (p) => compact(p.null) },
          { title: "plausible", cell: (p) => (p.range ? `${compact(p.range[0])} to ${compact(p.range[1])}` : "–") },
        ], effect.parameters));
    };
    show(effects.find((e) => e.name === now) || effects[0]);
  } catch (error) {
    if (error.name !== "AbortError") fill(list, problem(error));
  }
  return { leave: () => away.abort() };
}
