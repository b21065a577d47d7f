// The windows of a load case in their readings; each is moved by dragging it or its edges, or by typing.
import { at, get } from "../api.js";
import { el, fill, problem, quiet } from "../dom.js";
import { compact, number, within } from "../format.js";
import { LEFT, RIGHT, paint } from "./plateau.js";

const CHANNELS = [["Fx_N", "Fx", "N"], ["Fy_N", "Fy", "N"], ["Fz_N", "Fz", "N"], ["Tx_Nmm", "Tx", "N mm"], ["Ty_Nmm", "Ty", "N mm"], ["Tz_Nmm", "Tz", "N mm"]];
const TITLES = { unloaded_s: "Unloaded", loaded_s: "Loaded", unloaded_after_s: "Unloaded after" };
const EDGE_PX = 14;

export async function windows(place, session, id, move, signal) {
  if (!place.firstChild) fill(place, quiet("Reading …"));
  let found;
  try {
    found = await get(`${at("sessions", session, "cases", id)}/readings`, { points: 400, margin_s: 2 }, signal);
  } catch (error) {
    if (error.name !== "AbortError") fill(place, problem(error), el("button", { onclick: () => windows(place, session, id, move, signal) }, "Try again"));
    return;
  }
  fill(place, found.windows.map((w) => one(w, move)));
}

function one(w, move) {
  const title = TITLES[w.name] || w.name;
  const shown = w.window_s.map((s) => Number(s.toFixed(3)));
  const from = el("input", { type: "number", step: "any", value: shown[0], id: `from-${w.name}`, required: true });
  const to = el("input", { type: "number", step: "any", value: shown[1], id: `to-${w.name}`, required: true });
  const canvas = el("canvas", { class: "plateau", role: "img", "aria-label": `${title}: readings from ${number(w.window_s[0], 1)} to ${number(w.window_s[1], 1)} s; the window can also be moved by typing` });
  const channel = el("select", { "aria-label": `Channel of ${title}` }, CHANNELS.map(([k, t, u]) => el("option", { value: k, selected: k === "Fy_N" }, `${t} [${u}]`)));
  const span = () => [Number(from.value), Number(to.value)];
  const draw = () => canvas.isConnected && paint(canvas, w.readings, channel.value, span(), bounds(w));
  const set = (a, b) => {
    from.value = a.toFixed(2);
    to.value = b.toFixed(2);
    from.dispatchEvent(new Event("input", { bubbles: true }));
  };
  channel.onchange = draw;
  // Any time can be typed or dragged to; the arrow keys go by tenths of a second.
  for (const input of [from, to]) {
    input.addEventListener("keydown", (e) => {
      const by = { ArrowUp: 0.1, ArrowDown: -0.1 }[e.key];
      if (!by) return;
      e.preventDefault();
      input.value = (Number(input.value) + by).toFixed(2);
      input.dispatchEvent(new Event("input", { bubbles: true }));
    });
  }
  from.oninput = to.oninput = () => {
    to.setCustomValidity(span()[1] > span()[0] ? "" : "The end must come after the start.");
    draw();
  };
  drag(canvas, w, span, set);
  new ResizeObserver(draw).observe(canvas);
  return el("section", {}, el("h3", {}, `${title} window`, " ", channel), canvas,
    el("form", { class: "row no-print", onsubmit: (e) => { e.preventDefault(); move(w.name, span()); } },
      el("div", {}, el("label", { htmlFor: from.id }, "from [s]"), from), el("div", {}, el("label", { htmlFor: to.id }, "to [s]"), to),
      el("button", {}, "Move the window")),
    w.plateau ? el("p", { class: "quiet" }, CHANNELS.map(([k, t, u]) => `${t} ${within(w.plateau.mean[k], w.plateau.sd_of_mean[k])} ${u}`).join("; "),
      `; worth ${compact(w.plateau.effective.Fy_N ?? w.plateau.effective.Fy)} independent readings of ${w.plateau.readings}; `,
      w.plateau.steady === false ? el("strong", { class: "warn" }, "not steady") : w.plateau.steady ? "steady" : "steadiness is open") : el("p", { class: "warn" }, w.why));
}

function bounds(w) {
  const r = w.readings;
  const start = r.kind === "raw" ? r.t_s : r.from_s;
  const end = r.kind === "raw" ? r.t_s : r.to_s;
  return start?.length ? [start[0], end.at(-1)] : w.window_s;
}

/** An edge is drawn along, the middle takes the whole window with it, and elsewhere a new one is drawn. */
function drag(canvas, w, span, set) {
  let held = null;
  const scale = () => {
    const box = canvas.getBoundingClientRect();
    const [a, b] = bounds(w);
    const wide = box.width - LEFT - RIGHT;
    return { time: (x) => a + (Math.min(Math.max(x - box.left - LEFT, 0), wide) / wide) * (b - a), near: (EDGE_PX / wide) * (b - a), a, b };
  };
  const what = (t, near) => {
    const [from, to] = span();
    if (Math.abs(t - from) < near) return "from";
    if (Math.abs(t - to) < near) return "to";
    return t > from && t < to ? "all" : "new";
  };
  canvas.addEventListener("pointerdown", (e) => {
    const { time, near } = scale();
    const t = time(e.clientX);
    held = { what: what(t, near), t, span: span() };
    canvas.setPointerCapture(e.pointerId);
  });
  canvas.addEventListener("pointermove", (e) => {
    const { time, near, a, b } = scale();
    const t = time(e.clientX);
    if (!held) {
      canvas.style.cursor = { from: "ew-resize", to: "ew-resize", all: "grab", new: "crosshair" }[what(t, near)];
      return;
    }
    const [from, to] = held.span;
    if (held.what === "from" && t < to - 0.05) set(t, to);
    else if (held.what === "to" && t > from + 0.05) set(from, t);
    else if (held.what === "all") {
      const by = Math.min(Math.max(t - held.t, a - from), b - to);
      set(from + by, to + by);
    } else if (held.what === "new" && Math.abs(t - held.t) > 0.05) set(Math.min(t, held.t), Math.max(t, held.t));
  });
  for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, () => { held = null; });
}
