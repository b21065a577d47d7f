// The bench: the force of this moment, what to do now, the protocol, the finger as it is held, six traces, warnings.
import { Away, at, get, turns } from "../api.js";
import { el, fill, problem, quiet } from "../dom.js";
import { number, seconds } from "../format.js";
import { FingerView } from "./bench_finger.js";
import { Keys } from "./bench_keys.js";
import { Now, nowOf } from "./bench_now.js";
import { ProtocolGrid } from "./bench_protocol.js";
import { Rate, Ring } from "./bench_ring.js";
import { Traces } from "./bench_traces.js";
import { Warnings, warningsOf } from "./bench_warnings.js";

const FRAME_MS = 1000 / 30 - 4;
const LOAD_MS = 150;
const TRY_AGAIN_MS = 3000;
// An estimate that is older says nothing of now.
const FRESH_MS = 1500;
// So long nothing is said of a session that no bench has begun: it may be replayed.
const LISTEN_MS = 2000;
const SIZE = "bench size";

export async function view(main, { session }) {
  const bench = new BenchPage(main, session);
  await bench.load();
  return bench;
}

class BenchPage {
  constructor(main, session) {
    this.session = session;
    this.path = at("sessions", session);
    this.gone = new AbortController();
    const { signal } = this.gone;
    this.ring = new Ring();
    this.rate = new Rate();
    this.state = null;
    // Ids of the session's streams, the newest last; and whether a log without a protocol runs or has ended.
    this.streams = [];
    this.log = null;
    this.controlAt = -1e9;
    this.turn = turns();
    this.cases = [];
    this.steps = [];
    this.estimate = null;
    this.estimateAt = -1e9;
    this.heardAt = null;
    this.shownAt = null;
    this.away = false;
    this.picked = null;
    this.prompt = null;
    this.frame = 0;
    this.drawnAt = 0;
    this.frames = 0;
    const changed = () => this.schedule();
    this.warnings = new Warnings();
    this.now = new Now(this.warnings.grave);
    this.keys = new Keys(session, signal);
    this.grid = new ProtocolGrid((row) => this.pick(row));
    this.finger = new FingerView(session, changed, signal);
    this.traces = new Traces(this.ring, session, changed, signal);
    this.chips = el("div", { class: "row chips" });
    this.texts = new Map();
    this.size = el("button", { class: "toggle no-print", onclick: () => this.resize(!this.large, true) }, "Large");
    this.trouble = el("div", {}, quiet("Loading …"));
    // Nothing is shown of a bench before it is known how it stands, but for what is wrong with the service.
    this.middle = el("div", { class: "bench-middle", hidden: true }, this.finger.node, this.grid.node);
    this.keys.node.hidden = this.traces.node.hidden = this.now.node.hidden = this.size.hidden = true;
    this.body = el("div", {}, this.now.node, this.warnings.node, this.keys.node, this.middle, this.traces.node);
    this.node = el("div", { class: "bench" }, el("div", { class: "row bench-head" }, el("h1", {}, `${session}: the bench`), this.chips, this.size),
      this.trouble, this.body);
    fill(main, this.node);
    document.addEventListener("visibilitychange", () => { if (!document.hidden) this.traces.touch(); }, { signal });
    this.clock = setInterval(() => this.tick(), 500);
    this.resize(localStorage.getItem(SIZE) !== "small", false);
  }

  leave() {
    this.gone.abort();
    cancelAnimationFrame(this.frame);
    clearInterval(this.clock);
    clearTimeout(this.loading);
    this.traces.close();
    this.finger.close();
    this.keys.close();
  }

  link(state) {
    this.away = state === "away";
    if (state === "live" && this.state) this.soon();
    this.tick();
  }

