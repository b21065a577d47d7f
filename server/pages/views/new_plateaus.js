// What every plateau of a recording is taken for: coloured on the trace, changed by a choice or by dragging, then checked and kept.
import { el, fill, panel, problem, quiet, table } from "../dom.js";
import { number, percent } from "../format.js";
import { figure } from "../plot.js";

const SURE = 0.8;
// Loads, tares, what is left out, and loads that are to be looked at.
const COLOURS = { load: "rgba(0,114,178,0.30)", tare: "rgba(0,158,115,0.38)", skip: "rgba(128,128,128,0.25)", unsure: "rgba(230,159,0,0.48)" };
const WORDS = { load: "a load", tare: "a tare", skip: "left out", unsure: "to be looked at" };

/** Notes in two lines: what was converted, and the rest. */
const told = (notes) => [notes.filter((n) => n.includes(" × ")), notes.filter((n) => !n.includes(" × "))].filter((list) => list.length).map((list) => quiet(`${list.join("; ")}.`));
const written = (masses) => Object.entries(masses).map(([k, g]) => `${k} ${g}`).join(" + ");

/** Masses as typed, such as FDP 950 + FDS 300; null where they are none. */
function masses(text) {
  const out = {};
  for (const part of text.split("+")) {
    const found = part.trim().match(/^([A-Za-z]\w*)[ :=]+(\d+(?:[.,]\d+)?)(?: ?g)?$/);
    if (!found) return null;
    out[found[1]] = Number(found[2].replace(",", "."));
  }
  return out;
}

