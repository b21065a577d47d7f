// Figures that the service draws, shown by Plotly, with the same in words for who cannot see them.
import { get } from "./api.js";
import { el, fill, problem, quiet } from "./dom.js";

let loading = null;

function plotly() {
  loading ??= new Promise((resolve, reject) => {
    const script = el("script", { src: "/pages/plotly.min.js" });
    script.onload = () => resolve(window.Plotly);
    script.onerror = () => { loading = null; reject(new Error("Plotly could not be loaded from the service.")); };
    document.head.append(script);
  });
  return loading;
}

export const theme = () => (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light");

// Nothing of a figure ever leaves the machine.
const CONFIG = {
  displaylogo: false, responsive: true, showLink: false, showEditInChartStudio: false, plotlyServerURL: "",
  modeBarButtonsToRemove: ["sendDataToCloud", "editInChartStudio", "lasso2d", "select2d"],
};

/** Ask for a figure and show it; `picked` is called with a point's custom data. */
export async function figure(place, path, query = {}, { picked, signal } = {}) {
  fill(place, quiet("Drawing …"));
  try {
    const drawn = await get(`/figures/${path}`, { ...query, theme: theme() }, signal);
    if (!drawn.figure) {
      fill(place, quiet(drawn.text));
      return null;
    }
    const lib = await plotly();
    if (signal?.aborted) return null;
    const plot = el("div", { class: "plot", role: "img", "aria-label": drawn.text });
    fill(place, el("figure", {}, plot, drawn.caption ? el("figcaption", {}, drawn.caption) : null,
      el("details", {}, el("summary", {}, "In words"), el("p", {}, drawn.text))));
    await lib.newPlot(plot, drawn.figure.data, drawn.figure.layout, CONFIG);
    if (picked) plot.on("plotly_click", (event) => picked(event.points[0]));
    return plot;
  } catch (error) {
    if (error.name !== "AbortError") fill(place, problem(error));
    return null;
  }
}
