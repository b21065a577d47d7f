// Readings about a window on a canvas: least and most of each stretch, the window shaded with its two edges.

export const LEFT = 56;
export const RIGHT = 8;
const UNDER = 20;
const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

export function paint(canvas, readings, channel, span, [a, b]) {
  const scale = devicePixelRatio || 1;
  const width = canvas.clientWidth;
  const height = canvas.clientHeight;
  if (!width || !height) return;
  canvas.width = Math.round(width * scale);
  canvas.height = Math.round(height * scale);
  const c = canvas.getContext("2d");
  c.setTransform(scale, 0, 0, scale, 0, 0);
  const raw = readings.kind === "raw";
  const t = (raw ? readings.t_s : readings.from_s?.map((s, i) => (s + readings.to_s[i]) / 2)) || [];
  const low = (raw ? readings.values : readings.least)?.[channel] || [];
  const high = (raw ? readings.values : readings.most)?.[channel] || [];
  const x = (s) => LEFT + ((s - a) / Math.max(b - a, 1e-9)) * (width - LEFT - RIGHT);
  const floor = height - UNDER;
  c.fillStyle = css("--window");
  c.fillRect(x(span[0]), 0, Math.max(x(span[1]) - x(span[0]), 1), floor);
  c.strokeStyle = css("--predicted");
  c.lineWidth = 2;
  for (const s of span) line(c, x(s), 0, x(s), floor);
  const least = Math.min(...low.filter((v) => v !== null));
  const most = Math.max(...high.filter((v) => v !== null));
  c.font = "12px system-ui, sans-serif";
  c.fillStyle = css("--quiet");
  c.textBaseline = "alphabetic";
  c.textAlign = "left";
  c.fillText(`${a.toFixed(1)} s`, LEFT, height - 4);
  c.textAlign = "right";
  c.fillText(`${b.toFixed(1)} s`, width - RIGHT, height - 4);
  if (!(most >= least)) return;
  const half = Math.max((most - least) / 2, 1e-3) * 1.1;
  const middle = (most + least) / 2;
  const y = (v) => floor * (0.5 - (v - middle) / (2 * half));
  c.strokeStyle = css("--line");
  c.lineWidth = 1;
  const digits = Math.max(0, Math.min(4, 1 - Math.floor(Math.log10(half))));
  for (const v of [most, middle, least]) {
    line(c, LEFT, y(v), width - RIGHT, y(v));
    c.textBaseline = "middle";
    c.fillText(v.toFixed(digits).replace("-", "−"), LEFT - 6, Math.min(Math.max(y(v), 7), floor - 6));
  }
  c.strokeStyle = css("--measured");
  c.lineWidth = 1.4;
  c.beginPath();
  for (let i = 0; i < t.length; i++) {
    if (low[i] === null || high[i] === null) continue;
    c.lineTo(x(t[i]), y(high[i]));
    if (high[i] !== low[i]) c.lineTo(x(t[i]), y(low[i]));
  }
  c.stroke();
}

function line(c, x0, y0, x1, y1) {
  c.beginPath();
  c.moveTo(x0, y0);
  c.lineTo(x1, y1);
  c.stroke();
}
