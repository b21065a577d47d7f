// A token, where the service asks for one: typed once, kept in this tab alone, and sent with every request.
import { el, notice } from "./dom.js";

const KEY = "fingertwin token";
let asking = null;

export const token = () => sessionStorage.getItem(KEY);
export const bearer = () => (token() ? { Authorization: `Bearer ${token()}` } : {});

/** Of a WebSocket, which can send no header. */
export const protocols = () => (token() ? ["fingertwin", `fingertwin.bearer.${token()}`] : []);

/** Ask whoever looks on; all that waits for a token waits for the same answer. Returns whether one was given. */
export function askForToken(why) {
  asking ??= new Promise((resolve) => {
    const field = el("input", { id: "token", type: "password", autocomplete: "off", required: true, spellcheck: false });
    const done = (given) => { dialog.close(); dialog.remove(); resolve(given); };
    const form = el("form", {
      onsubmit: (event) => {
        event.preventDefault();
        sessionStorage.setItem(KEY, field.value.trim());
        done(true);
      },
    }, el("h2", { id: "token-title" }, "This service wants a token"), el("p", {}, why),
    el("p", { class: "quiet" }, "Whoever runs it makes one with: fingertwin token create NAME --role write. It stays in this tab."),
    el("label", { htmlFor: "token" }, "Token"), field,
    el("p", { class: "row" }, el("button", { class: "main", type: "submit" }, "Go on"),
      el("button", { type: "button", onclick: () => done(false) }, "Not now")));
    const dialog = el("dialog", { class: "token", "aria-labelledby": "token-title", oncancel: (event) => { event.preventDefault(); done(false); } }, form);
    document.body.append(dialog);
    dialog.showModal();
    field.focus();
  }).finally(() => { asking = null; });
  return asking;
}

/** Links to files carry no token by themselves: where there is one, the file is fetched and handed on. */
export function carryTokens() {
  addEventListener("click", async (event) => {
    const link = event.target.closest?.("a[download]");
    if (!link || !token() || !link.href.startsWith(`${location.origin}/api/`)) return;
    event.preventDefault();
    try {
      const response = await fetch(link.href, { headers: bearer() });
      if (!response.ok) throw new Error((await response.json().catch(() => null))?.detail || `The service answered ${response.status}.`);
      const named = /filename="([^"]+)"/.exec(response.headers.get("Content-Disposition") || "");
      const address = URL.createObjectURL(await response.blob());
      const hidden = el("a", { href: address, download: link.download || named?.[1] || "file" });
      document.body.append(hidden);
      hidden.click();
      hidden.remove();
      setTimeout(() => URL.revokeObjectURL(address), 60000);
    } catch (error) {
      notice(error);
    }
  });
}
