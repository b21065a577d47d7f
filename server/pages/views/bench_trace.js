// One trace on its canvas: axes, least and most of each column of pixels, gaps, and readings beyond the cell's range.
import { AXES } from "./bench_ring.js";
import { css, niceStep, onAxis } from "./canvas.js";

// Room for the numbers of the axes [px].
export const LEFT = 56;
const BOTTOM = 18;
// Longer than this without a reading is a gap that is shown.
const GAP_S = 0.4;

/**
 * Draw one channel `i` from a to b [s], an offset taken off.
 *
 * `data` has the `ring`, the `past` that was asked for, a `window` to be marked, and how `tall` it is; `least` is half
 * the height that is shown at least, so that noise does not look like a load.
 */
export function drawTrace(canvas, [width, height], data, i, least, a, b, offset) {
  if (width < 10) return;
  const context = canvas.getContext("2d");
  const scale = devicePixelRatio || 1;
  context.setTransform(scale, 0, 0, scale, 0, 0);
  context.clearRect(0, 0, width, height);
  const { ring, window } = data;
  const past = data.past && (!ring.count || a < ring.firstS - 0.2) && data.past.to >= a && data.past.from <= b ? data.past : null;
  let bottom = Infinity;
  let top = -Infinity;
  const begin = ring.find(a);
  for (let n = begin; n < ring.count; n++) {
    const k = ring.at(n);
    if (ring.from[k] > b) break;
    const low = ring.low[k * AXES + i];
    const high = ring.high[k * AXES + i];
    if (low < bottom) bottom = low;
    if (high > top) top = high;
  }
  if (past) {
    for (let n = 0; n < past.t.length; n++) {
      if (past.t[n] < a || past.t[n] > b) continue;
      if (past.low[i][n] < bottom) bottom = past.low[i][n];
      if (past.high[i][n] > top) top = past.high[i][n];
    }
  }
  const some = top >= bottom;
  const middle = some ? (top + bottom) / 2 - offset : 0;
  const half = (Math.max(some ? (top - bottom) / 2 : 0, least) * 1.12) / data.tall;
  const plot = height - BOTTOM;
  const y = (v) => Math.min(Math.max(plot * (0.5 - (v - offset - middle) / (2 * half)), -2), plot + 2);
  const x = (t) => LEFT + ((t - a) / (b - a)) * (width - LEFT - 4);
  if (window && window[1] > a && window[0] < b) {
    context.fillStyle = css("--mark");
    context.fillRect(Math.max(x(window[0]), LEFT), 0, Math.max(x(Math.min(window[1], b)) - Math.max(x(window[0]), LEFT), 1), plot);
  }
  grid(context, width, height, a, b, middle, half, x);
  if (!some) return;
  context.save();
  context.beginPath();
  context.rect(LEFT, 0, width - LEFT, plot);
  context.clip();
  context.strokeStyle = context.fillStyle = css("--measured");
  context.lineWidth = 1.5;
  context.lineJoin = "round";
  if (past) pen(context, past.t.length, (n) => past.t[n], (n) => past.low[i][n], (n) => past.high[i][n], a, Math.min(b, ring.count ? ring.firstS : b), x, y, Math.max(GAP_S, (3 * past.span) / past.t.length));
  pen(context, ring.count, (n) => ring.to[ring.at(n)], (n) => ring.low[ring.at(n) * AXES + i], (n) => ring.high[ring.at(n) * AXES + i], a, b, x, y, GAP_S, begin);
  context.restore();
  overloads(context, ring, begin, b, x);
}

/** One vertical stroke a column of pixels from least to most, joined to the next. */
function pen(context, count, t, low, high, a, b, x, y, gap, begin = 0) {
  context.beginPath();
  let column = -1;
  let least = 0;
  let most = 0;
  let before = NaN;
  let open = false;
  const stroke = () => {
    if (column < 0) return;
    const ya = y(most);
    const yb = y(least);
    if (open) context.lineTo(column, ya);
    else context.moveTo(column, ya);
    context.lineTo(column, Math.abs(yb - ya) < 0.75 ? ya + 0.75 : yb);
    open = true;
  };
  for (let n = Math.max(begin - 1, 0); n < count; n++) {
    const time = t(n);
    if (time < a - 1) continue;
    if (time > b) break;
    const l = low(n);
    const h = high(n);
    const px = Math.round(x(time));
    if (time - before > gap || Number.isNaN(l)) {
      stroke();
      column = -1;
      open = false;
    }
    before = time;
    if (Number.isNaN(l)) continue;
    if (px !== column) {
      stroke();
      column = px;
      least = l;
      most = h;
    } else {
      if (l < least) least = l;
      if (h > most) most = h;
    }
  }
  stroke();
  context.stroke();
}

function overloads(context, ring, begin, b, x) {
  context.fillStyle = css("--bad");
  for (let n = begin; n < ring.count; n++) {
    const k = ring.at(n);
    if (ring.from[k] > b) break;
    if (ring.over[k]) context.fillRect(Math.max(x(ring.to[k]) - 2, LEFT), 0, 3, 5);
  }
}

function grid(context, width, height, a, b, middle, half, x) {
  const plot = height - BOTTOM;
  context.font = "12px system-ui, sans-serif";
  context.lineWidth = 1;
  context.strokeStyle = css("--line");
  context.fillStyle = css("--quiet");
  const dy = niceStep(2 * half, plot < 80 ? 2 : 3);
  context.textAlign = "right";
  context.textBaseline = "middle";
  context.beginPath();
  for (let v = Math.ceil((middle - half) / dy) * dy; v <= middle + half; v += dy) {
    const py = Math.round(plot * (0.5 - (v - middle) / (2 * half))) + 0.5;
    context.moveTo(LEFT, py);
    context.lineTo(width, py);
    if (py > 7 && py < plot - 5) context.fillText(onAxis(v, dy), LEFT - 5, py);
  }
  const dx = niceStep(b - a, width < 420 ? 3 : 5);
  context.textBaseline = "bottom";
  context.textAlign = "center";
  for (let t = Math.ceil(Math.max(a, 0) / dx) * dx; t <= b; t += dx) {
    const px = Math.round(x(t)) + 0.5;
    context.moveTo(px, 0);
    context.lineTo(px, plot);
    if (px > LEFT + 8 && px < width - 16) context.fillText(onAxis(t, dx), px, height - 1);
  }
  context.stroke();
  context.textAlign = "right";
  context.fillText("s", LEFT - 5, height - 1);
}
