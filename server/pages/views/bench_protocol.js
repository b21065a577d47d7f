// The protocol at a glance: a row for each posture and place of the cell, a column for each load, a mark for each case.
import { el, empty, fill } from "../dom.js";
import { masses, norm, number, words } from "../format.js";

// A sign as well as a colour for every state.
const STATES = {
  now: ["▶", "now"], measured: ["✓", "measured"], done: ["✓", "done"], waiting: ["…", "waiting for its readings"],
  failed: ["✗", "failed"], excluded: ["⊘", "excluded"], skipped: ["–", "skipped"], open: ["○", "to do"], proposed: ["◇", "proposed"],
};
const SHOWN = ["now", "measured", "open", "failed", "skipped", "excluded", "waiting", "proposed"];

export class ProtocolGrid {
  /** `pick` is called with a step's id. */
  constructor(pick) {
    this.pick = pick;
    this.drawn = "";
    this.seen = null;
    this.weights = el("p", { class: "row weights" });
    this.count = el("p", { class: "quiet", role: "status" });
    this.place = el("div", { class: "protocol-scroll" });
    this.legend = el("p", { class: "quiet protocol-legend" }, SHOWN.map((s) => [el("span", { class: `mark ${s}`, "aria-hidden": "true" }, STATES[s][0]), ` ${STATES[s][1]}  `]),
      el("span", { class: "mark validation", "aria-hidden": "true" }, "V"), " validation: blind until closed");
    this.node = el("section", { class: "panel protocol", "aria-labelledby": "protocol-title" }, el("h2", { id: "protocol-title" }, "The protocol"), this.count, this.weights, this.place, this.legend);
  }

  /** Show the steps; drawn anew only where any has changed. */
  show(steps, cases, now, picked, begun) {
    const known = new Map(cases.map((c) => [c.id, c]));
    const rows = steps.map((s) => ({ ...s, state: stateOf(s, known.get(s.id), now), found: known.get(s.id) }));
    const drawn = JSON.stringify([rows.map((r) => [r.id, r.state, r.found?.measured_N]), now, picked]);
    if (drawn === this.drawn) return;
    this.drawn = drawn;
    const held = document.activeElement?.dataset?.step;
    const loads = rows.filter((r) => r.masses_g);
    const done = rows.filter((r) => ["measured", "done"].includes(r.state)).length;
    const steady = rows.filter((r) => r.state !== "proposed").length;
    this.count.textContent = rows.length ? `${done} of ${steady} steps done${now ? `; now ${nameOf(rows.find((r) => r.id === now), now)}` : ""}` : "";
    fill(this.weights, rows.filter((r) => r.when).map((r) => el("span", { class: `chip mark ${r.state}` }, `${STATES[r.state][0]} known weight ${r.when}`)));
    this.legend.hidden = !loads.length;
    fill(this.place, loads.length ? this.grid(loads, picked, now) : empty(begun ? "The protocol has no load case." :
      "No protocol yet. The bench sends it when it begins: fingertwin log … --protocol … --setup … --to this service."));
    if (held) this.place.querySelector(`[data-step="${CSS.escape(held)}"]`)?.focus({ preventScroll: true });
    if (now && now !== this.seen) this.follow(now);
  }

  /** Bring the present case into view within the grid; the page itself stays where it is. */
  follow(now) {
    const cell = this.place.querySelector(`[data-step="${CSS.escape(now)}"]`)?.closest("td");
    if (!cell) return;
    this.seen = now;
    const box = this.place.getBoundingClientRect();
    const its = cell.getBoundingClientRect();
    this.place.scrollLeft += its.left - box.left - box.width / 2;
    this.place.scrollTop += its.top - box.top - box.height / 2;
  }

  grid(rows, picked, now) {
    const columns = [...new Map(rows.map((r) => [masses(r.masses_g), r.masses_g]))].map(([key, hung]) => ({ key, hung }));
    const lines = [...new Map(rows.map((r) => [`${r.location} ${r.posture}`, r]))].map(([key, r]) => ({ key, posture: r.posture, location: r.location }));
    const cells = new Map();
    for (const r of rows) {
      const key = `${r.location} ${r.posture}|${masses(r.masses_g)}`;
      cells.set(key, [...(cells.get(key) || []), r]);
    }
    const head = el("tr", {}, el("th", { scope: "col" }, "Posture, cell at"), columns.map(({ hung }) => el("th", { scope: "col" }, header(hung))));
    const body = lines.map((line) => el("tr", {}, el("th", { scope: "row" }, words(line.posture), el("small", {}, line.location)),
      columns.map(({ key }) => el("td", {}, (cells.get(`${line.key}|${key}`) || []).map((r) => this.mark(r, picked, now))))));
    return el("table", { class: "protocol-grid" }, el("thead", {}, head), el("tbody", {}, body));
  }

  mark(row, picked, now) {
    const [sign, said] = STATES[row.state];
    const force = row.found?.measured_N ? `, ${number(norm(row.found.measured_N), 2)} N` : "";
    const blind = row.role === "validation" ? ", validation" : "";
    const name = `${row.id}: ${row.text}${blind}: ${said}${force}${row.why ? `. ${row.why}` : ""}`;
    return el("button", { class: `mark ${row.state}${row.role === "validation" ? " validation" : ""}${row.id === now ? " current" : ""}`, "data-step": row.id, title: name, "aria-label": name,
      "aria-pressed": String(row.id === picked), "aria-current": row.id === now ? "step" : null, onclick: () => this.pick(row.id === picked ? null : row) }, sign);
  }
}

function stateOf(step, found, now) {
  if (step.state === "proposed") return "proposed";
  if (step.state === "excluded" || step.state === "skipped") return step.state;
  if (found && found.state !== "waiting") return found.state;
  if (found || step.state === "done") return found ? "waiting" : "done";
  return step.id === now ? "now" : "open";
}

/** A case by its id, a known weight in words. */
function nameOf(row, id) {
  if (!row?.when) return id;
  return row.when === "during" ? "the known weight between cases" : `the known weight ${row.when} the cases`;
}

function header(hung) {
  const parts = Object.entries(hung);
  if (!parts.length) return "no weight";
  return parts.map(([m, g]) => el("span", { class: "load" }, el("b", {}, m), ` ${Number(g.toPrecision(4))} g`));
}
