// The bench's keys as large buttons, and on the keyboard the same letters as at its terminal.
import { Refusal, at, post } from "../api.js";
import { el, fill } from "../dom.js";

const MAIN = ["tare", "unloaded", "loaded", "confirm", "next"];
const ENDS = {
  close: ["Close the session? ", "The hidden predictions are shown then, and no case can be repeated or left out any more.", "Close it, show the predictions", "close session"],
  quit: ["Stop the bench? ", "The session stays open and nothing more is logged; at the bench's terminal, --resume goes on with it.", "Stop, and leave it open", "stop, leave open"],
};
const SAID_MS = 6000;

export class Keys {
  constructor(session, signal) {
    this.session = session;
    this.bench = null;
    this.running = false;
    this.asking = null;
    this.drawn = "";
    this.buttons = el("div", { class: "keypad", role: "group", "aria-label": "Keys of the bench" });
    this.field = el("div", { class: "asked", hidden: true });
    this.said = el("p", { class: "said", role: "status" });
    this.absent = el("p", { class: "quiet" });
    this.node = el("section", { class: "bench-keys no-print", "aria-label": "Control of the bench" }, this.field, this.buttons, this.said, this.absent);
    document.addEventListener("keydown", (event) => this.pressed(event), { signal });
  }

  /** What the bench waits for, as the live stream tells it; null where no bench can be controlled. */
  take(body) {
    this.bench = body?.connected === false ? null : body;
    this.draw();
  }

  /** Whether the bench is running at all, under control of this page or not. */
  run(running) {
    if (running === this.running) return;
    this.running = running;
    this.draw();
  }

  draw() {
    const keys = this.bench?.keys ?? [];
    this.absent.textContent = keys.length || !this.running ? "" :
      "This page shows the bench but does not control it: use the keys at its terminal. A bench is controlled from here while its log runs with --to this service.";
    const drawn = JSON.stringify(keys);
    if (drawn !== this.drawn) {
      this.drawn = drawn;
      const order = (k) => { const i = MAIN.indexOf(k.command); return i < 0 ? MAIN.length + (ENDS[k.command] ? 1 : 0) : i; };
      const held = document.activeElement?.dataset?.command;
      fill(this.buttons, [...keys].sort((a, b) => order(a) - order(b)).map((k) => el("button", {
        class: `key${MAIN.includes(k.command) ? " first" : ""}${ENDS[k.command] ? " last" : ""}`, "data-command": k.command, "aria-keyshortcuts": k.key || null, onclick: (e) => this.clicked(e, k),
      }, k.key ? el("kbd", {}, k.key) : null, el("span", {}, ENDS[k.command] ? ENDS[k.command][3] : k.title.replace(/ \(.*\)$/, "")))));
      if (held) this.at(held)?.focus();
      if (!keys.length) this.done();
    }
    for (const button of this.buttons.children) button.classList.toggle("suggested", button.dataset.command === this.bench?.suggested);
  }

  at(command) {
    return this.buttons.querySelector(`[data-command="${CSS.escape(command)}"]`);
  }

  pressed(event) {
    if (event.ctrlKey || event.metaKey || event.altKey || event.repeat || !this.bench) return;
    if (event.key === "Escape" && this.asking) { this.done(); return; }
    if (event.target.closest?.("input, textarea, select, [contenteditable]")) return;
    if (event.key === "Enter") {
      // Enter confirms, as at the terminal, unless it presses what has the focus.
      if (event.target.closest?.("button, a, summary, [role=button]")) return;
      const confirm = this.bench.keys.find((k) => k.command === "confirm");
      if (confirm) this.begin(confirm);
      return;
    }
    // At the terminal q asks whether to close or to leave open.
    const key = this.bench.keys.find((k) => (k.key || (k.command === "close" ? "q" : "")) === event.key.toLowerCase());
    if (!key) return;
    event.preventDefault();
    this.begin(key);
  }

  clicked(event, key) {
    // What a finger pressed must not be pressed again by the Enter that confirms.
    if (event.detail > 0) event.currentTarget.blur();
    this.begin(key);
  }

  begin(key) {
    if (ENDS[key.command]) this.sure(key);
    else if (key.asks) this.ask(key);
    else this.send(key, null);
  }

  /** An inline field for a key that needs a text. */
  ask(key) {
    const input = el("input", { id: "bench-text", maxLength: 500, autocomplete: "off", value: key.begins || "" });
    const form = el("form", { class: "row", onsubmit: (e) => { e.preventDefault(); this.send(key, input.value); } },
      el("div", { class: "wide" }, el("label", { htmlFor: "bench-text" }, key.asks), input), el("button", { class: "main", type: "submit" }, "Send"),
      el("button", { type: "button", onclick: () => this.done() }, "Cancel"));
    this.open(key, form);
    input.focus();
  }

  /** Ending is asked about: what closes the session shows what was hidden, and nothing can be repeated after it. */
  sure(key) {
    const others = this.bench.keys.filter((k) => ENDS[k.command] && k.command !== key.command);
    const act = (k, main) => el("button", { class: main ? "main" : "", onclick: () => this.send(k, null) }, ENDS[k.command][2]);
    const cancel = el("button", { onclick: () => this.done() }, "Cancel");
    const [question, detail] = ENDS[key.command];
    this.open(key, el("div", { class: "row", role: "group", "aria-label": question.trim() }, el("p", {}, el("strong", {}, question), detail),
      act(key, true), others.map((k) => act(k, false)), cancel));
    cancel.focus();
  }

  open(key, ...content) {
    this.asking = key.command;
    this.field.hidden = false;
    fill(this.field, content);
  }

  done() {
    const had = this.asking && this.field.contains(document.activeElement);
    const command = this.asking;
    this.asking = null;
    this.field.hidden = true;
    fill(this.field);
    if (had) this.at(command)?.focus();
  }

  async send(key, text) {
    // Another key may ask something before the answer is here: that stays open.
    const asked = this.field.firstChild;
    const answered = () => { if (this.field.firstChild === asked) this.done(); };
    this.tell(`${key.title} …`);
    try {
      await post(`${at("sessions", this.session)}/bench/commands`, { command: key.command, text: text ?? "" });
      answered();
      this.tell(`${key.title}: done`);
    } catch (error) {
      // What was typed stays.
      this.tell(error.detail || error.message, true);
      if (error instanceof Refusal && !key.asks) answered();
    }
  }

  tell(text, bad = false) {
    this.said.textContent = text;
    this.said.classList.toggle("bad", bad);
    clearTimeout(this.timer);
    this.timer = setTimeout(() => { this.said.textContent = ""; }, bad ? 3 * SAID_MS : SAID_MS);
  }

  close() {
    clearTimeout(this.timer);
  }
}
