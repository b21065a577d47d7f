// Six live traces that can be zoomed and looked back in; no peak is left out, and nothing is drawn that has not changed.
import { at, get } from "../api.js";
import { el, fill, quiet } from "../dom.js";
import { number as written, percent } from "../format.js";
import { AXES } from "./bench_ring.js";
import { LEFT, drawTrace } from "./bench_trace.js";

export const CHANNELS = [["Fx", "N", 0.05], ["Fy", "N", 0.05], ["Fz", "N", 0.05], ["Tx", "N mm", 0.5], ["Ty", "N mm", 0.5], ["Tz", "N mm", 0.5]];
const COLUMNS = ["Fx_N", "Fy_N", "Fz_N", "Tx_Nmm", "Ty_Nmm", "Tz_Nmm"];
// No zero with a sign.
const number = (value, digits) => written(Math.abs(value) < 0.5 * 10 ** -digits ? 0 : value, digits);
const SPANS_S = [2, 5, 10, 20, 30, 60, 120, 300, 600, 1800, 3600];
const POINTS = 1500;
const LIVE_SPAN_S = 30;

export class Traces {
  /** Six canvases about a ring; `changed` asks for a frame. */
  constructor(ring, session, changed, signal) {
    this.ring = ring;
    this.session = session;
    this.changed = changed;
    this.signal = signal;
    this.span = LIVE_SPAN_S;
    // Whether all that was stored is shown, because nothing came yet.
    this.whole = false;
    // End of what is shown [s]; null follows what comes.
    this.end = null;
    this.tall = 1;
    this.offset = new Float64Array(AXES);
    this.hasTare = false;
    this.window = null;
    this.range = null;
    this.past = null;
    this.asking = null;
    this.drawnEnd = NaN;
    this.drawnAt = 0;
    this.stale = true;
    this.stored = false;
    // The stream that is shown; null is the session's own.
    this.stream = null;
    this.fingers = new Map();
    this.build();
  }

  build() {
    this.values = CHANNELS.map(() => el("span", { class: "trace-value" }, "–"));
    this.bars = CHANNELS.map(() => el("span", { class: "saturation-bar" }));
    this.tracks = this.bars.map((bar) => el("span", { class: "saturation-track", hidden: true }, bar));
    this.shares = CHANNELS.map(() => el("span", { class: "quiet" }, ""));
    this.canvases = CHANNELS.map(([name, unit]) => el("canvas", { role: "img", "aria-label": `${name} in ${unit} against time` }));
    this.liveButton = el("button", { class: "toggle", "aria-pressed": "true", onclick: () => this.follow() }, "Live");
    this.tareBox = el("input", { type: "checkbox", checked: true, onchange: () => this.touch() });
    this.tareLabel = el("label", { class: "check" }, this.tareBox, "Tare taken off");
    this.spanText = el("span", { class: "quiet", role: "status" });
    this.note = quiet("");
    const button = (text, name, act) => el("button", { "aria-label": name, title: name, onclick: act }, text);
    this.field = el("div", { class: "traces", tabIndex: 0, role: "group",
      "aria-label": "Six traces: arrow keys look back, plus and minus zoom in time, page up and down in height, End goes live",
      onkeydown: (e) => this.key(e), onwheel: (e) => this.wheel(e), onpointerdown: (e) => this.down(e), onpointermove: (e) => this.move(e),
      onpointerup: (e) => this.up(e), onpointercancel: (e) => this.up(e) },
    CHANNELS.map(([name, unit], i) => el("div", { class: "trace" },
      el("h3", {}, el("span", {}, `${name} [${unit}]`), this.values[i]),
      el("div", { class: "saturation" }, this.tracks[i], this.shares[i]), this.canvases[i])));
    this.node = el("section", { class: "panel", "aria-labelledby": "traces-title" },
      el("h2", { id: "traces-title" }, "Traces"), this.tools = el("div", { class: "row trace-tools" }, this.liveButton,
        button("−", "Show a longer time", () => this.zoom(1)), button("+", "Show a shorter time", () => this.zoom(-1)), this.spanText,
        button("↕−", "Flatter traces", () => this.taller(1 / 1.5)), button("↕+", "Taller traces", () => this.taller(1.5)),
        button("↕ fit", "Fit the height to the readings", () => this.taller(0)), this.tareLabel),
      this.note, this.field,
      this.hint = quiet("In the cell's own axes; no peak is left out. Drag to look back; pinch, or Ctrl and the wheel, to zoom."));
    this.sizes = CHANNELS.map(() => [0, 0]);
    this.observer = new ResizeObserver((entries) => {
      for (const entry of entries) {
        const i = this.canvases.indexOf(entry.target);
        this.sizes[i] = [entry.contentRect.width, entry.contentRect.height];
        const scale = devicePixelRatio || 1;
        entry.target.width = Math.round(entry.contentRect.width * scale);
        entry.target.height = Math.round(entry.contentRect.height * scale);
      }
      this.touch();
    });
    for (const canvas of this.canvases) this.observer.observe(canvas);
    this.scheme = matchMedia("(prefers-color-scheme: dark)");
    this.recolour = () => this.touch();
    this.scheme.addEventListener("change", this.recolour);
    this.say();
  }

