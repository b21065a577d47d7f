// An effect of one's own: a formula that is checked while it is typed, and then takes part in searches.
import { get, post } from "../api.js";
import { el, fill, note, notice, panel, problem } from "../dom.js";
import { compact } from "../format.js";

const key = (session) => `effects ${session}`;
/** Names of own effects that take part in the next search of a session. */
export const taking = (session) => JSON.parse(sessionStorage.getItem(key(session)) || "[]");

export function ownEffect(session, signal, add) {
  const text = el("textarea", { id: "formula", spellcheck: false, "aria-describedby": "formula-said" });
  const said = el("div", { id: "formula-said", "aria-live": "polite" });
  const list = el("div");
  const go = el("button", { disabled: true, onclick: () => keep() }, "Let it take part");
  text.value = sessionStorage.getItem("formula") || "";
  let timer = null;
  let turn = 0;
  let sound = "";

  text.oninput = () => {
    sessionStorage.setItem("formula", text.value);
    go.disabled = true;
    clearTimeout(timer);
    timer = setTimeout(check, 300);
  };

  async function check() {
    const mine = ++turn;
    const formula = text.value.trim();
    if (!formula) return fill(said);
    try {
      const e = await post("/effects/check", { formula });
      if (mine !== turn) return;
      sound = formula;
      go.disabled = false;
      fill(said, el("p", { class: "good" }, `Sound: ${e.stage}; ${e.parameters.map((p) => `${p.name} [${p.unit}] from ${compact(p.range?.[0])} to ${compact(p.range?.[1])}`).join(", ")}.`));
    } catch (error) {
      if (mine !== turn) return;
      fill(said, problem(error), error.status ? null : el("button", { onclick: check }, "Check it again"));
    }
  }

  async function keep() {
    try {
      const e = await post("/effects", { formula: sound || text.value });
      take(e.name);
      notice(new Error(`${e.name} takes part in the next search.`), "good");
    } catch (error) { notice(error); }
  }

  function take(name, on = true) {
    const now = new Set(taking(session));
    if (on) now.add(name); else now.delete(name);
    sessionStorage.setItem(key(session), JSON.stringify([...now]));
    load();
  }

  async function load() {
    try {
      const own = (await get("/effects", {}, signal)).effects.filter((e) => e.own);
      const now = taking(session);
      fill(list, own.length ? [el("h3", {}, "Kept effects"), own.map((e) => el("p", { class: "row" },
        el("label", { class: "check" }, el("input", { type: "checkbox", checked: now.includes(e.name), onchange: (c) => take(e.name, c.target.checked) }), el("span", {}, `${e.name}: `, el("code", {}, e.formula))),
        el("a", { class: "button small", href: `#/sessions/${encodeURIComponent(session)}/effect?name=${encodeURIComponent(e.name)}` }, "What it would change"),
        el("button", { class: "small", onclick: () => add(e.name) }, "Add and refit")))] : null);
    } catch { /* the list is no more than a help */ }
  }

  load();
  if (text.value.trim()) check();
  const node = panel("An effect of your own",
    note("A formula with one coefficient k, such as ", el("code", {}, "torque[PIP] += k * t_EDC * sin(q_PIP)"), ". It is checked against a list of what it may use, and never run as code."),
    el("label", { htmlFor: "formula" }, "Formula"), text, said, go, list);
  return { node, take };
}
