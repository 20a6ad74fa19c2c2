// The conversation with the server: one WebSocket, opened again with growing pauses when it breaks.

/** Pauses between tries, ms. */
const PAUSE_MS = { first: 400, longest: 5000, factor: 1.7 };
/** A reply that does not come within this time counts as lost, ms. */
const REPLY_MS = 20_000;

/** @typedef {"connecting" | "open" | "lost"} Condition */

export class Connection {
  /**
   * @param {{message: (message: any) => void, picture: (header: any, bytes: Uint8Array) => void,
   *   condition: (condition: Condition, reason: string) => void}} handlers
   */
  constructor(handlers) {
    this.handlers = handlers;
    this.pause = PAUSE_MS.first;
    this.subscription = null;
    this.calls = new Map();
    this.number = 0;
    this.#open();
  }

  #open() {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    // The token, where one is needed, stands in the page's own address.
    const token = new URLSearchParams(location.search).get("token");
    const query = token === null ? "" : `?token=${encodeURIComponent(token)}`;
    const socket = new WebSocket(`${scheme}://${location.host}/ws${query}`);
    socket.binaryType = "arraybuffer";
    this.socket = socket;
    socket.addEventListener("open", () => this.#send(this.subscription));
    socket.addEventListener("message", ({ data }) => this.#hear(data));
    socket.addEventListener("close", ({ reason }) => this.#lost(reason));
  }

  #hear(data) {
    if (typeof data !== "string") {
      const size = new DataView(data).getUint32(0, true);
      const header = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, size)));
      this.handlers.picture(header, new Uint8Array(data, 4 + size));
      return;
    }
    const message = JSON.parse(data);
    if (message.type === "hello") {
      this.pause = PAUSE_MS.first;
      this.handlers.condition("open", "");
    }
    if (message.type === "reply") {
      this.#settle(message.id, message);
    } else {
      this.handlers.message(message);
    }
  }

  #lost(reason) {
    for (const id of [...this.calls.keys()]) {
      this.#settle(id, { ok: false, message: "the connection was lost" });
    }
    this.handlers.condition("lost", reason);
    setTimeout(() => this.#open(), this.pause * (0.8 + 0.4 * Math.random()));
    this.pause = Math.min(PAUSE_MS.longest, this.pause * PAUSE_MS.factor);
  }

  #settle(id, reply) {
    const call = this.calls.get(id);
    if (call) {
      clearTimeout(call.timer);
      this.calls.delete(id);
      call.resolve(reply);
    }
  }

  /** Says what is to be sent from now on, also over the connections to come. */
  subscribe(channels, feeder) {
    const subscription = { type: "subscribe", channels, feeder };
    if (JSON.stringify(subscription) !== JSON.stringify(this.subscription)) {
      this.subscription = subscription;
      this.#send(subscription);
    }
  }

  /**
   * Asks for something; always resolves.
   * @param {string} name of the control @param {string | null} feeder null for what concerns the whole run
   * @param {Record<string, any>} values its arguments
   * @returns {Promise<{ok: boolean, message: string | null, result?: any}>}
   */
  control(name, feeder, values = {}) {
    this.number += 1;
    const id = this.number;
    return new Promise((resolve) => {
      const timer = setTimeout(() => this.#settle(id, { ok: false, message: "no reply came" }), REPLY_MS);
      this.calls.set(id, { resolve, timer });
      const message = { type: "control", id, name, arguments: values };
      if (!this.#send(feeder === null ? message : { ...message, feeder })) {
        this.#settle(id, { ok: false, message: "not connected" });
      }
    });
  }

  #send(message) {
    const isOpen = message && this.socket.readyState === WebSocket.OPEN;
    if (isOpen) {
      this.socket.send(JSON.stringify(message));
    }
    return isOpen;
  }
}
