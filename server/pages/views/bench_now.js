// What can be read from two metres: what hangs, what to do, the force now, and what was predicted.
import { el } from "../dom.js";
import { masses, norm, number, words } from "../format.js";

const EVERY_MS = 180;

export class Now {
  /** `grave` stands in the place of what to do, as long as there is anything in it. */
  constructor(grave) {
    this.grave = grave;
    this.step = el("p", { class: "now-step" });
    this.todo = el("p", { class: "now-todo", role: "status", "aria-live": "polite" });
    this.state = el("p", { class: "now-state" });
    this.kind = el("p", { class: "now-kind" });
    this.force = el("span", { class: "now-number" }, "–");
    this.unit = el("span", { class: "now-unit" }, " N");
    this.prediction = el("p", { class: "now-prediction" });
    this.parts = el("p", { class: "now-parts quiet" });
    this.node = el("section", { class: "bench-now", "aria-label": "Now" }, el("div", { class: "now-left" }, this.step, this.todo, this.state),
      el("div", { class: "now-right" }, this.kind, el("p", { class: "now-force" }, this.force, this.unit), this.prediction, this.parts), grave);
    this.at = 0;
  }

  /** Show how things stand; numbers not more often than they can be read. */
  show(given, at, always = false) {
    if (!always && at - this.at < EVERY_MS) return;
    this.at = at;
    const { step, todo, state, kind, force, sd, prediction, outside, steady } = given;
    set(this.step, step);
    set(this.todo, todo);
    this.todo.classList.toggle("long", (todo ?? "").length > 40);
    set(this.state, state);
    set(this.kind, kind);
    set(this.force, force ? number(norm(force), 2) : "–");
    this.unit.hidden = !force;
    set(this.prediction, prediction);
    set(this.parts, force && given.axes ? `proximal ${number(force[0], 2)}, dorsal ${number(force[1], 2)}, radial ${number(force[2], 2)} N${sd && norm(sd) >= 0.0005 ? `, ± ${number(norm(sd), 3)} N` : ""}` : "");
    this.node.classList.toggle("graved", this.grave.childElementCount > 0);
    this.node.classList.toggle("outside", Boolean(outside));
    this.node.classList.toggle("steady", Boolean(steady));
  }
}

function set(node, text) {
  const said = text ?? "";
  if (node.textContent !== said) node.textContent = said;
}

/** What is now, from how the bench stands, from what hangs, and from the readings of this moment. */
export function nowOf({ bench, prompt, reason, cases, picked, arriving, log = null, estimate, raw, hasTare }) {
  const step = bench.steps.find((s) => s.id === bench.now);
  const last = cases.find((c) => c.id === picked && c.state === "measured") ?? cases.findLast((c) => c.state === "measured");
  const ended = bench.begun && (bench.closed || bench.stream?.state === "ended");
  const out = { step: stepText(bench, step), todo: capital(prompt ?? todoOf(bench, step, ended, arriving, log)), state: "", kind: "", force: null, prediction: "" };
  if (estimate) {
    out.kind = `${estimate.case} now`;
    out.axes = true;
    out.force = estimate.force_N;
    out.sd = estimate.sd_N;
    out.steady = estimate.steady;
    out.outside = estimate.outside;
    out.state = estimate.steady ? "steady" : capital(estimate.why || reason || "not steady yet");
    out.prediction = predictionOf(estimate);
    return out;
  }
  if (!ended && bench.begun && !raw) {
    out.kind = "no readings now";
    return out;
  }
  if (!ended && bench.begun) {
    out.kind = hasTare ? "on the cell now" : "now, without tare";
    out.force = raw;
    out.state = hasTare ? (prompt?.includes(reason) ? "" : capital(reason)) : bench.tare ? "the tare is on its way" : "no tare in force";
    const taken = step && cases.find((c) => c.id === step.id && c.state === "measured");
    if (taken) {
      out.state = `${taken.id} measured: ${number(norm(taken.measured_N), 2)} N`;
      out.prediction = taken.blinded ? "prediction hidden" : taken.predicted_N ? `predicted ${number(norm(taken.predicted_N), 2)} N` : "";
    }
    return out;
  }
  if (last) {
    out.kind = `${last.id === picked ? "picked" : "last"}: ${last.id}, ${masses(last.masses_g)}`;
    out.axes = true;
    out.force = last.measured_N;
    out.sd = last.measured_sd_N;
    out.prediction = last.blinded ? "prediction hidden" : last.predicted_N ? `predicted ${number(norm(last.predicted_N), 2)} N` : "no prediction";
  }
  return out;
}

function predictionOf(estimate) {
  if (estimate.predicted_N) return `predicted ${number(norm(estimate.predicted_N), 2)} N`;
  return { hidden: "prediction hidden", pending: "prediction is being computed", failed: "no prediction", none: "no prediction" }[estimate.prediction] ?? "";
}

function stepText(bench, step) {
  if (!bench.begun) return "";
  if (!step) return bench.closed ? "Closed" : "All steps are done";
  if (!step.masses_g) return capital(step.text);
  return `${masses(step.masses_g)} · ${words(step.posture)} · ${step.location}`;
}

// Of a log without a protocol.
const OF_LOG = { runs: "a load cell is being logged: its readings are coming in", silent: "a load cell is being logged, but no readings come",
  ended: "the log has ended: its readings are stored" };

function todoOf(bench, step, ended, arriving, log) {
  if (!bench.begun && log !== null) return OF_LOG[log] ?? "";
  if (!bench.begun && arriving) return "a recording is being replayed: its readings are coming in";
  if (!bench.begun && arriving === undefined) return "";
  if (!bench.begun) return bench.steps.length ? "recorded: no bench is running" : "waiting for the bench to begin";
  if (bench.closed) return "the session is closed: go on to Compare";
  if (ended) return "the log has ended; go on with --resume at the bench";
  return bench.todo;
}

const capital = (text) => (text ? text[0].toUpperCase() + text.slice(1) : "");
