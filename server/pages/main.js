// Which page is shown: the address after # says it.
import { carryTokens } from "./token.js";
import { Live } from "./live.js";
import { el, fill, problem } from "./dom.js";

const VIEWS = {
  bench: ["Bench", () => import("./views/bench.js")],
  compare: ["Compare", () => import("./views/compare.js")],
  forces: ["Forces", () => import("./views/forces.js")],
  find: ["Find the missing effect", () => import("./views/find.js")],
  fall: ["The fall of the error", () => import("./views/fall.js")],
};
// Pages of a session that others lead to.
const INNER = {
  effect: ["An effect", () => import("./views/effect.js"), "find"],
  report: ["Report", () => import("./views/report.js"), "fall"],
};
// Pages of no session: the third is the name in the menu, without which the list of sessions leads there.
const OTHERS = {
  "": ["Sessions", () => import("./views/sessions.js"), "Sessions"],
  new: ["New session from a recording", () => import("./views/new.js")],
  together: ["Several sessions together", () => import("./views/together.js"), "Together"],
  fingers: ["Fingers", () => import("./views/fingers.js"), "Fingers"],
  studies: ["Published studies", () => import("./views/studies.js"), "Studies"],
  audit: ["Who changed what", () => import("./views/audit.js"), "Changes"],
  help: ["Help", () => import("./views/help.js"), "Help"],
};
// Left out of the menu in a session, whose own pages fill it.
const ELSEWHERE = ["audit"];

let shown = null;
let live = null;
const main = document.getElementById("main");

function where() {
  const [path, query] = location.hash.replace(/^#\/?/, "").split("?");
  let parts = [path];
  // What cannot be decoded names no page.
  try { parts = path.split("/").map(decodeURIComponent); } catch { /* left as it is */ }
  const asked = Object.fromEntries(new URLSearchParams(query || ""));
  if (parts[0] === "sessions" && parts[1]) return { session: parts[1], view: parts[2] || "compare", asked };
  return { session: null, view: parts[0] || "", asked };
}

function navigation({ session, view }) {
  const link = (href, title, current) => el("a", { href, "aria-current": current ? "page" : null }, title);
  const now = OTHERS[view] && !OTHERS[view][2] ? "" : view;
  const [sessions, ...others] = Object.entries(OTHERS).filter(([name, [, , title]]) => title && !(session && ELSEWHERE.includes(name)))
    .map(([name, [, , title]]) => link(`#/${name}`, title, !session && name === now));
  fill(document.getElementById("nav"), sessions,
    session ? Object.entries(VIEWS).map(([name, [title]]) =>
      link(`#/sessions/${encodeURIComponent(session)}/${name}`, title, name === (INNER[view]?.[2] || view))) : null,
    others);
}

export function linkState(text, away = false) {
  const place = document.getElementById("link");
  if (place.textContent === text) return;
  place.textContent = text;
  place.classList.toggle("away", away);
}

function listen(session) {
  if (live?.session === session) return;
  live?.close();
  live = new Live(session, (message) => shown?.hear?.(message), (state, detail) => {
    if (state === "live") linkState(session ? `live: ${session}` : "live");
    else if (state === "away") linkState("The service does not answer; trying again …", true);
    else linkState(detail, true);
    shown?.link?.(state);
  });
}

async function show() {
  const here = where();
  shown?.leave?.();
  shown = null;
  navigation(here);
  listen(here.session);
  const found = here.session ? VIEWS[here.view] || INNER[here.view] : OTHERS[here.view];
  if (!found) {
    document.title = "fingertwin";
    fill(main, el("h1", {}, "There is no such page"), el("p", {}, el("a", { href: "#/" }, "To the sessions")));
    return;
  }
  document.title = `${here.session ? `${here.session}: ` : ""}${found[0]} – fingertwin`;
  fill(main, el("p", { class: "quiet" }, "Loading …"));
  try {
    const { view } = await found[1]();
    if (where().session !== here.session || where().view !== here.view) return;
    fill(main);
    const made = await view(main, here);
    if (where().session !== here.session || where().view !== here.view) made?.leave?.();
    else shown = made;
  } catch (error) {
    if (error.name === "AbortError") return;
    fill(main, el("h1", {}, found[0]), problem(error),
      el("p", {}, el("button", { onclick: show }, "Try again"), " ", el("a", { href: "#/" }, "To the sessions")));
  }
}

let before = "";
addEventListener("hashchange", () => {
  const here = where();
  const name = `${here.session}/${here.view}`;
  if (name === before && shown?.asked) shown.asked(here.asked);
  else show();
  before = name;
  main.focus({ preventScroll: true });
});
before = `${where().session}/${where().view}`;
carryTokens();
show();
