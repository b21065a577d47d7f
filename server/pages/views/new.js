// A new session from a lab's recordings: looked at, the notebook laid onto their plateaus, what no recording tells asked for.
import { at, get, post } from "../api.js";
import { el, fill, note, notice, panel, problem, quiet, table } from "../dom.js";
import { number } from "../format.js";
import { figure, theme } from "../plot.js";
import { base64, content, dropZone } from "./importing.js";
import { plateaus } from "./new_plateaus.js";
import { rig } from "./new_rig.js";

const MOST_BYTES = 11 * 2 ** 20;
let waiting = [];

/** Files that were dropped on another page. */
export function handed(files) {
  waiting = files;
}

export async function view(main) {
  const away = new AbortController();
  let files = [];
  let sent = [];
  let mapping = null;
  let like = "";
  let header = null;
  let laid = null;
  let turn = 0;

  const said = el("div", { role: "status", "aria-live": "polite" });
  const chosen = el("div");
  const seen = el("div");
  const rest = el("div");
  const input = el("input", { id: "recordings", type: "file", multiple: true, onchange: () => { const given = [...input.files]; input.value = ""; take(given); } });
  fill(main, el("h1", {}, "New session from a recording"),
    panel("1. Recordings", quiet("One or several, in the order in which they were made; beside them, where you have them, a saved mapping (.yaml) and the cell's calibration (.cal). Nothing is kept before the last step."),
      el("div", { class: "row" }, el("div", {}, el("label", { htmlFor: "recordings" }, "Recordings"), input), dropZone("or drop them here", take)), chosen, said),
    seen, rest);

  async function take(given) {
    if (!given.length) return;
    files = [...files.filter((f) => !given.some((g) => g.name === f.name)), ...given];
    mapping = null;
    await read();
  }

  async function read() {
    const mine = ++turn;
    fill(seen);
    fill(rest);
    laid = null;
    fill(chosen, files.length ? el("ol", { "aria-label": "Recordings in order" }, files.map((f, i) => el("li", {}, f.name, " ",
      i ? el("button", { class: "small", "aria-label": `${f.name} was made earlier`, onclick: () => { files.splice(i - 1, 0, ...files.splice(i, 1)); read(); } }, "earlier") : null, " ",
      el("button", { class: "small", "aria-label": `Leave ${f.name} out`, onclick: () => { files.splice(i, 1); read(); } }, "leave out")))) : null);
    if (!files.length) return fill(said);
    try {
      fill(said, quiet("Reading …"), el("progress", { "aria-label": "Reading" }));
      const packed = await Promise.all(files.map(content));
      const bytes = packed.reduce((sum, p) => sum + p.byteLength, 0);
      if (bytes > MOST_BYTES) throw new Error(`The recordings are more than ${MOST_BYTES / 2 ** 20} MB packed. Make the session of them on the command line: fingertwin new RECORDING… --out DIR`);
      sent = await Promise.all(packed.map(async (p, i) => ({ name: files[i].name, base64: await base64(p) })));
      const found = await post("/recordings/look", { files: sent, mapping, theme: theme() });
      if (mine !== turn || away.signal.aborted) return;
      fill(said);
      show(found);
    } catch (error) {
      if (mine === turn) fill(said, problem(error));
    }
  }

  function show(found) {
    const drawn = found.recordings.map((r) => {
      const place = el("div", { class: "drawn" });
      queueMicrotask(() => figure(place, async (colours) => (colours === r.figure.theme ? r.figure : (await post("/recordings/look", { files: sent, mapping, theme: colours })).recordings.find((o) => o.name === r.name).figure), {}, { signal: away.signal }));
      return [place, r.recording_notes.length ? quiet(`${r.recording_notes.join("; ")}.`) : null];
    });
    if (found.proposal) fill(seen, panel("2. Which channel is which", earlier(), proposed(found)), panel("What was recorded", drawn));
    else {
      fill(seen, panel("What was recorded", quiet("These are readings as sessions have them: nothing is to be mapped."), drawn));
      next();
    }
  }

  /** The mapping of a session that was made here of the same rig's recordings. */
  function earlier() {
    const place = el("div");
    get("/sessions", { limit: 500 }, away.signal).then(({ sessions }) => {
      if (!sessions.length) return;
      const choose = el("select", { id: "mapped-like", onchange: async () => {
        try {
          const saved = choose.value ? (await get(`${at("sessions", choose.value)}/document`)).provenance?.mapping : null;
          if (choose.value && !saved) throw new Error(`${choose.value} was not made of a recording here: it has no mapping.`);
          [mapping, like] = [saved, choose.value];
          await read();
        } catch (error) {
          notice(error);
        }
      } }, [["", "no: propose it"], ...sessions.map((s) => [s.id, s.id])].map(([v, t]) => el("option", { value: v, selected: v === like }, t)));
      fill(place, el("label", { htmlFor: "mapped-like" }, "As in an earlier session"), choose);
    }).catch(() => {});
    return place;
  }

  function proposed({ proposal, recordings, units }) {
    const first = recordings.find((r) => r.channels.length) || recordings[0];
    const names = first.channels.map((c) => c.name);
    const kind = (is) => (is === "t" ? "time" : is.startsWith("F") ? "force" : is.startsWith("T") ? "torque" : "voltage");
    const unitOf = Object.fromEntries(first.channels.map((c) => [c.name, c.unit]));
    const lines = proposal.lines.map((line) => {
      const channel = el("select", { "aria-label": `Channel of ${line.is}` },
        line.is === "t" ? el("option", { value: "", selected: !line.channel }, line.increment_s === null ? "counted at the rate of" : "counted in the file's steps") : line.channel ? null : el("option", { value: "" }, "choose"),
        names.map((n) => el("option", { value: n, selected: n === line.channel }, n)));
      const unit = el("input", { "aria-label": `Unit of ${line.is}`, value: line.unit || "", autocomplete: "off", size: 10, placeholder: "ask the rig", list: `units-${kind(line.is)}` });
      const rate = line.is === "t" && line.increment_s === null ? el("input", { "aria-label": "Sampling rate [Hz]", type: "number", min: 0, step: "any", placeholder: "rate [Hz]" }) : null;
      const fits = () => { unit.hidden = line.is === "t" && !channel.value; if (rate) rate.hidden = !unit.hidden; };
      channel.addEventListener("change", () => { unit.value = unitOf[channel.value] || ""; fits(); });
      fits();
      return { ...line, channel, unit, rate, step: () => line.increment_s ?? (Number(rate?.value) > 0 ? 1 / Number(rate.value) : null) };
    });
    const told = el("div", { role: "status", "aria-live": "polite" });
    const confirm = el("button", { class: "main", onclick: () => {
      const lacks = lines.find((l) => (l.channel.value ? !l.unit.value.trim() : l.step() === null));
      if (lacks) return fill(told, problem({ detail: lacks.channel.value ? `${lacks.is} has no unit. A unit is never assumed: look into the program that wrote the file.` : lacks.is === "t" ? "Time has no channel: choose one, or give the sampling rate." : `${lacks.is} has no channel.` }));
      const [time, ...others] = lines;
      const taken = (l) => ({ channel: l.channel.value, unit: l.unit.value.trim() });
      mapping = { ...(proposal.mapping || { format: "lab-file-map/1" }), confirmed: true, doubts: [], time: time.channel.value ? taken(time) : { increment_s: time.step() }, channels: Object.fromEntries(others.map((l) => [l.is, taken(l)])) };
      fill(told, el("p", { class: "good" }, "Confirmed. ", el("a", { href: `data:application/json,${encodeURIComponent(JSON.stringify(mapping, null, 1))}`, download: "rig.map.yaml" }, "Save the mapping"), " for the next run of the rig."));
      next();
    } }, "That is right");
    const lined = table([
      { title: "is", cell: (l) => l.is }, { title: "channel", cell: (l) => l.channel }, { title: "unit", cell: (l) => [l.unit, l.rate] },
      { title: "sure", n: true, cell: (l) => el("span", { class: l.sure < 0.8 ? "warn" : "" }, number(l.sure, 2)) }, { title: "because", wrap: true, cell: (l) => l.why },
    ], lines, { caption: proposal.saved ? "By the saved mapping" : "Proposed, not yet taken" });
    lined.classList.add("form");
    return [
      Object.entries(units).map(([name, list]) => el("datalist", { id: `units-${name}` }, list.map((u) => el("option", { value: u })))),
      lined,
      proposal.doubts.length ? [el("h3", {}, "To be settled by you"), el("ul", {}, proposal.doubts.map((d) => el("li", {}, d)))] : null,
      el("div", { class: "row" }, confirm), told,
    ];
  }

  async function next() {
    const mine = turn;
    try {
      const [fingers, sessions] = await Promise.all([get("/fingers", {}, away.signal), get("/sessions", { limit: 500 }, away.signal)]);
      if (mine !== turn) return;
      header = rig(fingers.fingers, sessions.sessions, like);
      const notes = el("textarea", { id: "notes", rows: 8, placeholder: "FDP 950, hook, tip\nFDS 950\ntare", spellcheck: false });
      const book = el("input", { id: "book", type: "file", accept: ".csv,.txt,.tsv", onchange: async () => { if (book.files[0]) notes.value = await book.files[0].text(); } });
      const below = el("div");
      const told = el("div", { role: "status", "aria-live": "polite" });
      const lay = async () => {
        const asked = (colours) => post("/recordings/lay", { files: sent, mapping, notes: notes.value, finger: header.finger(), theme: colours });
        try {
          fill(told, quiet("Laying …"), el("progress", { "aria-label": "Laying" }));
          const body = await asked(theme());
          if (mine !== turn || away.signal.aborted) return;
          fill(told);
          laid = plateaus(body, header, { signal: away.signal, draft, keep, again: asked });
          fill(below, laid.node);
        } catch (error) {
          fill(told, problem(error));
        }
      };
      fill(rest, panel("3. Finger and rig", quiet("No recording tells these."), header.node),
        panel("4. Notebook", note("What hung, line by line, in order: ", el("code", {}, "FDP 950, hook, tip"), ". What a line leaves out is as in the line before; ", el("code", {}, "x2"), " repeats; ", el("code", {}, "tare"), " and ", el("code", {}, "skip"), " say what a plateau was, ", el("code", {}, "unloading"), " and ", el("code", {}, "tapped"), " how the weight of a line came to rest. Masses in g, or as ", el("code", {}, "0.95 kg"), ". A CSV with a heading does as well."),
          el("label", { htmlFor: "notes" }, "Typed or pasted"), notes,
          el("div", { class: "row" }, el("div", {}, el("label", { htmlFor: "book" }, "or a file"), book), el("button", { class: "main", onclick: lay }, "Lay onto the plateaus")), told), below);
    } catch (error) {
      if (error.name !== "AbortError") fill(rest, problem(error));
    }
  }

  const whole = (id) => ({ files: sent, mapping, id, header: header.read(), postures_deg: laid.postures(), choices: laid.choices() });
  const draft = (id) => post("/recordings/draft", whole(id));
  const keep = (id) => post("/imports/recordings", whole(id));

  if (waiting.length) {
    const given = waiting;
    waiting = [];
    await take(given);
  }
  return { leave: () => away.abort() };
}
