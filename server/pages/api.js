// The service's documented interface, and nothing but it.
import { askForToken, bearer } from "./token.js";

const ROUTE = /\b(GET|POST|PUT|PATCH|DELETE) \//;

/** What was found, expected and to be done, without the addresses that programs need. */
function worded(body) {
  if (!body?.detail || !ROUTE.test(body.detail)) return body?.detail;
  const [found, expected, remedy] = [body.found || body.title, body.expected, body.remedy].map((part) => (part && !ROUTE.test(part) ? part.replace(/\.$/, "") : ""));
  const said = [found, expected && `expected ${expected}`].filter(Boolean).join("; ");
  return `${said[0].toUpperCase()}${said.slice(1)}.${remedy ? ` ${remedy}.` : ""}`;
}

export class Refusal extends Error {
  constructor(status, body) {
    super(worded(body) || `The service answered ${status}.`);
    this.status = status;
    this.detail = this.message;
    this.body = body;
  }
}

export class Away extends Error {
  constructor() {
    super("The service does not answer. It is asked again by itself; nothing that you typed is lost.");
    this.detail = this.message;
  }
}

export async function ask(path, { method = "GET", body, signal } = {}) {
  const content = body === undefined ? {} : { "Content-Type": "application/json" };
  const text = body === undefined ? undefined : JSON.stringify(body);
  while (true) {
    let response;
    let said = null;
    try {
      response = await fetch(`/api/v1${path}`, { method, signal, headers: { ...content, ...bearer() }, body: text });
      if (response.status === 204) return null;
      // A page that was left, or a connection that broke, within an answer: half of it is no answer.
      said = await response.json();
    } catch (error) {
      if (error.name === "AbortError") throw error;
      if (!response || response.ok) throw new Away();
    }
    if (response.ok) return said;
    // Who gives a token goes on where the question came up.
    if (response.status !== 401 || !(await askForToken(said?.detail || "It wants a token."))) throw new Refusal(response.status, said);
  }
}

export const get = (path, query = {}, signal) => {
  const asked = Object.entries(query).filter(([, v]) => v !== null && v !== undefined && v !== "");
  const text = new URLSearchParams(asked).toString();
  return ask(text ? `${path}?${text}` : path, { signal });
};
export const post = (path, body = {}) => ask(path, { method: "POST", body });
export const put = (path, body) => ask(path, { method: "PUT", body });
export const remove = (path) => ask(path, { method: "DELETE" });
export const at = (...parts) => "/" + parts.map(encodeURIComponent).join("/");

/** Take a turn for each time that something is asked for: it tells whether no answer to a later one has come before. */
export function turns() {
  let asked = 0;
  let come = 0;
  return () => {
    const mine = ++asked;
    return () => mine >= come && Boolean(come = mine);
  };
}

/** Wait for a job, telling how far it is; survives a restart of the service. */
export async function finished(job, tell, signal) {
  let now = job;
  for (let pause = 200; ; pause = Math.min(1.4 * pause, 1500)) {
    tell(now);
    if (!["queued", "running"].includes(now.state)) return now;
    await new Promise((resolve) => setTimeout(resolve, pause));
    if (signal?.aborted) return now;
    try {
      now = await get(at("jobs", job.id), {}, signal);
    } catch (error) {
      if (!(error instanceof Away)) throw error;
    }
  }
}
