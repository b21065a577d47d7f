// The finger as it is held now, with what hangs on it and the forces: live, measured and predicted.
import { at, get } from "../api.js";
import { el, fill, problem, quiet } from "../dom.js";
import { number, words } from "../format.js";
import { css, niceStep, onAxis } from "./canvas.js";

// A force that is smaller is noise [N].
const LEAST_N = 0.03;
const STYLES = {
  now: { name: "now", colour: "--ink", width: 5, dash: [], head: "full" },
  measured: { name: "measured", colour: "--measured", width: 3, dash: [2, 4], head: "full" },
  predicted: { name: "predicted", colour: "--predicted", width: 3, dash: [10, 6], head: "open" },
};
const KINDS = Object.keys(STYLES);
const SAID_MS = 2000;

const turn = (matrix, v) => matrix.map((row) => row[0] * v[0] + row[1] * v[1] + row[2] * v[2]);

export class FingerView {
  constructor(session, changed, signal) {
    this.session = session;
    this.changed = changed;
    this.signal = signal;
    this.drawing = null;
    this.wanted = null;
    this.forces = { now: null, measured: null, predicted: null };
    this.room = 1;
    this.stale = this.moved = false;
    this.said = 0;
    this.views = { side: this.canvas("The finger from its radial side"), above: this.canvas("The finger from above") };
    this.title = el("p", { class: "finger-title" });
    this.legend = el("ul", { class: "legend" }, KINDS.map((kind) => el("li", { "data-kind": kind }, swatch(STYLES[kind]), el("span", {}, ""))));
    this.note = el("p", { class: "quiet" });
    this.above = el("figure", { class: "above" }, this.views.above.canvas, el("figcaption", {}, "From above: the force out of the plane"));
    this.figures = el("div", { class: "finger-views" }, el("figure", {}, this.views.side.canvas, this.caption = el("figcaption", {}, "")), this.above);
    this.heading = el("h2", { id: "finger-title" }, "The finger");
    this.state = el("div", {}, quiet("It is drawn as soon as a posture is known."));
    this.body = el("div", { hidden: true }, this.title, this.figures, this.legend, this.note);
    this.node = el("section", { class: "panel finger", "aria-labelledby": "finger-title" }, this.heading, this.state, this.body);
    this.observer = new ResizeObserver((entries) => {
      for (const { target, contentRect } of entries) {
        const view = Object.values(this.views).find((v) => v.canvas === target);
        view.width = contentRect.width;
        view.height = contentRect.height;
      }
      this.touch();
    });
    for (const view of Object.values(this.views)) this.observer.observe(view.canvas);
    this.scheme = matchMedia("(prefers-color-scheme: dark)");
    this.recolour = () => this.touch();
    this.scheme.addEventListener("change", this.recolour);
    this.above.hidden = true;
  }

  canvas(name) {
    return { canvas: el("canvas", { role: "img", "aria-label": name }), still: document.createElement("canvas"), width: 0, height: 0, name };
  }

  close() {
    this.observer.disconnect();
    this.scheme.removeEventListener("change", this.recolour);
  }

  touch() {
    this.stale = true;
    this.changed();
  }

  /** Show a load case, or a posture where no case is meant; the same again only where its forces may have changed. */
  async show(query, version) {
    const wanted = JSON.stringify([query, version]);
    if (!query || wanted === this.wanted) return;
    this.wanted = wanted;
    this.query = query;
    // Cases of a fast replay change faster than they are answered: the next is asked for once this answer is drawn.
    if (this.asking) return;
    this.asking = true;
    for (let asked = null; asked !== this.wanted;) {
      asked = this.wanted;
      try {
        this.take(await get(`${at("sessions", this.session)}/bench/finger`, this.query, this.signal));
      } catch (error) {
        if (error.name === "AbortError") return;
        if (this.wanted !== asked) continue;
        asked = this.wanted = null;
        // What is drawn stays; the page tells that the service is away.
        if (!this.drawing) fill(this.state, problem(error), el("button", { onclick: () => this.show(query, version) }, "Try again"));
      }
    }
    this.asking = false;
  }

