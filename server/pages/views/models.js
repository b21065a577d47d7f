// Choosing a model: the session's own finger, the revision in force, or any other.
import { at, get } from "../api.js";
import { el, fill, keep } from "../dom.js";
import { refitName } from "../format.js";

export async function models(session, now, changed, signal, { id = "model", title = "Model" } = {}) {
  const select = el("select", { id, onchange: chosen });
  function chosen() {
    keep({ model: select.value });
    changed(select.value || null);
  }
  async function refresh() {
    const [fingers, revisions] = await Promise.all([get("/fingers", {}, signal), get(`${at("sessions", session)}/revisions`, { limit: 500 }, signal)])
      .catch(() => [{ fingers: [] }, { revisions: [] }]);
    const value = select.value || now || "";
    fill(select, el("option", { value: "" }, "the session's own finger"),
      revisions.revisions.length ? el("optgroup", { label: "Revisions" }, revisions.revisions.map((r) => el("option", { value: r.id }, named(r)))) : null,
      el("optgroup", { label: "Fingers" }, fingers.fingers.map((f) => el("option", { value: f.name }, f.name))));
    // A refit of a search stands beside the other one of the same search, with and without what it would add.
    if (value.includes("/")) {
      const fits = [...new Set([`${value.split("/")[0]}/nothing`, value])];
      select.append(el("optgroup", { label: "Refits of a search" }, fits.map((f) => el("option", { value: f }, refitName(f)))));
    } else if (value && ![...select.options].some((o) => o.value === value)) select.prepend(el("option", { value }, value));
    select.value = value;
  }
  await refresh();
  const names = () => [...select.options].map((o) => o.value);
  const choose = async (name) => { select.value = ""; now = name; await refresh(); };
  return { node: el("div", {}, el("label", { htmlFor: id }, title), select), refresh, names, choose, value: () => select.value || null };
}

/** A revision in a few words. */
export function named(r) {
  const change = [...r.added.map((a) => `+${a}`), ...r.removed.map((a) => `−${a}`)].join(" ") || "refit";
  return `${r.id} (${change})${r.in_force ? ", in force" : ""}`;
}