  hear(message) {
    if (message.session !== this.session) return;
    const { kind, body } = message;
    if (kind === "trace") this.trace(body);
    else if (kind === "estimate") this.take(body);
    else if (kind === "bench") {
      this.controlAt = performance.now();
      this.control(body);
      this.show();
    } else if (["event", "case", "session"].includes(kind)) this.soon();
  }

  control(body) {
    this.keys.take(body);
    this.prompt = body && body.connected !== false ? body : null;
  }

  /** Ask how the bench stands, some moments later: what happens at a bench comes in several events. */
  soon(after = LOAD_MS) {
    this.loading ??= setTimeout(() => { this.loading = null; this.load(); }, after);
  }

  async load() {
    const { signal } = this.gone;
    const [asked, newest] = [performance.now(), this.turn()];
    try {
      const [state, found, list, session] = await Promise.all([get(`${this.path}/bench/state`, {}, signal), get(`${this.path}/cases`, {}, signal),
        get(`${this.path}/checklist`, {}, signal), get(this.path, {}, signal)]);
      if (!newest()) return;
      const known = session.streams.map((s) => s.id);
      this.log = session.source === "none" && known.length ? await this.logOf(known.at(-1)) : null;
      const first = this.state === null;
      const runs = (s) => Boolean(s?.begun && !s.closed);
      // Where a bench runs, it is read from afar, unless somebody has said otherwise.
      if ((first || runs(state) > runs(this.state)) && localStorage.getItem(SIZE) === null) this.resize(runs(state), false);
      this.state = state;
      this.streams = [...known, ...this.streams.filter((id) => !known.includes(id))];
      if (state.stream?.id || this.streams.length) this.traces.turn(state.stream?.id ?? this.streams.at(-1));
      // What the live stream has told meanwhile is newer.
      if (this.controlAt < asked) this.control(state.control);
      this.cases = found.cases;
      this.steps = [...state.steps, ...list.steps.filter((s) => s.state === "proposed")];
      fill(this.trouble, state.problem ? problem(new Error(state.problem)) : null);
      this.traces.range = state.cell.range;
      this.traces.tare(state.tare?.mean);
      if (first) {
        for (const node of [this.now.node, this.keys.node, this.middle, this.traces.node, this.size]) node.hidden = false;
        // From now on it is noticed where nothing comes.
        this.shownAt = performance.now();
        this.heardAt ??= this.shownAt;
        if (!this.ring.count && state.has_readings) this.traces.ask(0, this.traces.span);
      }
      this.show();
      // The readings of a tare come a moment after its event.
      if (state.tare && !state.tare.mean) this.soon(1000);
    } catch (error) {
      if (error.name === "AbortError") return;
      if (error instanceof Away) this.away = true;
      if (this.state === null) fill(this.trouble, problem(error), el("button", { onclick: () => this.load() }, "Try again"));
      if (error instanceof Away) this.soon(TRY_AGAIN_MS);
      this.tick();
    }
  }

  /** A log without a protocol: whether it has ended. */
  async logOf(stream) {
    const { events } = await get(`${this.path}/events`, { kind: "ended", limit: 1000 }, this.gone.signal);
    return { ended: events.some((e) => e.stream === stream) };
  }

  trace(body) {
    const { state } = this;
    if (!this.follows(body.stream)) return;
    const none = !this.ring.count;
    const readings = this.ring.take(body);
    if (!readings) return;
    if (none) {
      this.traces.some(this.traces.stored);
      this.traces.join();
    }
    // What was stored was shown only because nothing came.
    if (!body.recent && this.traces.whole) this.traces.follow();
    this.heardAt = performance.now();
    if (!body.recent) this.rate.add(readings, this.heardAt);
    if (!this.hangs()) this.finger.live(this.raw(true), true, state?.place?.location);
    this.schedule();
  }

  /** Whether a stream is the one to show: the bench's, else the newest. */
  follows(stream) {
    if (!this.streams.includes(stream)) {
      this.streams.push(stream);
      this.soon();
    }
    if (stream !== (this.state?.stream?.id ?? this.streams.at(-1))) return false;
    this.traces.turn(stream);
    return true;
  }