  take(found) {
    const other = this.drawing?.case !== found.case || this.drawing?.posture !== found.posture;
    this.drawing = found;
    fill(this.state);
    this.body.hidden = false;
    const place = found.places[found.location ?? "tip"];
    const laid = (v) => (v ? turn(place.from_mount, v) : null);
    this.forces.measured = laid(found.measured_N);
    this.forces.predicted = laid(found.predicted_N);
    if (other) {
      this.forces.now = null;
      this.room = 0;
      this.above.hidden = true;
    }
    const hung = Object.entries(found.masses_g).map(([m, g]) => `${m} ${Number(g.toPrecision(4))} g`).join(" + ");
    const angles = Object.entries(found.angles_deg).filter(([n, d]) => n !== "abduction" || Math.abs(d) > 0.05).map(([n, d]) => `${n} ${number(d, 0)}°`).join(", ");
    fill(this.title, el("strong", {}, words(found.posture)), ` ${angles}`, found.case ? ` · ${found.case}: ${hung || "no weight"}, cell at the ${found.location}` : "");
    fill(this.note, found.note);
    fill(this.caption, `From the radial side. The bones' shape is schematic. Model: ${found.model}.`);
    this.touch();
  }

  /** The force now: [N] in mount axes, or in the cell's own with the tare taken off; null where it is not known. */
  live(force, ofCell, location) {
    if (!this.drawing) return;
    const place = this.drawing.places[location ?? this.drawing.location ?? "tip"];
    const laid = force && turn(ofCell ? place.from_cell : place.from_mount, force);
    const before = this.forces.now;
    if (laid && before && Math.hypot(laid[0] - before[0], laid[1] - before[1], laid[2] - before[2]) < 0.003) return;
    if (!laid && !before) return;
    this.forces.now = laid;
    this.place = location ?? this.drawing.location ?? "tip";
    this.moved = true;
    this.changed();
  }

  /** The prediction that the live stream tells [N], in mount axes. */
  predicted(force) {
    if (!this.drawing || !force) return;
    const place = this.drawing.places[this.drawing.location ?? "tip"];
    this.forces.predicted = turn(place.from_mount, force);
    this.moved = true;
  }

  draw(now) {
    if (!this.drawing || !(this.stale || this.moved)) return false;
    const sizes = KINDS.map((k) => (this.forces[k] ? Math.hypot(...this.forces[k]) : 0));
    const out = KINDS.some((k, i) => sizes[i] > LEAST_N && Math.abs(this.forces[k][2]) > Math.max(0.05, 0.04 * sizes[i]));
    if (out && this.above.hidden) {
      this.above.hidden = false;
      this.stale = true;
    }
    const most = Math.max(...sizes, 0.2);
    if (most > this.room || !this.room) {
      this.room = nice(1.15 * most);
      this.stale = true;
    }
    for (const [name, view] of Object.entries(this.views)) if (!(name === "above" && this.above.hidden)) this.drawView(name, view);
    this.stale = this.moved = false;
    return true;
  }

  /** Say the forces in words too; called now and then. */
  say(now) {
    if (!this.drawing) return;
    const told = [];
    KINDS.forEach((kind, i) => {
      const item = this.legend.children[i];
      const force = this.forces[kind];
      const text = `${STYLES[kind].name} ${force ? `${number(Math.hypot(...force), 2)} N` : "–"}`;
      if (item.lastChild.textContent !== text) item.lastChild.textContent = text;
      if (force) told.push(text);
    });
    if (now - this.said < SAID_MS) return;
    this.said = now;
    const hung = Object.entries(this.drawing.masses_g).map(([m, g]) => `${g} g on ${m}`).join(", ") || "no weight";
    for (const view of Object.values(this.views)) {
      const label = `${view.name}, posture ${words(this.drawing.posture)}, ${hung}. Force on the cell: ${told.join(", ") || "not known"}.`;
      if (view.canvas.getAttribute("aria-label") !== label) view.canvas.setAttribute("aria-label", label);
    }
  }

