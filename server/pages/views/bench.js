// The bench: six live traces, the protocol as a checklist, the force of what hangs now, warnings while it still hangs.
import { at, get } from "../api.js";
import { el, empty, fill, panel, problem, quiet } from "../dom.js";
import { masses, norm, number, seconds, vector, words } from "../format.js";
import { css, envelope } from "./canvas.js";
import { figure } from "../plot.js";

const CHANNELS = [["Fx", "N", 0.05], ["Fy", "N", 0.05], ["Fz", "N", 0.05], ["Tx", "N mm", 0.5], ["Ty", "N mm", 0.5], ["Tz", "N mm", 0.5]];
const SPANS = [10, 30, 120];
const KEPT_S = 125;

export async function view(main, { session }) {
  const path = at("sessions", session);
  const away = new AbortController();
  const traces = { t: [], low: CHANNELS.map(() => []), high: CHANNELS.map(() => []), last: null, over: false, at: 0 };
  let stream = null;
  let span = 30;
  let cases = [];
  let planned = [];
  let events = [];
  let cell = null;
  let frame = 0;
  let heard = 0;
  let rate = [];

  const status = el("p", { class: "row", role: "status" });
  const values = CHANNELS.map(() => el("span", {}, "–"));
  const canvases = CHANNELS.map(([name, unit]) => el("canvas", { height: 92, role: "img", "aria-label": `${name} in ${unit}, the last seconds` }));
  const now = el("div", { "aria-live": "polite" });
  const warned = el("div", { role: "alert" });
  const steps = el("div", { class: "steps" });
  const finger = el("div");
  const spans = el("select", { id: "span", onchange: (e) => { span = Number(e.target.value); } }, SPANS.map((s) => el("option", { value: s, selected: s === span }, seconds(s))));
  fill(main, el("h1", {}, `${session}: the bench`), status, warned,
    el("div", { class: "columns" }, panel("Now", now), panel("Checklist", steps)),
    panel(null, el("div", { class: "row" }, el("div", {}, el("label", { htmlFor: "span" }, "Shown"), spans), quiet("The cell's own axes, tare not taken off; no peak is left out.")),
      el("div", { class: "traces" }, CHANNELS.map(([name, unit], i) => el("div", { class: "trace" }, el("h3", {}, el("span", {}, `${name} [${unit}]`), values[i]), canvases[i])))),
    panel("The finger", finger));

  async function load() {
    try {
      const [info, found, told, list] = await Promise.all([get(path, {}, away.signal), get(`${path}/cases`, {}, away.signal),
        get(`${path}/events`, { limit: 1000 }, away.signal), get(`${path}/checklist`, {}, away.signal)]);
      cases = found.cases;
      planned = list.steps;
      events = told.events;
      stream = info.stream;
      cell = info;
      draw();
      if (!traces.t.length && stream) recent();
    } catch (error) {
      if (error.name !== "AbortError") fill(now, problem(error), el("button", { onclick: load }, "Try again"));
    }
  }

  async function recent() {
    const found = await get(`${path}/readings`, { points: 1500 }, away.signal).catch(() => null);
    if (!found || traces.t.length) return;
    const raw = found.kind === "raw";
    const names = ["Fx_N", "Fy_N", "Fz_N", "Tx_Nmm", "Ty_Nmm", "Tz_Nmm"];
    const t = (raw ? found.t_s : found.to_s) || [];
    traces.t = t.slice();
    names.forEach((n, i) => { traces.low[i] = (raw ? found.values[n] : found.least[n]).slice(); traces.high[i] = (raw ? found.values[n] : found.most[n]).slice(); });
    traces.whole = true;
  }

  const last = (...kinds) => events.findLast((e) => kinds.includes(e.kind));
  const value = (e) => e?.value || {};

  function draw() {
    const done = new Map(cases.map((c) => [c.id, c]));
    const skipped = new Set(events.filter((e) => ["case_skipped", "known_weight_skipped"].includes(e.kind)).map((e) => value(e).id ?? `weight_${value(e).when}`));
    const present = value(last("step")).id;
    const listed = [...planned];
    for (const c of JSON.parse(localStorage.getItem(`next ${session}`) || "[]")) listed.push({ id: "next:", state: "open", text: `${masses(c.masses_g)}, ${words(c.posture)}, ${c.location}` });
    fill(steps, listed.length ? listed.map((p) => {
      const c = done.get(p.id);
      const state = c ? c.state : p.state === "done" ? "done" : skipped.has(p.id) ? "skipped" : p.id === present ? "now" : p.state;
      const mark = { measured: "✓", done: "✓", waiting: "…", failed: "✗", excluded: "–", skipped: "–", now: "▶", open: "○" }[state];
      return el("div", { class: `step${state === "now" ? " now" : ""}` }, el("span", { "aria-hidden": "true" }, mark), el("span", {}, `${p.id} ${p.text}`),
        el("span", { class: "quiet" }, c?.state === "measured" ? `${number(norm(c.measured_N), 2)} N` : words(state)));
    }) : empty("No protocol yet: the bench sends it when it begins (fingertwin log --protocol … --to)."));
    const shown = cases.findLast((c) => c.state === "measured");
    if (shown) {
      const outside = shown.z !== null && norm(shown.residual_N) > 0.4 * norm(shown.predicted_N) + 0.3;
      result({ title: `Last: ${shown.id}, ${masses(shown.masses_g)}, ${words(shown.posture)}, ${shown.location}`, force: shown.measured_N, sd: shown.measured_sd_N, predicted: shown.predicted_N, blinded: shown.blinded, outside });
      figure(finger, "finger", { session, case: shown.id }, { signal: away.signal });
    } else {
      fill(now, empty(cell?.source === "none" ? "The bench has not begun." : "No load case is measured yet."));
      fill(finger, quiet("It is drawn with the first measured case."));
    }
    const w = last("warning");
    const after = last("step", "case_taken", "tare");
    if (w && (!after || w.arrival > after.arrival)) warn(value(w).text); else fill(warned);
    tell();
  }

  function result({ title, force, sd, predicted, blinded, outside, steady, why }) {
    fill(now, el("p", {}, title), el("p", { class: `big ${outside ? "bad" : ""}` }, `${number(norm(force), 2)} N`),
      el("p", {}, `measured ${vector(force)} N`, sd ? ` (± ${vector(sd)})` : ""),
      blinded ? quiet("A validation case: its prediction is hidden until the bench closes the session.") : predicted ? el("p", {}, `predicted ${vector(predicted)} N`) : null,
      outside ? el("p", { class: "bad" }, "Far from the prediction: wrong tendon, wrong weight, forgotten tare, or drift? Look before the weight comes off.") : null,
      steady === false ? el("p", { class: "warn" }, why || "not steady yet") : null);
  }

  const warn = (text) => text && fill(warned, el("p", { class: "problem" }, text));

  function tell() {
    const tare = last("tare");
    const age = tare && traces.t.length ? traces.t.at(-1) - tare.at_s : null;
    const gaps = events.filter((e) => e.kind === "gap" || e.kind === "lost").length;
    fill(status,
      el("span", { class: "chip" }, rate.length > 1 ? `${Math.round(rateHz())} readings/s` : "no readings now"),
      el("span", { class: "chip" }, age === null ? "no tare yet" : `tare ${seconds(age)} ago`),
      el("span", { class: "chip" }, `${gaps} gaps`),
      traces.over ? el("span", { class: "chip bad" }, "OVERLOAD") : null,
      el("span", { class: "chip" }, cell?.closed ? "closed: predictions are shown" : "running: validation cases are blind"));
  }

  const rateHz = () => rate.reduce((a, [, n]) => a + n, 0) / Math.max((performance.now() - rate[0][0]) / 1000, 0.2);

  function trace(body) {
    if (stream && body.stream !== stream) return;
    stream = body.stream;
    if (traces.whole && body.from_s[0] < (traces.t.at(-1) ?? 0) - 1) { traces.t = []; traces.low = CHANNELS.map(() => []); traces.high = CHANNELS.map(() => []); }
    traces.whole = false;
    for (let k = 0; k < body.to_s.length; k++) {
      if (traces.t.length && body.to_s[k] <= traces.t.at(-1)) continue;
      traces.t.push(body.to_s[k]);
      for (let i = 0; i < 6; i++) { traces.low[i].push(body.least[k][i]); traces.high[i].push(body.most[k][i]); }
      traces.last = body.latest[k];
      traces.over = Boolean(body.overload[k]);
    }
    const end = traces.t.at(-1);
    const cut = traces.t.findIndex((t) => t > end - KEPT_S);
    if (cut > 500) { traces.t.splice(0, cut); for (let i = 0; i < 6; i++) { traces.low[i].splice(0, cut); traces.high[i].splice(0, cut); } }
    if (!body.recent) { rate.push([performance.now(), body.count.reduce((a, b) => a + b, 0)]); rate = rate.filter(([at_]) => at_ > performance.now() - 2000); }
    heard = performance.now();
  }

  function paint() {
    frame = requestAnimationFrame(paint);
    if (document.hidden) return;
    const t = traces.t;
    const end = t.length ? t.at(-1) : 0;
    const begin = traces.whole ? t[0] : end - span;
    let from = 0;
    while (from < t.length && t[from] < begin) from++;
    CHANNELS.forEach(([, , least], i) => {
      envelope(canvases[i], t.slice(from), traces.low[i].slice(from), traces.high[i].slice(from), { bounds: [begin, Math.max(end, begin + 0.1)], colour: css("--measured"), least });
      const text = traces.last ? number(traces.last[i], i < 3 ? 3 : 1) : "–";
      if (values[i].textContent !== text) values[i].textContent = text;
    });
  }

  const clock = setInterval(() => {
    rate = rate.filter(([at_]) => at_ > performance.now() - 2000);
    tell();
    if (heard && performance.now() - heard > 3000) warn("The load cell is silent: look at its cable; what was read is kept.");
  }, 1000);
  await load();
  paint();
  return {
    leave: () => { away.abort(); cancelAnimationFrame(frame); clearInterval(clock); },
    link: (state) => { if (state === "live" && heard) load(); },
    hear: (m) => {
      if (m.session !== session) return;
      if (m.kind === "trace") trace({ recent: m.recent, ...m.body });
      else if (m.kind === "estimate") {
        const b = m.body;
        result({ title: `Hanging now: ${b.case ?? ""}`, force: b.force_N, sd: b.sd_N, predicted: b.predicted_N, blinded: b.blinded, outside: b.outside, steady: b.steady, why: b.reason || b.why });
      } else if (["event", "case", "session"].includes(m.kind)) load();
    },
  };
}