  /** Whether there is anything to show, and what is said where there is not. */
  some(stored, otherwise) {
    this.stored = stored;
    const none = !stored && !this.ring.count;
    if (none !== this.field.hidden) {
      this.field.hidden = this.tools.hidden = this.hint.hidden = none;
      fill(this.note, none ? otherwise : "");
    }
  }

  close() {
    this.observer.disconnect();
    this.scheme.removeEventListener("change", this.recolour);
    clearTimeout(this.asking);
    clearTimeout(this.joining);
  }

  /** Show another stream: its times are its own, and nothing of the one before is drawn beside it. */
  turn(stream) {
    if (stream === this.stream) return;
    const other = this.stream !== null;
    this.stream = stream;
    if (!other) return;
    this.ring.clear();
    this.past = this.window = this.end = null;
    if (this.whole) this.span = LIVE_SPAN_S;
    this.whole = false;
    this.moved();
  }

  /** Draw all anew with the next frame. */
  touch() {
    this.stale = true;
    this.changed();
  }

  tare(mean) {
    this.hasTare = Boolean(mean);
    for (let i = 0; i < AXES; i++) this.offset[i] = mean ? mean[i] : 0;
    this.tareLabel.hidden = !mean;
    this.touch();
  }

  get shown() {
    const last = this.ring.lastS;
    const end = this.end ?? (Number.isNaN(last) ? this.past?.to ?? this.span : last);
    return [end - this.span, end];
  }

  follow() {
    this.end = null;
    if (this.whole && this.ring.count) this.span = LIVE_SPAN_S;
    this.whole = false;
    this.moved();
  }

  /** Look at a time; what the page no longer holds is asked of the service. */
  look(end) {
    this.whole = false;
    const last = this.ring.lastS;
    const most = Number.isNaN(last) ? this.past?.whole?.[1] ?? end : last;
    this.end = end >= most - 1e-3 && !Number.isNaN(last) ? null : Math.min(end, most);
    if (this.end !== null) this.end = Math.max(this.end, Math.min(this.span, most));
    this.moved();
  }

  zoom(by, about = null) {
    const k = SPANS_S.findIndex((s) => s >= this.span - 1e-9);
    const span = SPANS_S[Math.min(Math.max((k < 0 ? SPANS_S.length - 1 : k) + by, 0), SPANS_S.length - 1)];
    this.zoomTo(span, about);
  }

  zoomTo(span, about = null) {
    const [a, b] = this.shown;
    const wanted = Math.min(Math.max(span, SPANS_S[0]), SPANS_S.at(-1));
    if (about !== null && this.end !== null) this.end = about + ((b - about) * wanted) / (b - a);
    this.span = wanted;
    this.whole = false;
    this.moved();
  }

  taller(by) {
    this.tall = by ? Math.min(Math.max(this.tall * by, 0.05), 50) : 1;
    this.touch();
  }

  moved() {
    this.say();
    this.fetchPast();
    this.touch();
  }

  say() {
    const span = this.span < 90 ? `${Number(this.span.toPrecision(2))} s` : `${Number((this.span / 60).toPrecision(2))} min`;
    const text = this.end === null ? `the last ${span}` : `${span} until ${number(this.end, 1)} s`;
    if (this.spanText.textContent !== text) this.spanText.textContent = text;
    this.liveButton.setAttribute("aria-pressed", String(this.end === null));
  }

  /** The first reading has come: what lies between it and those that were stored is asked for in a moment. */
  join(tries = 8) {
    clearTimeout(this.joining);
    this.joining = setTimeout(() => {
      if (this.signal.aborted || !tries || this.past?.to >= this.ring.firstS - 0.3) return;
      this.fetchPast();
      this.join(tries - 1);
    }, 1500);
  }

  /** Ask for stored readings where the page's own do not reach back far enough. */
  fetchPast() {
    clearTimeout(this.asking);
    if (!this.stored) return;
    const [a, b] = this.shown;
    const first = this.ring.firstS;
    if (first <= a + 0.2 || (Number.isNaN(first) && this.past && !this.end)) return;
    if (this.past && this.past.from <= a && this.past.to >= Math.min(b, Number.isNaN(first) ? b : first) - 0.3 && this.past.span <= 2.5 * this.span) return;
    this.asking = setTimeout(() => this.ask(a, b), 200);
  }

  async ask(a, b) {
    const room = this.span;
    const { stream } = this;
    try {
      const query = Number.isNaN(this.ring.firstS) && this.end === null ? { points: POINTS } : { from_s: Math.max(a - room / 2, 0), to_s: b + room / 2, points: POINTS };
      const found = await get(`${at("sessions", this.session)}/readings`, stream ? { ...query, stream } : query, this.signal);
      if (stream === this.stream) this.keepPast(found);
    } catch (error) {
      if (error.name === "AbortError") return;
      // Of a stream that begins nothing is stored yet.
      fill(this.note, error.status === 409 || error.status === 404 ? "" : `Earlier readings cannot be shown: ${error.detail || error.message}`);
    }
    this.touch();
  }