  drawView(name, view) {
    const { width, height } = view;
    if (width < 20 || height < 20) return;
    const scale = devicePixelRatio || 1;
    if (this.stale) {
      for (const canvas of [view.canvas, view.still]) {
        canvas.width = Math.round(width * scale);
        canvas.height = Math.round(height * scale);
      }
      const still = view.still.getContext("2d");
      still.setTransform(scale, 0, 0, scale, 0, 0);
      view.to = this.drawStill(still, this.drawing.views[name], width, height, name);
    }
    const context = view.canvas.getContext("2d");
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.clearRect(0, 0, view.canvas.width, view.canvas.height);
    context.drawImage(view.still, 0, 0);
    context.setTransform(scale, 0, 0, scale, 0, 0);
    this.drawForces(context, this.drawing.views[name].paper, view.to, width, height);
  }

  /** Bones, tendons and weights; returns what takes a point on the paper to the canvas, and how long a newton is. */
  drawStill(context, view, width, height, name) {
    const drawing = this.drawing;
    const stub = drawing.stub_mm;
    const weights = name === "side" ? placed(view.strings, stub) : [];
    const box = [Infinity, Infinity, -Infinity, -Infinity];
    const grow = (x, y) => { box[0] = Math.min(box[0], x); box[1] = Math.min(box[1], y); box[2] = Math.max(box[2], x); box[3] = Math.max(box[3], y); };
    for (const bone of view.bones_mm) for (const [x, y] of bone) grow(x, y);
    for (const w of weights) { grow(w.x - 0.25 * stub, w.top); grow(w.x + 0.3 * stub, w.bottom); }
    const long = 0.62 * drawing.reach_mm;
    for (const kind of KINDS) {
      const force = this.forces[kind];
      if (!force) continue;
      const [x0, y0] = turn(view.paper, drawing.places[drawing.location ?? "tip"].at_mm);
      const [fx, fy] = turn(view.paper, force);
      grow(x0 + (fx / this.room) * long, y0 + (fy / this.room) * long);
    }
    const margin = [54, 34];
    const mm = Math.min((width - 2 * margin[0]) / Math.max(box[2] - box[0], 1), (height - 2 * margin[1]) / Math.max(box[3] - box[1], 1));
    const left = (width - mm * (box[2] - box[0])) / 2;
    const top = (height - mm * (box[3] - box[1])) / 2;
    const to = (p) => [left + (p[0] - box[0]) * mm, top + (box[3] - p[1]) * mm];
    to.newton = (mm * long) / this.room;
    const line = (points, close) => {
      context.beginPath();
      points.forEach((p, i) => { const [x, y] = to(p); if (i) context.lineTo(x, y); else context.moveTo(x, y); });
      if (close) context.closePath();
    };
    context.lineJoin = context.lineCap = "round";
    const first = view.bones_mm[0];
    const right = Math.max(...first.map((p) => p[0]));
    const jaw = 0.34 * stub;
    context.fillStyle = css("--clamp");
    const [cx, cy] = to([right - 0.3 * stub, jaw]);
    context.fillRect(cx, cy, 0.36 * stub * mm, 2 * jaw * mm);
    context.lineWidth = 1.5;
    context.strokeStyle = css("--bone-line");
    context.fillStyle = css("--bone");
    for (const bone of view.bones_mm) {
      line(bone, true);
      context.fill();
      context.stroke();
    }
    for (const tendon of [...view.tendons].sort((a, b) => a.loaded - b.loaded)) {
      context.strokeStyle = css(tendon.loaded ? "--loaded" : "--tendon");
      context.lineWidth = tendon.loaded ? 3.5 : 1;
      context.globalAlpha = tendon.loaded ? 1 : 0.7;
      line(tendon.line_mm);
      context.stroke();
    }
    context.globalAlpha = 1;
    for (const { joint, at_mm } of view.joints) {
      const [x, y] = to(at_mm);
      context.beginPath();
      context.arc(x, y, 4, 0, 7);
      context.fillStyle = css("--panel");
      context.strokeStyle = css("--bone-line");
      context.lineWidth = 1.5;
      context.fill();
      context.stroke();
      if (name === "side") text(context, joint, x, y - 13, { size: 13, bold: true, colour: "--quiet", align: "center", halo: true });
    }
    // Where the finger is drawn small, names of weights would meet: every other one stands lower.
    const apart = weights.length > 1 ? Math.abs(to([weights[1].x, 0])[0] - to([weights[0].x, 0])[0]) : Infinity;
    for (const [i, w] of weights.entries()) this.drawWeight(context, w, to, stub * mm, apart < 56 && i % 2 ? 36 : 0);
    this.drawScale(context, to, width, height);
    return to;
  }

