// Fingers: the parameter sets that come with the software, for other software and out of its files.
import { at, get, post } from "../api.js";
import { el, fill, note, panel, problem, quiet, table } from "../dom.js";
import { compact, number, words } from "../format.js";
import { figuresOf, theme } from "../plot.js";

const TITLES = { finger: "finger/1 (YAML)", osim: "OpenSim (.osim)", mjcf: "MuJoCo (MJCF)" };
const MOST_BYTES = 4 * 2 ** 20;

export async function view(main, { asked }) {
  const away = new AbortController();
  const list = el("div");
  const one = el("section", { id: "finger", tabIndex: -1, "aria-label": "The finger" });
  let fingers = [];
  let now = asked.finger || null;
  fill(main, el("h1", {}, "Fingers"), panel("Parameter sets", list), one, panel("From OpenSim or MuJoCo", importing()));

  const draw = () => fill(list, table([
    { title: "name", cell: (f) => f.name }, { title: "what it is", wrap: true, cell: (f) => f.title }, { title: "tendons", wrap: true, cell: (f) => f.tendons.join(" ") },
    { title: "judged in", cell: (f) => (f.judged_in === "sagittal" ? "the sagittal plane" : "space") },
  ], fingers, { pick: (f) => { location.hash = `#/fingers?finger=${encodeURIComponent(f.name)}`; }, key: (f) => f.name, picked: now, caption: "Pick one to see its numbers and where they come from" }));

  async function show() {
    if (!now) return fill(one);
    try {
      const [finger, exported] = await Promise.all([get(at("fingers", now), {}, away.signal), get(`${at("fingers", now)}/formats`, {}, away.signal)]);
      fill(one, described(finger, exported.formats), compared(finger, fingers, away.signal), finger.moves ? moved(finger, away.signal) : null, finger.activates ? activated(finger) : null, scaled(finger));
    } catch (error) {
      if (error.name !== "AbortError") fill(one, problem(error));
    }
  }

  try {
    fingers = (await get("/fingers", {}, away.signal)).fingers;
    draw();
    await show();
  } catch (error) {
    if (error.name !== "AbortError") fill(list, problem(error));
  }
  return {
    leave: () => away.abort(),
    asked: async (given) => { now = given.finger || null; draw(); await show(); one.focus({ preventScroll: true }); one.scrollIntoView({ block: "nearest" }); },
  };
}

function described(finger, formats) {
  const document = finger.document;
  const sources = Object.entries(document.sources || {});
  const place = (p) => (p ? p.map((x) => Number(x.toPrecision(4))).join(", ") : "–");
  return [
    panel(finger.title,
      quiet(`Bones ${finger.bones.map(words).join(", ")}; angles ${finger.joints.join(", ")}. Points are in units of ${document.length_unit.value_mm} mm.`),
      el("h3", {}, "For other software"),
      el("ul", {}, formats.map((f) => el("li", {}, el("a", { href: `/api/v1${at("fingers", finger.name)}/export?format=${f.format}`, download: f.file }, TITLES[f.format]),
        f.notes.map((text) => quiet(text))))),
      el("h3", {}, "Sources"), el("ul", {}, sources.map(([name, text]) => el("li", {}, el("strong", {}, name), `: ${text}`)))),
    panel("Tendon points", table([
      { title: "joint", cell: (s) => s.joint }, { title: "tendon or slip", cell: (s) => s.slip }, { title: "proximal point (x, y, z)", cell: (s) => place(s.proximal) },
      { title: "distal point", cell: (s) => place(s.distal) }, { title: "path", cell: (s) => (s.wrap ? words(s.wrap) : "straight") }, { title: "source", cell: (s) => s.source }, { title: "certainty", cell: (s) => s.certainty },
    ], document.segments, { caption: "Each in the axes of its own bone" })),
  ];
}

function importing() {
  const said = el("div", { role: "status", "aria-live": "polite" });
  const file = el("input", { id: "foreign", type: "file", accept: ".osim,.xml,.mjcf", onchange: async () => {
    const [given] = file.files;
    file.value = "";
    if (!given) return;
    try {
      if (!/\.(osim|xml|mjcf)$/.test(given.name)) throw new Error(`${given.name} is no OpenSim or MuJoCo file by its name; expected one that ends in .osim, .xml or .mjcf. Choose such a file.`);
      if (!/^[A-Za-z0-9][A-Za-z0-9 ._()-]{0,110}$/.test(given.name)) throw new Error(`The name ${given.name} cannot be used; expected a short one of plain letters, digits, spaces and . _ - ( ). Rename the file.`);
      if (given.size > MOST_BYTES) throw new Error(`${given.name} is larger than ${MOST_BYTES / 2 ** 20} MB. Read it by the command line: fingertwin import ${given.name}`);
      fill(said, quiet(`Reading ${given.name} …`));
      const found = await post("/fingers/imports", { name: given.name, text: await given.text() });
      const link = URL.createObjectURL(new Blob([found.file], { type: "application/yaml" }));
      fill(said, el("p", { class: "good" }, `${given.name}: ${found.bones.length} bones, angles ${found.rotations.join(", ")}, ${found.segments.length} tendon segments; the clamp carries ${found.reactions.join(", ")}.`),
        el("p", {}, el("a", { class: "button", href: link, download: given.name.replace(/\.[^.]*$/, ".yaml") }, "Save as a finger file")),
        found.notes.map((text) => quiet(text)),
        note("Use it at the command line: ", el("code", {}, `fingertwin compare SESSION --model ${given.name.replace(/\.[^.]*$/, ".yaml")}`)));
    } catch (error) {
      fill(said, problem(error));
    }
  } });
  return [quiet("A chain of bones with hinges and tendon paths becomes a finger file. It is read here and given back; nothing of it is kept."),
    el("div", {}, el("label", { htmlFor: "foreign" }, "An .osim or MJCF .xml file"), file), said];
}

