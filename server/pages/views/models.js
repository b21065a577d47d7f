// Choosing a model: the session's own finger, the revision in force, or any other.
import { at, get } from "../api.js";
import { el, fill } from "../dom.js";

export async function models(session, now, changed, signal, { id = "model", title = "Model" } = {}) {
  const select = el("select", { id, onchange: () => changed(select.value || null) });
  async function refresh() {
    const [fingers, revisions] = await Promise.all([get("/fingers", {}, signal), get(`${at("sessions", session)}/revisions`, { limit: 500 }, signal)])
      .catch(() => [{ fingers: [] }, { revisions: [] }]);
    const value = select.value || now || "";
    fill(select, el("option", { value: "" }, "the session's own finger"),
      revisions.revisions.length ? el("optgroup", { label: "Revisions" }, revisions.revisions.map((r) => el("option", { value: r.id }, named(r)))) : null,
      el("optgroup", { label: "Fingers" }, fingers.fingers.map((f) => el("option", { value: f.name }, f.name))));
    if (value && ![...select.options].some((o) => o.value === value)) select.prepend(el("option", { value }, value));
    select.value = value;
  }
  await refresh();
  const names = () => [...select.options].map((o) => o.value);
  return { node: el("div", {}, el("label", { htmlFor: id }, title), select), refresh, names, value: () => select.value || null };
}

/** A revision in a few words. */
export function named(r) {
  const change = [...r.added.map((a) => `+${a}`), ...r.removed.map((a) => `−${a}`)].join(" ") || "refit";
  return `${r.id} (${change})${r.in_force ? ", in force" : ""}`;
}