  keepPast(found) {
    const raw = found.kind === "raw";
    const t = (raw ? found.t_s : found.to_s) || [];
    fill(this.note, "");
    if (!t.length) return;
    const lows = raw ? found.values : found.least;
    const highs = raw ? found.values : found.most;
    const column = (from) => COLUMNS.map((name) => Float32Array.from(from[name], (v) => v ?? NaN));
    this.past = { t: Float64Array.from(t), low: column(lows), high: raw ? column(lows) : column(highs), from: found.window_s[0], to: t.at(-1),
      span: found.window_s[1] - found.window_s[0], whole: found.stream_s };
    // A session without a bench is shown whole.
    if (!this.ring.count && this.end === null) {
      this.span = Math.max(this.past.span, 2);
      this.whole = true;
      this.end = this.past.to;
      this.say();
    }
  }

  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey || event.target !== this.field) return;
    const [, b] = this.shown;
    const acts = { ArrowLeft: () => this.look(b - this.span / 4), ArrowRight: () => this.look(b + this.span / 4), End: () => this.follow(),
      "+": () => this.zoom(-1), "=": () => this.zoom(-1), "-": () => this.zoom(1), PageUp: () => this.taller(1.5), PageDown: () => this.taller(1 / 1.5) };
    if (!acts[event.key]) return;
    event.preventDefault();
    acts[event.key]();
  }

  /** Time under a pointer; null beside the canvases. */
  timeAt(event) {
    const canvas = event.target.closest?.("canvas");
    if (!canvas) return null;
    const box = canvas.getBoundingClientRect();
    const [a, b] = this.shown;
    return a + ((event.clientX - box.left - LEFT) / Math.max(box.width - LEFT - 4, 1)) * (b - a);
  }

  wheel(event) {
    const about = this.timeAt(event);
    if (about === null || !(event.ctrlKey || event.shiftKey)) return;
    event.preventDefault();
    const by = Math.sign(event.deltaY || event.deltaX);
    if (event.shiftKey && !event.ctrlKey) this.taller(by > 0 ? 1 / 1.25 : 1.25);
    else if (by) this.zoomTo(this.span * (by > 0 ? 1.25 : 0.8), about);
  }

  down(event) {
    if (this.timeAt(event) === null || (event.pointerType === "mouse" && event.button !== 0)) return;
    this.fingers.set(event.pointerId, event.clientX);
    this.begun = { end: this.shown[1], span: this.span, width: Math.max(event.target.clientWidth - LEFT, 50), apart: this.apart(), x: event.clientX };
    this.field.setPointerCapture(event.pointerId);
  }

  apart() {
    const places = [...this.fingers.values()];
    return places.length === 2 ? Math.max(Math.abs(places[0] - places[1]), 20) : null;
  }

  move(event) {
    if (!this.fingers.has(event.pointerId)) return;
    this.fingers.set(event.pointerId, event.clientX);
    const apart = this.apart();
    if (apart !== null && this.begun.apart !== null) this.zoomTo((this.begun.span * this.begun.apart) / apart);
    else if (this.fingers.size === 1 && Math.abs(event.clientX - this.begun.x) > 4) this.look(this.begun.end - ((event.clientX - this.begun.x) / this.begun.width) * this.span);
  }

  up(event) {
    this.fingers.delete(event.pointerId);
    for (const x of this.fingers.values()) this.begun = { ...this.begun, end: this.shown[1], span: this.span, apart: null, x };
  }

  /** Draw if anything has moved by a pixel; returns whether it did. */
  draw(now) {
    const [a, b] = this.shown;
    const width = this.sizes[0][0] || 300;
    const step = Math.min(this.span / width, 0.25);
    if (!this.stale && (Math.abs(b - this.drawnEnd) < step || b === this.drawnEnd)) return false;
    const { stale } = this;
    this.stale = false;
    this.drawnEnd = b;
    const off = this.hasTare && this.tareBox.checked;
    for (let i = 0; i < AXES; i++) drawTrace(this.canvases[i], this.sizes[i], this, i, CHANNELS[i][2], a, b, off ? this.offset[i] : 0);
    if (stale || now - this.drawnAt > 190) {
      this.drawnAt = now;
      this.numbers(off);
    }
    return true;
  }

  numbers(off) {
    for (let i = 0; i < AXES; i++) {
      const raw = this.ring.latest[i];
      const text = number(raw - (off ? this.offset[i] : 0), i < 3 ? 3 : 1);
      if (this.values[i].textContent !== text) this.values[i].textContent = text;
      const full = this.range?.[i];
      const share = full && Number.isFinite(raw) ? Math.abs(raw) / full : null;
      const said = share === null ? (full ? "" : "range not known") : `${percent(share)} of ${Number(full.toPrecision(3))} ${CHANNELS[i][1]}`;
      if (this.shares[i].textContent !== said) {
        this.shares[i].textContent = said;
        this.tracks[i].hidden = share === null;
        this.bars[i].style.width = `${Math.min(100 * (share ?? 0), 100)}%`;
        this.bars[i].classList.toggle("near", share !== null && share >= 0.8);
      }
    }
  }
}
