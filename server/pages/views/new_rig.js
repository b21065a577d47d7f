// What no recording tells of a session: specimen, finger, friction, cell and its mounts.
import { at, get } from "../api.js";
import { el, notice } from "../dom.js";

const field = (title, node) => el("div", {}, el("label", { htmlFor: node.id }, title), node);
const options = (list, chosen) => list.map(([value, title]) => el("option", { value, selected: value === chosen }, title ?? value));

/** The form, filled from an earlier session where one is given. */
export function rig(fingers, sessions, from) {
  const own = (id, given = {}) => el("input", { id, autocomplete: "off", ...given });
  const specimen = own("specimen", { maxLength: 100, required: true, placeholder: "a pseudonym" });
  const species = own("species", { value: "human" });
  const digit = own("digit", { value: "third" });
  const side = el("select", { id: "side", required: true }, options([["", "choose"], ["left"], ["right"]], ""));
  const finger = el("select", { id: "finger-of" }, options(fingers.map((f) => [f.name]), "an1979_middle"));
  const friction = own("friction", { required: true, placeholder: "0.835", size: 10, pattern: "estimate|[01]?[.,]?[0-9]*" });
  const cell = own("cell", { placeholder: "ATI Nano17 SI-25-0.25" });
  const rate = own("rate", { type: "number", min: 0, step: "any", placeholder: "not known" });
  const frames = { tip: own("frame-tip", { value: "distal_phalanx" }), bone: own("frame-bone", { value: "metacarpal" }) };
  const turned = { tip: own("turned-tip", { placeholder: "0 90 0" }), bone: own("turned-bone", { placeholder: "0 90 0" }) };
  let known = {};
  const fingerNow = () => fingers.find((f) => f.name === finger.value);

  const like = el("select", { id: "like", onchange: () => fillIn() }, options([["", "none"], ...sessions.map((s) => [s.id])], from || ""));

  async function fillIn() {
    if (!like.value) return;
    try {
      const document = await get(`${at("sessions", like.value)}/document`);
      const of = document.specimen;
      [specimen.value, species.value, digit.value, side.value] = [of.id, of.species, of.digit, of.side];
      if (fingers.some((f) => f.name === document.finger)) finger.value = document.finger;
      friction.value = typeof document.tension_factor === "number" ? String(document.tension_factor) : "estimate";
      cell.value = document.load_cell?.model || "";
      rate.value = document.load_cell?.rate_hz || "";
      for (const [place, mount] of Object.entries(document.load_cell?.mounts || {})) {
        if (mount.frame) frames[place].value = mount.frame;
        turned[place].value = (mount.rotation_deg || []).join(" ");
      }
      known = document.postures_deg;
    } catch (error) {
      notice(error);
    }
  }

  const angles = (text) => text.trim().split(/[\s,;]+/).map(Number);

  function read() {
    const lacks = [[specimen, "the specimen's pseudonym"], [side, "the side of the hand"]].find(([node]) => !node.value.trim());
    if (lacks) { lacks[0].focus(); throw new Error(`${lacks[1][0].toUpperCase()}${lacks[1].slice(1)} is not given.`); }
    const factor = friction.value.trim().replace(",", ".");
    if (factor !== "estimate" && !(Number(factor) > 0 && Number(factor) <= 1.5)) { friction.focus(); throw new Error("Friction is a factor above 0 and up to 1.5, or the word estimate."); }
    const mounts = {};
    for (const place of ["tip", "bone"]) {
      mounts[place] = { frame: frames[place].value.trim() };
      if (!turned[place].value.trim()) continue;
      mounts[place].rotation_deg = angles(turned[place].value);
      if (mounts[place].rotation_deg.length !== 3 || mounts[place].rotation_deg.some(Number.isNaN)) { turned[place].focus(); throw new Error(`The cell's rotation at the ${place} is three angles in degrees.`); }
    }
    return {
      specimen: { id: specimen.value.trim(), species: species.value.trim(), digit: digit.value.trim(), side: side.value }, finger: finger.value,
      tension_factor: factor === "estimate" ? { estimate: "force_balance" } : Number(factor),
      load_cell: { mounts, ...(cell.value.trim() ? { model: cell.value.trim() } : {}), ...(Number(rate.value) > 0 ? { rate_hz: Number(rate.value) } : {}) },
    };
  }

  const node = [
    el("div", { class: "row" }, field("As in an earlier session", like), field("Finger", finger)),
    el("div", { class: "row" }, field("Specimen", specimen), field("Species", species), field("Digit", digit), field("Side of the hand", side)),
    el("div", { class: "row" }, field("Friction: a factor, or estimate", friction), field("Model of the load cell", cell), field("Sampling rate [Hz]", rate)),
    el("div", { class: "row" }, field("At the tip, axes of (proposed: as usual)", frames.tip), field("turned by x y z [deg], if known", turned.tip), field("At the bone, axes of (proposed: as usual)", frames.bone), field("turned by x y z [deg], if known", turned.bone)),
  ];
  if (from) fillIn();
  return { node, read, finger: () => finger.value, joints: () => fingerNow()?.joints || [], known: () => known, specimen: () => specimen.value.trim() };
}
