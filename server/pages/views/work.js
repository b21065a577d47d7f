// A job that is waited for: its progress, its stage, cancelled at any time; it goes on across a restart of the service.
import { at, finished, post } from "../api.js";
import { el, fill, notice, problem, quiet } from "../dom.js";

/** Wait for a job in a place; returns it where it is done, else null with the reason shown. */
export async function awaited(place, asked, title, signal, again) {
  try {
    fill(place, quiet(`${title} …`));
    const job = await asked;
    const bar = el("progress", { max: 1, value: 0, "aria-label": title });
    const told = el("p", {});
    const stop = el("button", { onclick: () => { stop.disabled = true; post(`${at("jobs", job.id)}/cancel`).catch(notice); } }, "Cancel");
    fill(place, told, bar, stop);
    const done = await finished(job, (now) => {
      bar.value = now.progress;
      const text = now.state === "queued" ? `${title}: waiting for a free worker …`
        : `${title}: ${now.stage || (now.progress < 0.02 ? "the first time on a machine the models are compiled, up to a minute" : now.state)} (${Math.round(100 * now.progress)} %)`;
      if (told.textContent !== text) told.textContent = text;
    }, signal);
    if (signal?.aborted) return null;
    const retry = again ? el("button", { onclick: again }, "Try again") : null;
    if (done.state === "failed") fill(place, problem(done.problem || { detail: `${title} failed.` }), retry);
    else if (done.state === "cancelled") fill(place, el("p", { role: "status" }, `${title}: cancelled. `), retry);
    else fill(place);
    return done.state === "done" ? done : null;
  } catch (error) {
    if (error.name !== "AbortError") fill(place, problem(error), again ? el("button", { onclick: again }, "Try again") : null);
    return null;
  }
}
