// One load case: its force and prediction, the finger with it, its windows, left out and taken in again.
import { at, get, post, put } from "../api.js";
import { el, empty, fill, note, problem, quiet } from "../dom.js";
import { compact, masses, norm, number, vector, words, zOf } from "../format.js";
import { figure } from "../plot.js";
import { windows } from "./windows.js";

/** A panel of one case; `changed` takes the promise of an edit, and what it was in words. */
export function oneCase({ session, path, model, changed, signal }) {
  const node = el("div", { "aria-live": "polite" });
  let shown = null;
  let seen = "";
  let typed = false;
  node.addEventListener("input", () => { typed = true; });

  async function read(id) {
    const [found, compared] = await Promise.all([get(`${path}/cases/${encodeURIComponent(id)}`, {}, signal),
      get(`${path}/comparison`, { model: model() }, signal).catch((error) => { if (error.name === "AbortError") throw error; return null; })]);
    const other = compared?.cases.find((c) => c.id === id);
    return other ? { ...found, ...other, shown_z: zOf(other, compared), of: compared.residuals_after } : found;
  }

  async function show(id) {
    shown = id;
    if (node.dataset.case !== id) fill(node, el("h2", {}, "The load case"), quiet("Loading …"));
    node.dataset.case = id;
    try {
      const c = await read(id);
      if (shown === id) draw(c);
    } catch (error) {
      if (error.name !== "AbortError" && shown === id) fill(node, el("h2", {}, "The load case"), problem(error), el("button", { onclick: () => show(id) }, "Try again"));
    }
  }

  function draw(c) {
    typed = false;
    seen = JSON.stringify(c);
    const finger = el("div");
    const traces = el("div");
    const where = `${path}/cases/${encodeURIComponent(c.id)}`;
    fill(node, el("h2", {}, `${c.id}: ${masses(c.masses_g)}, ${words(c.posture)}, ${c.location}`),
      (c.amended || []).map((a) => el("p", {}, `Amended (entered: ${masses(c.entered)}): ${a.why}`)),
      c.why ? el("p", { class: "warn" }, `${words(c.state)}: ${c.why}`) : null,
      el("p", {}, el("span", { class: "big" }, `${number(norm(c.measured_N), 2)} N`), " measured in space; ",
        c.blinded ? "the prediction is hidden until the bench closes the session" : c.predicted_N ? `${number(norm(c.predicted_N), 2)} N predicted` : "no prediction"),
      note(`measured ${vector(c.measured_N)} N`, c.measured_sd_N ? ` ± ${vector(c.measured_sd_N)} N` : "",
        c.residual_N ? `; measured − predicted ${vector(c.residual_N)} N` : "", c.shown_z === null || c.shown_z === undefined ? "" : `; z ${compact(c.shown_z)}`, c.of ? `. Model: ${c.of}` : ""),
      el("div", { class: "columns" }, finger, traces),
      c.state === "excluded" ? el("button", { onclick: () => changed(post(`${where}/include`), `${c.id} is taken in again.`) }, "Take it in again") : exclusion(c.id, where));
    figure(finger, "finger", { session, case: c.id, model: model() }, { signal });
    if (Object.keys(c.windows).length) {
      windows(traces, session, c.id, (name, span) => changed(put(`${where}/windows`, { [name]: span }), `A window of ${c.id} is moved.`), signal);
    } else fill(traces, quiet("Published data: an averaged force without readings, so there is no window to move."));
  }

  function exclusion(id, where) {
    const why = el("input", { id: "why", placeholder: "such as: the suture slipped", required: true });
    return el("form", { class: "row no-print", onsubmit: (e) => {
      e.preventDefault();
      changed(post(`${where}/exclude`, { reason: why.value }), `${id} is left out: ${why.value}.`);
    } }, el("div", {}, el("label", { htmlFor: "why" }, "Leave it out, because"), why), el("button", {}, "Exclude"));
  }

  /** Somebody changed the session: what is being typed here is not thrown away. */
  async function again(id) {
    if (shown !== id || !node.firstChild) return show(id);
    try {
      const c = await read(id);
      if (shown !== id || JSON.stringify(c) === seen) return;
      const stale = node.querySelector(".stale");
      if (!typed) draw(c);
      else if (!stale) node.prepend(el("p", { class: "warn stale", role: "status" }, "This case was changed meanwhile. ", el("button", { onclick: () => draw(c) }, "Show it as it is now")));
    } catch (error) {
      if (error.name !== "AbortError" && shown === id && !typed) fill(node, problem(error));
    }
  }

  /** What was typed is on its way to the service; the answer takes that back, for what was refused. */
  function settle() {
    const was = typed;
    typed = false;
    return () => { typed ||= was; };
  }

  return { node, show, again, settle, none: (text) => { if (!typed) { shown = null; fill(node, el("h2", {}, "The load case"), empty(text)); } } };
}
