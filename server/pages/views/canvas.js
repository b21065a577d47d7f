// Traces on a canvas: least and most of each stretch, so that no peak is hidden.

export const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

/** Prepare a canvas for the screen's resolution; returns its context and size. */
export function prepared(canvas) {
  const scale = devicePixelRatio || 1;
  const width = canvas.clientWidth || 300;
  const height = canvas.clientHeight || Number(canvas.getAttribute("height")) || 90;
  if (canvas.width !== Math.round(width * scale) || canvas.height !== Math.round(height * scale)) {
    canvas.width = Math.round(width * scale);
    canvas.height = Math.round(height * scale);
  }
  const context = canvas.getContext("2d");
  context.setTransform(scale, 0, 0, scale, 0, 0);
  context.clearRect(0, 0, width, height);
  return { context, width, height };
}

export function envelope(canvas, t, low, high, { bounds, span, colour, least = 0.05 }) {
  canvas.style.width = "100%";
  canvas.style.height = `${canvas.getAttribute("height")}px`;
  const { context, width, height } = prepared(canvas);
  const [a, b] = bounds;
  let bottom = Infinity;
  let top = -Infinity;
  for (let i = 0; i < t.length; i++) {
    if (low[i] === null || high[i] === null) continue;
    if (low[i] < bottom) bottom = low[i];
    if (high[i] > top) top = high[i];
  }
  const left = 52;
  const x = (s) => left + ((s - a) / Math.max(b - a, 1e-9)) * (width - left - 4);
  if (span) {
    context.fillStyle = css("--mark");
    context.fillRect(x(span[0]), 0, Math.max(x(span[1]) - x(span[0]), 1), height - 16);
  }
  if (!(top >= bottom)) return;
  const middle = (top + bottom) / 2;
  const half = Math.max((top - bottom) / 2, least) * 1.08;
  const y = (v) => (height - 18) * (0.5 - (v - middle) / (2 * half)) + 1;
  context.strokeStyle = css("--line");
  context.fillStyle = css("--quiet");
  context.font = "12px system-ui, sans-serif";
  context.lineWidth = 1;
  for (const v of [middle + half / 1.08, middle, middle - half / 1.08]) {
    context.beginPath();
    context.moveTo(left, y(v));
    context.lineTo(width, y(v));
    context.stroke();
    context.textAlign = "right";
    context.textBaseline = "middle";
    context.fillText(v.toFixed(2).replace("-", "−"), left - 4, y(v));
  }
  context.textAlign = "left";
  context.textBaseline = "bottom";
  context.fillText(`${a.toFixed(1)} s`, left, height);
  context.textAlign = "right";
  context.fillText(`${b.toFixed(1)} s`, width - 2, height);
  context.strokeStyle = colour;
  context.lineWidth = 1.5;
  context.beginPath();
  for (let i = 0; i < t.length; i++) {
    if (low[i] === null || high[i] === null || t[i] < a) continue;
    const px = x(t[i]);
    context.lineTo(px, y(high[i]));
    if (high[i] !== low[i]) context.lineTo(px, y(low[i]));
  }
  context.stroke();
}
