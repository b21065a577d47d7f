// Choosing a model: the session's own finger, the revision in force, or any other.
import { at, get } from "../api.js";
import { el, fill } from "../dom.js";

export async function models(session, now, changed) {
  const select = el("select", { id: "model", onchange: () => changed(select.value || null) });
  async function refresh() {
    const [fingers, revisions] = await Promise.all([get("/fingers"), get(`${at("sessions", session)}/revisions`, { limit: 500 })]).catch(() => [{ fingers: [] }, { revisions: [] }]);
    const value = select.value || now || "";
    fill(select, el("option", { value: "" }, "the session's own finger"),
      revisions.revisions.length ? el("optgroup", { label: "Revisions" }, revisions.revisions.map((r) =>
        el("option", { value: r.id, selected: r.id === value }, `${r.id}${r.added.length ? ` (+${r.added.join(", +")})` : " (refit)"}${r.in_force ? ", in force" : ""}`))) : null,
      el("optgroup", { label: "Fingers" }, fingers.fingers.map((f) => el("option", { value: f.name, selected: f.name === value }, f.name))));
  }
  await refresh();
  return { node: el("div", {}, el("label", { htmlFor: "model" }, "Model"), select), refresh, value: () => select.value || null };
}
