// Load cases that are proposed to be measured: they stand on the session's checklist, for every page and the bench.
import { get, post, remove } from "../api.js";
import { el, fill, notice, problem, quiet, table } from "../dom.js";
import { masses, words } from "../format.js";

export function proposals(path, signal) {
  let steps = [];
  const buttons = new Map();
  const list = el("div");
  const alike = (a, b) => a.posture === b.posture && a.location === b.location && hung(a) === hung(b);
  const hung = (c) => JSON.stringify(Object.entries(c.masses_g).filter(([, g]) => g).sort());

  async function load() {
    try {
      steps = (await get(`${path}/checklist`, {}, signal)).steps.filter((s) => s.state === "proposed");
      fill(list, steps.length ? table([
        { title: "hang", cell: (s) => masses(s.masses_g) }, { title: "posture", cell: (s) => words(s.posture) }, { title: "at", cell: (s) => s.location },
        { title: "why", wrap: true, cell: (s) => s.why }, { title: "", cell: (s) => el("button", { class: "small", "aria-label": `Take back: ${s.text}`, onclick: () => back(s) }, "Take back") },
      ], steps, { caption: "Proposed to be measured next; each goes by itself once it is measured" }) : quiet("No load case is proposed to be measured next."));
      for (const [button, c] of buttons) state(button, c);
    } catch (error) {
      if (error.name !== "AbortError") fill(list, problem(error));
    }
  }

  async function back(step) {
    try {
      const done = await remove(`${path}/planned/${encodeURIComponent(step.id)}`);
      await load();
      notice(new Error(`${step.text} is off the checklist.`), "good", ["Undo", async () => {
        try { await post(`${path}/edits/${done.edit}/undo`); await load(); } catch (error) { notice(error); }
      }]);
    } catch (error) { notice(error); await load(); }
  }

  function state(button, c) {
    const there = steps.find((s) => alike(s, c));
    button.textContent = there ? "On the checklist: take back" : "Onto the checklist";
    button.onclick = async () => {
      button.disabled = true;
      try {
        if (there) await back(there);
        else { await post(`${path}/planned`, c); await load(); }
      } catch (error) { notice(error); }
      button.disabled = false;
    };
  }

  return {
    node: list,
    load,
    button: (c) => {
      const made = el("button", { class: "small" });
      buttons.set(made, c);
      state(made, c);
      return made;
    },
  };
}
