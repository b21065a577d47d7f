// The layout of a figure for another width: what is told in pixels stays so, and what is to scale stays to scale.

// Narrower, labels would meet: the figure is scaled down or scrolled instead [px].
export const LEAST = 720;
const NARROW = 820;

export function sized(figure, wanted) {
  const layout = structuredClone(figure.layout);
  const first = { width: layout.width, height: layout.height, ...margins(layout) };
  const width = Math.max(wanted || first.width, LEAST);
  if (!first.width || !first.height) return { ...layout, width };
  if (first.r >= 200 && width < NARROW) below(layout);
  const { l, r, b } = margins(layout);
  const plot = { w: first.width - first.l - first.r, h: first.height - first.t - first.b };
  const fx = Math.max(width - l - r, 160) / plot.w;
  const toScale = Object.entries(layout).some(([k, v]) => /^[xy]axis/.test(k) && v?.scaleanchor);
  const fy = toScale ? Math.max(0.55, Math.min(fx, 1.6)) : 1;
  const more = titled(layout, width);
  layout.margin.t = first.t + more;
  layout.width = width;
  layout.height = Math.round(plot.h * fy + layout.margin.t + b);
  if (layout.title) layout.title.y = 1 - 14 / layout.height;
  for (const item of [...(layout.annotations || []), layout.legend]) {
    if (!item) continue;
    if (item === layout.legend || item.yref === "paper") item.y = outside(item.y, fy);
    if (item === layout.legend || item.xref === "paper") item.x = outside(item.x, fx);
  }
  return layout;
}

const margins = (layout) => ({ l: 80, r: 80, t: 100, b: 80, ...layout.margin });

/** A place beyond the plot is so many pixels away from it, however large the plot is. */
function outside(at, factor) {
  if (typeof at !== "number") return at;
  return at < 0 ? at / factor : at > 1 ? 1 + (at - 1) / factor : at;
}

/** A legend beside the plot takes half of a narrow page: it goes below. */
function below(layout) {
  layout.margin = { ...margins(layout), r: 20 };
  layout.legend = { ...layout.legend, orientation: "h", x: 0, xanchor: "left", y: -0.18, yanchor: "top" };
}

/** Break title and subtitle to the width; returns by how many pixels they grew. */
function titled(layout, width) {
  if (!layout.title) return 0;
  const wrapped = (text, perLetter) => {
    const most = Math.max(24, Math.floor((width - 36) / perLetter));
    return String(text).split("<br>").flatMap((line) => broken(line, most)).join("<br>");
  };
  const lines = (text) => (text ? text.split("<br>").length : 0);
  const head = layout.title.text;
  const under = layout.title.subtitle?.text;
  if (head) layout.title.text = wrapped(head, 8.4);
  if (under) layout.title.subtitle.text = wrapped(under, 6.1);
  return 20 * (lines(layout.title.text) - lines(head)) + 15 * (lines(layout.title.subtitle?.text) - lines(under));
}

function broken(line, most) {
  const out = [""];
  for (const word of line.split(" ")) {
    const now = out.at(-1);
    if (now && now.length + 1 + word.length > most) out.push(word);
    else out[out.length - 1] = now ? `${now} ${word}` : word;
  }
  return out;
}
