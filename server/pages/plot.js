// Figures that the service draws, shown by Plotly as wide as their place, with the same in words for who cannot see them.
import { get } from "./api.js";
import { el, fill, problem, quiet } from "./dom.js";
import { LEAST, sized } from "./plot_size.js";

let loading = null;

function plotly() {
  loading ??= new Promise((resolve, reject) => {
    const script = el("script", { src: "/pages/plotly.min.js" });
    script.onload = () => resolve(window.Plotly);
    script.onerror = () => { loading = null; script.remove(); reject(new Error("Plotly could not be loaded from the service.")); };
    document.head.append(script);
  });
  return loading;
}

const dark = matchMedia("(prefers-color-scheme: dark)");
export const theme = () => (dark.matches ? "dark" : "light");

// Nothing of a figure ever leaves the machine. The window's size is watched here, since heights follow widths.
const CONFIG = {
  displaylogo: false, responsive: false, showSendToCloud: false, plotlyServerURL: "", modeBarButtonsToRemove: ["lasso2d", "select2d"],
};

// Figures with words beside their bars, which would meet if they were any narrower [px]: smaller ones are scaled down, as far as they can still be read.
const LEAST_OF = { ranking: 900, held_out: 900, sensitivity: 900, size: 1000, missing_torque: 880, confounding: 760, residual_map: 860 };

const READABLE = 0.8;

// What is shown now, to be drawn anew where the page turns dark or light.
const shown = new Map();
const turns = new WeakMap();
dark.addEventListener("change", () => {
  for (const [plot, again] of shown) {
    if (plot.isConnected) again();
    else shown.delete(plot);
  }
});

/**
 * Ask for a figure and show it.
 *
 * `path` is its address below /figures, or a function that gets it for a theme (light or dark). `picked` is called with the ids of the load cases that a point stands for.
 */
export async function figure(place, path, query = {}, { picked, signal } = {}) {
  const turn = (turns.get(place) || 0) + 1;
  turns.set(place, turn);
  const late = () => signal?.aborted || turns.get(place) !== turn;
  if (place.firstChild) place.setAttribute("aria-busy", "true");
  else fill(place, quiet("Drawing …"));
  const again = () => figure(place, path, query, { picked, signal });
  try {
    const now = theme();
    const drawn = typeof path === "string" ? await get(`/figures/${path}`, { ...query, theme: now }, signal) : await path(now);
    if (late()) return null;
    if (!drawn.figure) {
      fill(place, quiet(drawn.text));
      return null;
    }
    const lib = await plotly();
    if (late()) return null;
    // Its tools can be reached by keyboard, so it is a group; its words stand for the drawing.
    const plot = el("div", { class: "plot", role: "group", "aria-label": drawn.text });
    const box = el("figure", {}, plot, drawn.caption ? el("figcaption", {}, drawn.caption) : null,
      el("details", {}, el("summary", {}, "In words"), el("p", {}, drawn.text)));
    for (const old of place.querySelectorAll(".js-plotly-plot")) { shown.delete(old); lib.purge(old); }
    fill(place, box);
    const wide = () => Math.round(place.clientWidth);
    const least = LEAST_OF[drawn.name] || LEAST;
    const layout = () => {
      width_px = wide();
      const out = sized(drawn.figure, Math.max(width_px, least));
      const scale = Math.min(1, Math.max(READABLE, width_px / least || 1));
      plot.style.transform = scale < 1 ? `scale(${scale})` : "";
      plot.style.height = `${out.height * scale}px`;
      return out;
    };
    let width_px = 0;
    const data = picked ? clickable(drawn) : drawn.figure.data;
    await lib.newPlot(plot, data, layout(), CONFIG);
    for (const svg of plot.querySelectorAll("svg.main-svg")) svg.setAttribute("aria-hidden", "true");
    shown.set(plot, again);
    let waiting = 0;
    const watch = new ResizeObserver(() => {
      if (!plot.isConnected) return watch.disconnect();
      clearTimeout(waiting);
      waiting = setTimeout(() => {
        if (!plot.isConnected || !wide() || Math.abs(wide() - width_px) < 4) return;
        lib.react(plot, data, layout(), CONFIG);
      }, 120);
    });
    watch.observe(place);
    if (picked) {
      plot.classList.add("pickable");
      plot.on("plotly_click", (event) => {
        const cases = event.points.map((p) => casesOf(drawn.cases, p)).find((found) => found.length);
        if (cases) picked(cases);
      });
    }
    return plot;
  } catch (error) {
    if (error.name !== "AbortError" && !late()) fill(place, problem(error), el("button", { onclick: again }, "Try again"));
    return null;
  } finally {
    if (turns.get(place) === turn) place.removeAttribute("aria-busy");
  }
}

/** Draw a figure as it is, without tools. */
export async function plotted(place, figure) {
  const lib = await plotly();
  await lib.newPlot(place, figure.data, figure.layout, { ...CONFIG, staticPlot: true });
  for (const svg of place.querySelectorAll("svg.main-svg")) svg.setAttribute("aria-hidden", "true");
}

/** What has no label can be picked all the same. */
function clickable(drawn) {
  return drawn.figure.data.map((trace, k) => (drawn.cases?.[k] && trace.hoverinfo === "skip" ? { ...trace, hoverinfo: "none" } : trace));
}

function casesOf(cases, point) {
  let found = cases?.[point.curveNumber];
  const at = point.pointNumber ?? point.pointIndex;
  if (Array.isArray(found)) found = Array.isArray(at) ? found[at[0]]?.[at[1]] : found[at];
  return [found].flat().filter(Boolean);
}

/**
 * Show the figures that come along with an answer: `ask` gets the answer for a theme, and is asked again where the page
 * turns dark or light. Returns a node, filled as they are drawn.
 */
export function figuresOf(answer, ask, signal) {
  const kept = new Map([[answer.figures[0]?.theme, Promise.resolve(answer)]]);
  const of = (colours) => {
    if (!kept.has(colours)) kept.set(colours, ask(colours));
    return kept.get(colours);
  };
  return answer.figures.map((f, i) => {
    const place = el("div", { class: "drawn" });
    queueMicrotask(() => figure(place, async (colours) => (await of(colours)).figures[i], {}, { signal }));
    return el("section", { class: "panel" }, f.heading ? el("h2", {}, f.heading) : null, place);
  });
}
