// The readings of a case's windows, drawn on a canvas; a window is moved by typing or by dragging.
import { at, get } from "../api.js";
import { el, fill, problem, quiet } from "../dom.js";
import { compact, number, within } from "../format.js";
import { css, envelope } from "./canvas.js";

const CHANNELS = [["Fx_N", "Fx", "N"], ["Fy_N", "Fy", "N"], ["Fz_N", "Fz", "N"], ["Tx_Nmm", "Tx", "N mm"], ["Ty_Nmm", "Ty", "N mm"], ["Tz_Nmm", "Tz", "N mm"]];
const TITLES = { unloaded_s: "Unloaded", loaded_s: "Loaded", unloaded_after_s: "Unloaded after" };

export async function windows(place, session, id, move, signal) {
  fill(place, quiet("Reading …"));
  let found;
  try {
    found = await get(`${at("sessions", session, "cases", id)}/readings`, { points: 400, margin_s: 2 }, signal);
  } catch (error) {
    if (error.name !== "AbortError") fill(place, problem(error));
    return;
  }
  fill(place, found.windows.map((w) => {
    const from = el("input", { type: "number", step: "0.1", value: w.window_s[0], id: `from-${w.name}` });
    const to = el("input", { type: "number", step: "0.1", value: w.window_s[1], id: `to-${w.name}` });
    const canvas = el("canvas", { height: 96, role: "img", "aria-label": `${TITLES[w.name]}: Fy from ${number(w.window_s[0], 1)} to ${number(w.window_s[1], 1)} s` });
    const channel = el("select", { "aria-label": `Channel of ${TITLES[w.name]}`, onchange: () => draw() }, CHANNELS.map(([k, t, u]) => el("option", { value: k, selected: k === "Fy_N" }, `${t} [${u}]`)));
    const draw = () => paint(canvas, w, channel.value, [Number(from.value), Number(to.value)]);
    from.oninput = to.oninput = draw;
    drag(canvas, w, from, to, draw);
    const node = el("section", {}, el("h3", {}, `${TITLES[w.name]} window`, " ", channel), canvas,
      el("div", { class: "row" }, el("div", {}, el("label", { htmlFor: from.id }, "from [s]"), from), el("div", {}, el("label", { htmlFor: to.id }, "to [s]"), to),
        el("button", { onclick: () => move(w.name, [Number(from.value), Number(to.value)]) }, "Move the window")),
      w.plateau ? el("p", { class: "quiet" }, CHANNELS.map(([k, t, u]) => `${t} ${within(w.plateau.mean[k], w.plateau.sd_of_mean[k])} ${u}`).join("; "),
        `; worth ${compact(w.plateau.effective.Fy_N)} independent readings of ${w.plateau.readings}; `,
        w.plateau.steady === false ? el("strong", { class: "warn" }, "not steady") : w.plateau.steady ? "steady" : "steadiness is open") : el("p", { class: "warn" }, w.why));
    requestAnimationFrame(draw);
    return node;
  }));
}

function bounds(w) {
  const r = w.readings;
  const t = r.kind === "raw" ? r.t_s : r.from_s;
  const end = r.kind === "raw" ? r.t_s : r.to_s;
  return t?.length ? [t[0], end.at(-1)] : w.window_s;
}

function paint(canvas, w, channel, span) {
  const r = w.readings;
  const raw = r.kind === "raw";
  const t = raw ? r.t_s : r.from_s.map((a, i) => (a + r.to_s[i]) / 2);
  const low = raw ? r.values?.[channel] : r.least?.[channel];
  const high = raw ? r.values?.[channel] : r.most?.[channel];
  envelope(canvas, t || [], low || [], high || [], { bounds: bounds(w), span, colour: css("--measured") });
}

function drag(canvas, w, from, to, draw) {
  let start = null;
  const time = (event) => {
    const box = canvas.getBoundingClientRect();
    const [a, b] = bounds(w);
    return a + ((event.clientX - box.left) / box.width) * (b - a);
  };
  canvas.style.touchAction = "pan-y";
  canvas.addEventListener("pointerdown", (e) => { start = time(e); canvas.setPointerCapture(e.pointerId); });
  canvas.addEventListener("pointermove", (e) => {
    if (start === null) return;
    const now = time(e);
    if (Math.abs(now - start) < 0.05) return;
    from.value = Math.min(start, now).toFixed(2);
    to.value = Math.max(start, now).toFixed(2);
    draw();
  });
  canvas.addEventListener("pointerup", () => { start = null; });
}