  take(body) {
    this.estimate = body;
    this.estimateAt = performance.now();
    this.traces.window = body.steady ? body.window_s : null;
    if (!this.picked || this.picked === body.case) {
      this.finger.live(body.force_N, false);
      this.finger.predicted(body.predicted_N);
    }
    this.warn();
    this.schedule();
  }

  /** What hangs now and is estimated; null where nothing is, or nothing was heard of it lately. */
  hangs() {
    return this.estimate && performance.now() - this.estimateAt < FRESH_MS && this.state?.phase === "loaded" ? this.estimate : null;
  }

  /** The force of this moment in the cell's own axes [N], with the tare taken off where there is one. */
  raw(needsTare) {
    const { mean } = this.ring;
    const tare = this.state?.tare?.mean;
    if (Number.isNaN(mean[0]) || (needsTare && !tare) || this.silentS() > 1.5) return null;
    return [0, 1, 2].map((i) => mean[i] - (tare ? tare[i] : 0));
  }

  /** Whether readings of a recording come in now, which no bench has begun; undefined until that has been listened for. */
  arriving() {
    if (this.state.begun) return false;
    if (this.silentS() < 3 && this.rate.hz(performance.now()) > 0) return true;
    return this.state.has_readings && performance.now() - this.shownAt < LISTEN_MS ? undefined : false;
  }

  /** How a log without a protocol stands: "runs", "silent" or "ended"; "" until it has been listened to, null without one. */
  logged() {
    if (!this.log || this.log.ended) return this.log && "ended";
    const arriving = this.arriving();
    return arriving ? "runs" : arriving === undefined ? "" : "silent";
  }

  silentS() {
    return this.heardAt === null ? 0 : (performance.now() - this.heardAt) / 1000;
  }

  pick(row) {
    this.picked = row?.id ?? null;
    this.show();
  }

  /** Show how the bench stands: steps, drawing, warnings, what to do. */
  show() {
    const { state } = this;
    if (!state) return;
    this.grid.show(this.steps, this.cases, state.now, this.picked, state.begun);
    this.finger.show(...this.posture());
    const aside = this.picked && this.picked !== state.now && state.begun && !state.closed;
    this.finger.heading.textContent = aside ? `The finger in ${this.picked}, which is picked and does not hang now` : "The finger";
    this.traces.some(state.has_readings, state.begun || !state.steps.length ? "No readings have come yet." : "This session has averaged forces and no readings.");
    this.keys.run(state.begun && !state.closed && state.stream?.state !== "ended");
    if (state.phase !== "loaded") this.traces.window = null;
    this.tick();
  }

  /** What the finger is drawn with: what was picked, else the present case, else the last one. */
  posture() {
    const { state, steps, cases } = this;
    const step = steps.find((s) => s.id === (this.picked ?? state.now)) ?? null;
    const version = (id) => JSON.stringify([cases.find((c) => c.id === id)?.measured_N, state.closed]);
    if (step?.state === "proposed") return [{ posture: step.posture }, "proposed"];
    if (step?.masses_g) return [{ case: step.id }, version(step.id)];
    const last = cases.findLast((c) => c.state === "measured");
    if (!state.now && last) return [{ case: last.id }, version(last.id)];
    return state.place ? [{ posture: state.place.posture }, ""] : [null, ""];
  }

  warn() {
    const { state } = this;
    const now = this.ring.lastS;
    const tareAgeS = state?.tare ? now - state.tare.window_s[1] : 0;
    const overloaded = this.silentS() < 1 && this.ring.overloadedSince(now - 1);
    this.warnings.show(warningsOf({ bench: state, estimate: this.hangs(), logging: this.log !== null && !this.log.ended, overloaded, silentS: this.silentS(), away: this.away, now, tareAgeS }));
  }