/** Work that is asked for by a button: what came of it, or why nothing did, below. */
function asked(title, waiting, work) {
  const place = el("div", { "aria-live": "polite" });
  const button = el("button", { onclick: async () => {
    button.disabled = true;
    fill(place, quiet(waiting), el("progress", { "aria-label": waiting }));
    try {
      fill(place, await work());
    } catch (error) {
      if (error.name === "AbortError") fill(place);
      else fill(place, problem(error));
    }
    button.disabled = false;
  } }, title);
  return { button, place };
}

const choice = (id, title, options, chosen) => el("div", {}, el("label", { htmlFor: id }, title),
  el("select", { id }, options.map((o) => el("option", { value: o, selected: o === chosen }, o))));
const chosenIn = (node) => node.querySelector("select").value;

function compared(finger, fingers, signal) {
  // Both are loaded alike, so that only fingers with the same tendons can be compared.
  const pulled = (f) => [...f.tendons].sort().join(" ");
  const others = fingers.filter((f) => f.name !== finger.name && pulled(f) === pulled(finger)).map((f) => f.name);
  if (!others.length) return panel("Beside another finger", quiet(`No other finger here has the tendons ${finger.tendons.join(" ")}. Two are compared under the same loads, so both need the same tendons.`));
  const other = choice("other", "Compare with", others, finger.name === "synek2019_optimised" ? "synek2019_bonobo" : "synek2019_optimised");
  const { button, place } = asked("Compare", "Comparing …", async () => {
    const ask = (figures) => get(`${at("fingers", finger.name)}/comparison`, { other: chosenIn(other), figures }, signal);
    const body = await ask(theme());
    const sizes = [...body.bones.map((b) => ({ ...b, name: words(b.bone) })), ...body.moment_arms.map((a) => ({ ...a, name: `arm ${a.segment}` }))];
    return [figuresOf(body, ask, signal), table([
      { title: "", cell: (r) => r.name }, { title: `${body.of.finger} [mm]`, n: true, cell: (r) => number(r.of_mm, 2) },
      { title: `${body.with.finger} [mm]`, n: true, cell: (r) => number(r.with_mm, 2) }, { title: "ratio", n: true, cell: (r) => number(r.ratio, 2) },
    ], sizes, { caption: "Bone lengths and mean flexion moment arms" }), body.assumptions.map(quiet)];
  });
  return panel("Beside another finger", el("div", { class: "row no-print" }, other, button), place);
}

function moved(finger, signal) {
  const row = el("div", { class: "row no-print" });
  const place = el("div", { "aria-live": "polite" });
  get("/movements", {}, signal).then((known) => {
    const motion = choice("motion", "Movement", known.motions);
    const muscles = choice("muscles", "Muscles", known.muscles, finger.name.replace("_index", ""));
    const own = el("input", { id: "own-motion", type: "file", accept: ".json" });
    const work = asked("Work it out", "Inverse dynamics and recruitment …", async () => {
      const document = own.files[0] ? await parsed(own.files[0]) : null;
      const body = { motion: chosenIn(motion), document, finger: finger.name, muscles: chosenIn(muscles) };
      const ask = (figures) => post(`/movements?figures=${figures}`, body);
      const found = await ask(theme());
      return [table([
        { title: "muscle", cell: (p) => p.muscle }, { title: "peak [N]", n: true, cell: (p) => number(p.peak_N, 2) }, { title: "at [s]", n: true, cell: (p) => number(p.at_s, 3) },
        { title: "of it passive [%]", n: true, cell: (p) => number(100 * p.passive_share, 0) }, { title: "over the tip force's peak", n: true, cell: (p) => number(p.over_tip_force, 2) },
      ], found.peaks, { caption: `Peaks in ${found.motion}${found.contact_s ? `; contact from ${number(found.contact_s[0], 3)} to ${number(found.contact_s[1], 3)} s` : ""}` }), figuresOf(found, ask, signal)];
    });
    fill(row, motion, muscles, el("div", {}, el("label", { htmlFor: "own-motion" }, "or your own (motion/1 as JSON)"), own), work.button);
    fill(place, work.place);
  }).catch((error) => { if (error.name !== "AbortError") fill(place, problem(error)); });
  return panel("Forces in a movement", row, place);
}

