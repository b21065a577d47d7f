// The live WebSocket: kept messages once and in order, also across a restart of the service.
import { protocols } from "./token.js";

export class Live {
  constructor(session, hear, state) {
    this.session = session;
    this.hear = hear;
    this.state = state;
    this.after = null;
    this.ended = false;
    this.pause = 500;
    this.open();
  }

  open() {
    const asked = new URLSearchParams({ rate_hz: "30" });
    if (this.session) asked.set("session", this.session);
    if (this.after !== null) asked.set("after", String(this.after));
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    this.socket = new WebSocket(`${scheme}://${location.host}/api/v1/live?${asked}`, protocols());
    this.socket.onmessage = (event) => {
      for (const message of JSON.parse(event.data)) this.take(message);
    };
    this.socket.onclose = (event) => {
      if (this.ended) return;
      if (event.code === 4404 || event.code === 4422) {
        this.state("refused", event.reason);
        return;
      }
      this.state("away");
      setTimeout(() => { if (!this.ended) this.open(); }, this.pause);
      this.pause = Math.min(2 * this.pause, 8000);
    };
  }

  take(message) {
    if (message.kind === "hello") {
      this.pause = 500;
      if (this.after === null || message.another_database) this.after = message.latest;
      this.state("live", message);
    } else if (message.kind === "resume") {
      this.after = message.after;
    } else if (message.id) {
      this.after = message.id;
    }
    this.hear(message);
  }

  close() {
    this.ended = true;
    this.socket.close();
  }
}
