// What is wrong now and what to do about it while the weight still hangs; each warning goes with its cause.
import { el } from "../dom.js";
import { seconds } from "../format.js";

export class Warnings {
  constructor() {
    // Only what is added is read aloud: what goes, goes silently.
    const made = (name) => el("div", { class: "warnings", role: "alert", "aria-live": "assertive", "aria-relevant": "additions", "aria-label": name });
    // What cannot wait stands where otherwise the next step does.
    this.grave = made("Look now");
    this.node = made("Warnings");
    this.shown = new Map();
  }

  /** Show these, each {id, title, text, to_do, grave}; those that are there already are not said again. */
  show(found) {
    const wanted = new Map(found.map((w) => [w.id, w]));
    for (const [id, node] of this.shown) {
      if (wanted.has(id)) continue;
      node.remove();
      this.shown.delete(id);
    }
    for (const [id, w] of wanted) {
      const node = this.shown.get(id);
      if (node) {
        const text = node.querySelector(".found");
        if (text.textContent !== w.text) text.textContent = w.text;
        continue;
      }
      const made = el("div", { class: `warning${w.grave ? " grave" : ""}` }, el("span", { class: "sign", "aria-hidden": "true" }, w.grave ? "⚠" : "!"),
        el("div", {}, el("p", { class: "title" }, w.title), el("p", { class: "to-do" }, w.to_do), el("p", { class: "found" }, w.text)));
      this.shown.set(id, made);
    }
    // The most urgent stands first; what stands right is not moved, or it would be said again.
    for (const place of [this.grave, this.node]) {
      let next = place.firstChild;
      for (const [id, w] of wanted) {
        if ((w.grave ? this.grave : this.node) !== place) continue;
        const node = this.shown.get(id);
        if (node === next) next = next.nextSibling;
        else place.insertBefore(node, next);
      }
    }
  }
}

/** All that is wrong: what the bench says, what its readings show, and what the page itself notices. */
export function warningsOf({ bench, estimate, logging, overloaded, silentS, away, now, tareAgeS }) {
  const out = [];
  const add = (id, grave, title, to_do, text = "") => out.push({ id, grave, title, to_do, text });
  const stream = bench?.stream;
  const running = bench?.begun && !bench.closed && stream?.state !== "ended";
  if (away) add("away", true, "The service does not answer", "Go on at the bench's terminal: nothing is lost.");
  if (running && stream?.state === "lost") add("lost", true, "The load cell's cable is out", "Plug it in again: logging goes on by itself.", stream.why);
  else if (running && !away && stream?.state === "silent") add("silent", true, "The load cell is silent", "Look at its cable and its power.");
  else if ((running || logging) && !away && silentS > 3) add("nothing", true, "Nothing comes from the bench", "Look at the cell's cable, and whether the log still runs.");
  if ((running || logging) && (overloaded || stream?.overloaded)) add("overload", true, "The load is beyond the cell's range", "Take weight off at once: the cell can be damaged. Then tare.");
  for (const w of running ? bench.warnings : []) add(`${w.code} ${w.at_s}`, w.code === "doubtful_force", w.title, w.to_do, w.text);
  const said = running && bench.warnings.some((w) => w.code === "doubtful_force");
  const doubt = estimate?.doubts?.find(Boolean);
  if (running && !said && (estimate?.outside && estimate.steady)) {
    add("outside", true, "Far from the prediction", "Leave it on and look: right tendon, right weight, nothing touching?", doubt || "");
  } else if (running && !said && doubt && estimate?.steady) add("doubt", true, "The force can hardly be right", "Leave it on and look before you confirm.", doubt);
  if (running && stream?.last_gap_s !== null && stream?.last_gap_s !== undefined && now - stream.last_gap_s < 20) {
    add("gap", false, "Readings were lost", "Wait for a new plateau; if it happens again, look at the cable.", `${stream.lost_samples} readings in ${stream.gaps} ${stream.gaps === 1 ? "gap" : "gaps"} so far`);
  }
  if (running && bench.tare && tareAgeS > bench.tare.stale_after_s) add("stale", false, "The tare is old", "With the next weight off, tare again.", `taken ${seconds(tareAgeS)} ago`);
  return out;
}
