// What drawings on a canvas share: colours of the page, and axes that people can read.

const colours = new Map();
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => colours.clear());

/** A colour of the page; asked of the style once for each scheme, as every frame needs some. */
export function css(name) {
  let found = colours.get(name);
  if (found === undefined) {
    found = getComputedStyle(document.documentElement).getPropertyValue(name).trim();
    // Before the styles are there, there is none to be kept.
    if (found) colours.set(name, found);
  }
  return found;
}

/** A step of an axis that people count in (1, 2 or 5 times a power of ten), so that about `count` fit in a span. */
export function niceStep(span, count) {
  const raw = Math.max(span, 1e-12) / count;
  const power = 10 ** Math.floor(Math.log10(raw));
  const lead = raw / power;
  return (lead < 1.5 ? 1 : lead < 3.5 ? 2 : lead < 7.5 ? 5 : 10) * power;
}

/** A number of an axis with as many digits as its step needs. */
export function onAxis(value, step) {
  const digits = Math.min(6, Math.max(0, -Math.floor(Math.log10(step) + 1e-9)));
  return (Math.abs(value) < step / 1e3 ? 0 : value).toFixed(digits).replace("-", "−");
}