export function plateaus(body, header, { signal, draft, keep, again }) {
  const rows = body.plateaus.map((p, i) => ({ ...p, i, chosen: taken(p.kind, p.line, p.sure) }));
  const postures = new Map();
  const place = el("div", { class: "drawn" });
  const list = el("div");
  const angles = el("div");
  const made = el("div", { role: "status", "aria-live": "polite" });
  const name = el("input", { id: "new-id", autocomplete: "off", required: true, pattern: "[A-Za-z0-9][A-Za-z0-9._\\-]{0,99}", placeholder: "S01-monday" });

  function taken(kind, line, sure) {
    const from = line === null ? {} : body.lines[line];
    return { kind, line, laid: line, sure, masses_g: from.masses_g || {}, posture: from.posture || "", location: from.location || "", role: from.role || "identification", repeats: from.repeats || false, direction: from.direction || "loading", tapped: from.tapped || false };
  }

  /** The trace, each plateau in the colour of what it is taken for. */
  async function drawn(colours) {
    const base = colours === body.figure.theme ? body.figure : (await again(colours)).figure;
    const shapes = base.figure.layout.shapes.map((shape, k) => {
      const { kind, sure } = rows[k % rows.length].chosen;
      return { ...shape, fillcolor: COLOURS[kind === "load" && sure < SURE ? "unsure" : kind] };
    });
    return { ...base, figure: { ...base.figure, layout: { ...base.figure.layout, shapes } } };
  }
  const draw = () => figure(place, drawn, {}, { signal });

  function change(i, chosen) {
    rows[i].chosen = chosen;
    show();
  }

  /** A gap at one plateau: what it and the next ones were taken for comes one later, tares staying where they are. */
  function later(i) {
    let moved = { ...rows[i].chosen };
    rows[i].chosen = taken("skip", null, 1);
    for (const row of rows.slice(i + 1)) {
      if (row.chosen.kind !== "load") continue;
      [row.chosen, moved] = [{ ...moved, sure: Math.min(moved.sure, 0.5) }, row.chosen];
    }
    show();
  }

  function choice(row) {
    const now = row.chosen;
    const value = now.kind === "load" ? (now.line === null ? "own" : String(now.line)) : now.kind;
    return el("select", { class: "short", "aria-label": `Plateau ${row.i + 1} is`, onchange: (e) => {
      const v = e.target.value;
      change(row.i, v === "tare" || v === "skip" ? taken(v, null, 1) : v === "own" ? { ...taken("load", null, 1), posture: now.posture, location: now.location || "tip" } : taken(body.lines[v].kind, Number(v), 1));
    } }, [["tare", "tare"], ["skip", "left out"], ...body.lines.map((l, k) => [String(k), `line ${l.line}: ${l.said}`]), ["own", "another load"]].map(([v, t]) => el("option", { value: v, selected: v === value }, t)));
  }

  function typed(row, key, title, size) {
    if (row.chosen.kind !== "load") return "";
    const box = el("input", { "aria-label": `${title} of plateau ${row.i + 1}`, size, autocomplete: "off", value: key === "masses_g" ? written(row.chosen.masses_g) : row.chosen[key] });
    box.addEventListener("change", () => {
      const value = key === "masses_g" ? masses(box.value) : box.value.trim();
      box.setCustomValidity(value === null ? "such as FDP 950 + FDS 300, in g" : "");
      if (value === null) return box.reportValidity();
      row.chosen = { ...row.chosen, [key]: value, line: null, sure: 1 };
      show();
    });
    return box;
  }

  function picked(row, key, values, title) {
    if (row.chosen.kind !== "load") return "";
    return el("select", { "aria-label": `${title} of plateau ${row.i + 1}`, onchange: (e) => { row.chosen = { ...row.chosen, [key]: e.target.value }; show(); } },
      values.map((v) => el("option", { value: v, selected: v === row.chosen[key] }, v)));
  }

  /** What a plateau is taken for is dragged onto another one: the two are exchanged. */
  function handle(row) {
    const grip = el("span", { draggable: true, title: "Drag onto another plateau to exchange the two", class: "grip", "aria-hidden": "true" }, "⠿ ");
    grip.addEventListener("dragstart", (e) => e.dataTransfer.setData("text/x-plateau", String(row.i)));
    return grip;
  }

  function show() {
    const shown = table([
      { title: "", cell: (r) => [handle(r), String(r.i + 1)] },
      { title: "taken for", cell: choice },
      { title: "sure", n: true, cell: (r) => el("span", { class: r.chosen.sure < SURE ? "warn" : "" }, number(r.chosen.sure, 2)) },
      { title: "change [N]", n: true, cell: (r) => number(r.change_N, 2) },
      { title: "window [s]", cell: (r) => r.window_s.map((t) => number(t, 1)).join(" to ") },
      { title: "hung [g]", cell: (r) => typed(r, "masses_g", "Masses", 16) },
      { title: "posture", cell: (r) => typed(r, "posture", "Posture", 10) },
      { title: "read at", cell: (r) => picked(r, "location", ["tip", "bone"], "Place") },
      { title: "role", cell: (r) => picked(r, "role", ["identification", "validation"], "Role") },
      { title: "", cell: (r) => (r.chosen.kind === "load" ? el("button", { class: "small", "aria-label": `A gap at plateau ${r.i + 1}: this and the next come one later`, onclick: () => later(r.i) }, "gap here") : "") },
    ], rows, { caption: `${rows.length} plateaus; ${rows.filter((r) => r.chosen.sure < SURE).length} to be looked at` });
    shown.classList.add("form");
    for (const [k, line] of [...shown.querySelectorAll("tbody tr")].entries()) {
      line.addEventListener("dragover", (e) => { if (e.dataTransfer.types.includes("text/x-plateau")) e.preventDefault(); });
      line.addEventListener("drop", (e) => {
        e.preventDefault();
        const from = rows[Number(e.dataTransfer.getData("text/x-plateau"))];
        if (!from || from === rows[k]) return;
        [from.chosen, rows[k].chosen] = [{ ...rows[k].chosen, sure: 1 }, { ...from.chosen, sure: 1 }];
        show();
      });
    }
    const lost = body.lines.filter((l, k) => l.kind === "load" && !rows.some((r) => r.chosen.laid === k));
    fill(list, lost.map((l) => el("p", { class: "warn" }, `Line ${l.line} of the notebook is on no plateau: ${l.said}`)), shown);
    asked();
    draw();
  }

  /** Angles of every posture in use. */
  function asked() {
    const names = [...new Set(rows.filter((r) => r.chosen.kind === "load" && r.chosen.posture).map((r) => r.chosen.posture))];
    fill(angles, names.map((posture) => {
      if (!postures.has(posture)) {
        const known = header.known()[posture] || {};
        postures.set(posture, Object.fromEntries(header.joints().map((joint) => [joint, el("input", { type: "number", step: "any", "aria-label": `${joint} of ${posture} [deg]`, value: known[joint] ?? "" })])));
      }
      return el("div", { class: "row" }, el("strong", {}, posture), Object.entries(postures.get(posture)).map(([joint, box]) => el("label", { class: "above" }, joint, box)));
    }));
  }

  function readPostures() {
    const names = new Set(rows.filter((r) => r.chosen.kind === "load").map((r) => r.chosen.posture));
    return Object.fromEntries([...postures].filter(([posture]) => names.has(posture)).map(([posture, boxes]) => [posture, Object.fromEntries(Object.entries(boxes).map(([joint, box]) => {
      if (!box.value.trim()) { box.focus(); throw new Error(`The angle ${joint} of ${posture} is not given.`); }
      return [joint, Number(box.value)];
    }))]));
  }

  const sends = () => rows.map(({ chosen: { line, laid, sure, ...sent } }) => sent);

  const loads = () => rows.filter((r) => r.chosen.kind === "load");

  async function act(work, title) {
    try {
      if (!name.value.trim() || !name.checkValidity()) { name.focus(); throw new Error("The session wants a name: letters, digits and . _ -"); }
      fill(made, quiet(`${title} …`), el("progress", { "aria-label": title }));
      const answer = await work(name.value.trim());
      if (!signal.aborted) return answer;
    } catch (error) {
      fill(made, problem(error));
    }
    return null;
  }

  async function check() {
    const found = await act(draft, "Checking");
    if (!found) return;
    const plateau = (id) => loads()[Number(id.slice(1)) - 1]?.i + 1;
    fill(made, el("p", { class: "verdict" }, `${found.cases} load cases; ${found.findings.some((f) => f.level === "error") ? "not sound yet" : "sound"}.`),
      found.findings.filter((f) => f.level !== "note").map((f) => el("p", { class: f.level === "error" ? "bad" : "warn" }, `${f.level}: ${f.where}: ${f.text}`)),
      found.looked_at ? quiet(`The model was not held against it: ${found.looked_at}`)
        : found.suspects.length ? [el("h3", {}, "Does each case look like what was hung?"), el("ul", {}, found.suspects.map((s) => el("li", {}, `Plateau ${plateau(s.case)} (${s.case}): rather ${s.words}; the entry leaves ${percent(s.own)} of the reading, that ${percent(s.other)}`)))]
          : quiet("Every case looks like what was hung, as far as the finger without any fit can tell."),
      found.missing.length ? [el("h3", {}, "What a diagnosis would lack"), el("ul", {}, found.missing.map((m) => el("li", {}, m)))] : null);
  }

  async function make() {
    const session = await act(keep, "Making the session");
    if (!session) return;
    fill(made, el("p", { class: "good" }, `${session.id} is here${session.already_there ? " already" : ""}: ${Object.entries(session.cases).map(([s, n]) => `${n} load cases ${s}`).join(", ")}. `,
      el("a", { href: `#/sessions/${encodeURIComponent(session.id)}/compare` }, "Compare it"), " or ", el("a", { href: `#/sessions/${encodeURIComponent(session.id)}/find` }, "find what the model lacks"), "."));
  }

  const key = el("p", {}, Object.entries(WORDS).map(([kind, text]) => el("span", { class: "chip", style: `background:${COLOURS[kind]}` }, text)).flatMap((c) => [c, " "]));
  const node = el("div", {},
    panel("5. Plateaus", told(body.laid_notes), key, place, list),
    panel("6. Postures", quiet("Joint angles in degrees, flexion positive."), angles),
    panel("7. The session", el("div", { class: "row" }, el("div", {}, el("label", { htmlFor: "new-id" }, "Name of the session"), name), el("button", { onclick: check }, "Check it"), el("button", { class: "main", onclick: make }, "Make the session")), made));
  show();
  return { node, choices: sends, postures: readPostures };
}