  drawWeight(context, w, to, stub, lower) {
    context.strokeStyle = css("--loaded");
    context.lineWidth = 2;
    context.beginPath();
    for (const [i, p] of [...w.line, [w.x, w.line.at(-1)[1]], [w.x, w.top]].entries()) {
      const [x, y] = to(p);
      if (i) context.lineTo(x, y); else context.moveTo(x, y);
    }
    context.stroke();
    const [x, top] = to([w.x, w.top]);
    const [, bottom] = to([w.x, w.bottom]);
    context.fillStyle = css("--weight");
    context.beginPath();
    context.roundRect(x - 0.16 * stub, top, 0.32 * stub, bottom - top, 4);
    context.fill();
    context.stroke();
    text(context, `${w.tendon}`, x, bottom + 14 + lower, { size: 15, bold: true, align: "center" });
    text(context, `${Number(w.mass_g.toPrecision(4))} g`, x, bottom + 31 + lower, { size: 15, align: "center" });
  }

  /** A bar of so many newtons, as long as such a force is drawn. */
  drawScale(context, to, width, height) {
    const step = niceStep(this.room, 2);
    const long = step * to.newton;
    context.strokeStyle = css("--ink");
    context.lineWidth = 2;
    context.beginPath();
    context.moveTo(12, height - 16);
    context.lineTo(12, height - 10);
    context.lineTo(12 + long, height - 10);
    context.lineTo(12 + long, height - 16);
    context.stroke();
    text(context, `${onAxis(step, step)} N`, 12 + long / 2, height - 20, { size: 13, align: "center" });
  }

  drawForces(context, paper, to, width, height) {
    const labels = [];
    for (const kind of ["predicted", "measured", "now"]) {
      const force = this.forces[kind];
      if (!force) continue;
      const at_ = kind === "now" && this.place ? this.place : this.drawing.location ?? "tip";
      const [x, y] = to(turn(paper, this.drawing.places[at_].at_mm));
      const [fx, fy] = turn(paper, force);
      const size = Math.hypot(...force);
      if (size < LEAST_N) continue;
      const ex = x + fx * to.newton;
      const ey = y - fy * to.newton;
      arrow(context, x, y, ex, ey, STYLES[kind]);
      labels.push([ex, ey, Math.atan2(ey - y, ex - x), kind, size]);
    }
    const taken = [];
    for (const [ex, ey, angle, kind, size] of labels.reverse()) {
      const said = `${STYLES[kind].name} ${number(size, 2)} N`;
      context.font = `${kind === "now" ? "bold " : ""}15px system-ui, sans-serif`;
      const wide = context.measureText(said).width;
      let px = Math.min(Math.max(ex + 14 * Math.cos(angle) - (Math.cos(angle) < 0 ? wide : 0), 4), width - wide - 4);
      let py = Math.min(Math.max(ey + 16 * Math.sin(angle), 14), height - 10);
      for (let n = 0; n < 6 && taken.some(([a, b, c]) => Math.abs(b - py) < 20 && px < a + c && a < px + wide); n++) py += py > height - 40 ? -21 : 21;
      taken.push([px, py, wide]);
      text(context, said, px, py, { size: 15, bold: kind === "now", colour: STYLES[kind].colour, halo: true });
    }
  }
}