  /** What passes with time alone. */
  tick() {
    if (!this.state) {
      this.warnings.show(this.away ? warningsOf({ away: true }) : []);
      this.now.node.hidden = !this.away;
      return;
    }
    this.warn();
    this.tell();
    this.big(true);
    this.finger.say(performance.now());
  }

  big(always) {
    const bench = this.state;
    const given = nowOf({ bench, prompt: this.prompt?.todo, reason: this.prompt?.reason, cases: this.cases, picked: this.picked, arriving: this.arriving(), log: this.logged(), estimate: this.hangs(), raw: this.raw(false), hasTare: Boolean(bench.tare?.mean) });
    this.now.show(given, performance.now(), always);
  }

  chip(name, text, kind = "") {
    let node = this.texts.get(name);
    if (!node) {
      node = el("span", { class: "chip" });
      this.texts.set(name, node);
      this.chips.append(node);
    }
    node.hidden = !text;
    if (node.textContent !== text) node.textContent = text;
    const look = `chip ${kind}`.trim();
    if (node.className !== look) node.className = look;
  }

  tell() {
    const { state } = this;
    const hz = this.rate.hz(performance.now());
    const arriving = this.arriving();
    const stream = state.stream;
    const running = state.begun && !state.closed && stream?.state !== "ended";
    const log = this.logged();
    this.chip("mode", !state.begun && log !== null ? (log === "ended" ? "log ended" : log && "logging") : !state.begun ? (arriving ? "replaying" : arriving === undefined ? "" : state.steps.length ? "recorded" : "not begun") : state.closed ? "closed: predictions are shown" : "running: validation is blind");
    const told = running || log === "runs" || log === "silent";
    this.chip("rate", told ? (!hz ? "no readings now" : `${Math.round(hz)} readings/s`) : "", told && !hz ? "warn" : "");
    this.chip("gaps", stream ? `${stream.gaps} ${stream.gaps === 1 ? "gap" : "gaps"}${stream.lost_samples ? `, ${stream.lost_samples} lost` : ""}` : "", stream?.gaps ? "warn" : "");
    const age = state.tare && !Number.isNaN(this.ring.lastS) ? Math.max(this.ring.lastS - state.tare.window_s[1], 0) : null;
    this.chip("tare", !running ? "" : state.tare ? `tare${age === null ? "" : ` ${seconds(age)} ago`}` : "no tare", running && !state.tare ? "warn" : "");
    const drift = state.drift;
    this.chip("drift", drift ? `drift ${number(drift.force_N, 3)} N, ${number(drift.moment_Nmm, 2)} N mm in ${seconds(drift.over_s)}` : "");
    const range = state.cell.range;
    const share = range && !Number.isNaN(this.ring.latest[0]) ? Math.max(...range.map((r, i) => Math.abs(this.ring.latest[i]) / r)) : null;
    this.chip("range", running && share !== null ? `${Math.round(100 * share)} % of the cell's range` : "", share !== null && share >= 0.8 ? "bad" : "");
  }

  resize(large, kept) {
    this.large = large;
    this.node.classList.toggle("large", large);
    this.size.setAttribute("aria-pressed", String(large));
    if (kept) localStorage.setItem(SIZE, large ? "large" : "small");
    this.traces.touch();
  }

  /** Draw with the next frame, thirty times a second at most, and never where nobody looks. */
  schedule() {
    if (this.frame || document.hidden) return;
    this.frame = requestAnimationFrame((now) => this.paint(now));
  }

  paint(now) {
    this.frame = 0;
    if (now - this.drawnAt < FRAME_MS) {
      this.schedule();
      return;
    }
    this.drawnAt = now;
    if (this.state) this.big(false);
    const drawn = [this.traces.draw(now), this.finger.draw(now)];
    if (drawn.some(Boolean)) this.frames++;
    this.node.dataset.frames = String(this.frames);
  }
}