async function parsed(file) {
  try {
    return JSON.parse(await file.text());
  } catch {
    throw new Error(`${file.name} is not JSON. A movement in YAML is worked out at the command line: fingertwin move ${file.name}`);
  }
}

function scaled(finger) {
  const bones = finger.bones.slice(1);
  const inputs = bones.map((b) => el("input", { id: `bone-${b}`, type: "number", min: "1", max: "1000", step: "0.1", inputMode: "decimal" }));
  const name = el("input", { id: "scaled-name", value: "scaled", autocomplete: "off", pattern: "[A-Za-z0-9][A-Za-z0-9._\\-]{0,59}" });
  const { button, place } = asked("Scale", "Scaling …", async () => {
    const bones_mm = Object.fromEntries(bones.map((b, i) => [b, inputs[i].valueAsNumber]).filter(([, x]) => Number.isFinite(x)));
    const found = await post(`${at("fingers", finger.name)}/scalings`, { bones_mm, name: name.value.trim() });
    const link = URL.createObjectURL(new Blob([found.file], { type: "application/yaml" }));
    return [el("p", {}, el("a", { class: "button", href: link, download: `${found.finger}.yaml` }, "Save as a finger file")),
      table([{ title: "bone", cell: (b) => b.bone }, { title: "before [mm]", n: true, cell: (b) => number(b.before_mm, 2) }, { title: "after [mm]", n: true, cell: (b) => number(b.after_mm, 2) },
        { title: "factor", n: true, cell: (b) => number(b.factor, 3) }, { title: "", cell: (b) => b.how }], found.bones, { caption: "Bones" }),
      table([{ title: "tendon", cell: (a) => a.segment }, { title: "mean arm before [mm]", n: true, cell: (a) => compact(a.mean_before_mm) }, { title: "after [mm]", n: true, cell: (a) => compact(a.mean_after_mm) }], found.moment_arms, { caption: `Flexion moment arms over the postures of ${found.postures_of}` }),
      found.assumptions.map(quiet)];
  });
  return panel("Scale it to a specimen", quiet("Lengths that are left out follow the mean of the others. The file names the factor and the source of every number."),
    el("div", { class: "row no-print" }, bones.map((b, i) => el("div", {}, el("label", { htmlFor: `bone-${b}` }, `${words(b)} [mm]`), inputs[i])), el("div", {}, el("label", { htmlFor: "scaled-name" }, "Name"), name), button), place);
}

function activated(finger) {
  const muscles = finger.tendons;
  const lost = choice("lost", "Muscle that loses activation", ["none", ...muscles], "none");
  const share = el("input", { id: "share", type: "number", min: "0", max: "100", step: "5", value: "50", inputMode: "decimal" });
  const { button, place } = asked("Activate all muscles", "Isometric equilibrium …", async () => {
    const which = chosenIn(lost);
    if (which !== "none" && !(share.valueAsNumber >= 0 && share.valueAsNumber <= 100)) {
      throw new Error(`${share.value === "" ? "No loss" : `A loss of ${share.value} %`} is given for ${which}; expected 0 to 100 %. Give such a number.`);
    }
    const body = { finger: finger.name, lost: which === "none" ? {} : { [which]: share.valueAsNumber / 100 } };
    const ask = (figures) => post(`/activations?figures=${figures}`, body);
    const found = await ask(theme());
    const change = (d, i) => `${number(d.magnitude_N[i], 1)} (${number(d.direction_change_deg[i], 0)}°)`;
    return [
      el("p", { class: "verdict" }, `Tip force ${number(found.magnitude_N, 1)} N with all muscles fully active.`),
      found.together ? el("p", {}, `With ${number(found.together.lost_pct[which], 0)} % of ${which} lost: ${number(found.together.magnitude_N, 1)} N, turned by ${number(found.together.direction_change_deg, 0)}°.`) : null,
      found.activation_notes.map(quiet),
      table([{ title: "muscle", cell: (d) => d.muscle }, ...[0, 1, 2, 3, 4].map((i) => ({ title: `${found.deficits[0].levels_pct[i]} %`, n: true, cell: (d) => change(d, i) }))],
        found.deficits, { caption: "Tip force [N] while one muscle loses activation, and by how much it turns" }),
      figuresOf(found, ask),
    ].flat().filter(Boolean);
  });
  return panel("Muscles at isometric equilibrium", quiet("The finger is held at its tip; each muscle pulls as its length and elastic tendon allow."), el("div", { class: "row no-print" }, lost, el("div", {}, el("label", { htmlFor: "share" }, "by [%]"), share), button), place);
}