/** The next of 0.5, 1, 2, 5, 10 … newtons. */
function nice(force) {
  const power = 10 ** Math.floor(Math.log10(force));
  return [1, 2, 5, 10].find((k) => k * power >= force) * power;
}

/** Weights on their strings beyond the clamp, side by side; the lowest string hangs nearest. */
function placed(strings, stub) {
  const sorted = [...strings].sort((a, b) => a.line_mm.at(-1)[1] - b.line_mm.at(-1)[1]);
  const heaviest = Math.max(...sorted.map((s) => s.mass_g), 1);
  const lowest = Math.min(...sorted.map((s) => s.line_mm.at(-1)[1]), 0);
  return sorted.map((s, i) => {
    const top = lowest - 0.5 * stub;
    return { tendon: s.tendon, mass_g: s.mass_g, line: s.line_mm, x: (1.35 + 0.62 * i) * stub, top, bottom: top - 0.4 * stub * (0.4 + (0.6 * s.mass_g) / heaviest) };
  });
}

function text(context, said, x, y, { size = 13, bold = false, colour = "--ink", align = "left", halo = false } = {}) {
  context.font = `${bold ? "bold " : ""}${size}px system-ui, sans-serif`;
  context.textAlign = align;
  context.textBaseline = "middle";
  if (halo) {
    context.lineWidth = 4;
    context.lineJoin = "round";
    context.strokeStyle = css("--panel");
    context.strokeText(said, x, y);
  }
  context.fillStyle = css(colour);
  context.fillText(said, x, y);
}

function arrow(context, x, y, ex, ey, style) {
  const long = Math.hypot(ex - x, ey - y);
  const angle = Math.atan2(ey - y, ex - x);
  const head = Math.min(15, 0.6 * long);
  context.strokeStyle = context.fillStyle = css(style.colour);
  context.lineWidth = style.width;
  context.lineCap = "butt";
  context.setLineDash(style.dash);
  context.beginPath();
  context.moveTo(x, y);
  context.lineTo(ex - (style.head === "full" ? 0.8 * head : 0) * Math.cos(angle), ey - (style.head === "full" ? 0.8 * head : 0) * Math.sin(angle));
  context.stroke();
  context.setLineDash([]);
  context.beginPath();
  context.moveTo(ex - head * Math.cos(angle - 0.42), ey - head * Math.sin(angle - 0.42));
  context.lineTo(ex, ey);
  context.lineTo(ex - head * Math.cos(angle + 0.42), ey - head * Math.sin(angle + 0.42));
  if (style.head === "full") {
    context.closePath();
    context.fill();
  } else {
    context.lineWidth = Math.min(style.width, 3);
    context.stroke();
  }
}

/** A piece of a line, as it is drawn, for the legend. */
function swatch(style) {
  const made = (name, given) => {
    const node = document.createElementNS("http://www.w3.org/2000/svg", name);
    for (const [key, value] of Object.entries(given)) node.setAttribute(key, value);
    return node;
  };
  const svg = made("svg", { width: 46, height: 14, "aria-hidden": "true" });
  const look = { stroke: `var(${style.colour})`, "stroke-width": style.width, fill: "none" };
  svg.append(made("line", { x1: 1, y1: 7, x2: 36, y2: 7, "stroke-dasharray": style.dash.join(" "), ...look }),
    made("path", style.head === "full" ? { d: "M34 1 L45 7 L34 13 Z", fill: `var(${style.colour})` } : { d: "M34 1 L44 7 L34 13", ...look, "stroke-width": 2.5 }));
  return svg;
}
