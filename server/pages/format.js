// Numbers with sensible digits and units.

export function number(value, digits = 3) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  return value.toFixed(digits).replace("-", "−");
}

/** A number as text with its unit; what has no dimension (unit 1) has none to be written. */
export const withUnit = (text, unit) => (unit === "1" || !unit ? text : `${text} ${unit}`);

/** A value to as many digits as its uncertainty bears: 1.234 ± 0.056. */
export function within(value, sd) {
  if (value === null || value === undefined) return "–";
  if (!sd || !Number.isFinite(sd)) return compact(value);
  const digits = Math.min(6, Math.max(0, 1 - Math.floor(Math.log10(sd))));
  return `${number(value, digits)} ± ${number(sd, digits)}`;
}

export function compact(value) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  const size = Math.abs(value);
  const digits = size >= 100 ? 0 : size >= 10 ? 1 : size >= 1 ? 2 : 3;
  return number(value, digits);
}

export function percent(value) {
  if (value === null || value === undefined) return "–";
  if (value > 0.995) return "> 99 %";
  if (value < 0.005) return "< 1 %";
  return `${Math.round(100 * value)} %`;
}

/** z of a load case in the plane in which its finger is judged. */
export const zOf = (c, body) => (body?.judged_in === "sagittal" ? c.z_sagittal : c.z) ?? null;
/** A refit of a search (JOB/nothing, JOB/EFFECT) in a few words. */
export const refitName = (id) => `refitted with ${id.split("/")[1].replaceAll("+", " + ")} added (search ${id.slice(0, 6)})`;

export const vector = (v) => (v ? v.map((x) => number(x, 2)).join("  ") : "–");
export const norm = (v) => (v ? Math.hypot(...v) : null);
export const masses = (m) => Object.entries(m || {}).map(([k, g]) => `${k} ${compactMass(g)}`).join(" + ") || "no weight";
const compactMass = (g) => `${Number(g.toPrecision(4))} g`;

export function seconds(s) {
  if (s === null || s === undefined) return "–";
  if (s < 90) return `${Math.round(s)} s`;
  if (s < 5400) return `${Math.round(s / 60)} min`;
  return `${(s / 3600).toFixed(1)} h`;
}

export function when(utc) {
  return utc ? new Date(utc).toLocaleString([], { dateStyle: "medium", timeStyle: "short" }) : "–";
}
export const words = (name) => String(name).replaceAll("_", " ");
