// Which controls may be used now, and why not. A button that may not be used says so, to everybody.

import { setAll } from "./dom.js";

const NOT_THERE = "not available here";
const NOT_CONNECTED = "not connected";

export class Permissions {
  constructor() {
    this.isConnected = false;
    this.isReadOnly = false;
    /** @type {Map<string, any>} */
    this.controls = new Map();
    /** @type {{button: HTMLElement, name: string, title: string, also: () => string | null}[]} */
    this.bound = [];
  }

  /** @param {any} hello */
  take(hello) {
    this.isReadOnly = hello.read_only;
    this.controls = new Map(hello.controls.map((control) => [control.name, control]));
    this.refresh();
  }

  /** @param {boolean} isConnected */
  connected(isConnected) {
    this.isConnected = isConnected;
    this.refresh();
  }

  /** Why a control may not be used; null where it may. @param {string} name */
  refusal(name) {
    if (!this.isConnected) {
      return NOT_CONNECTED;
    }
    const control = this.controls.get(name);
    if (!control) {
      return this.isReadOnly ? "read only" : NOT_THERE;
    }
    return control.permitted ? null : (control.reason ?? NOT_THERE);
  }

  /**
   * Ties a button to a control: it is dimmed with the reason while that may not be used.
   * @param {HTMLElement} button @param {string} name @param {() => void} press
   * @param {() => string | null} [also] another reason why not
   */
  bind(button, name, press, also = () => null) {
    const title = button.title || button.getAttribute("aria-label") || button.textContent.trim();
    this.bound.push({ button, name, title, also });
    button.addEventListener("click", () => {
      if ((this.refusal(name) ?? also()) === null) {
        press();
      }
    });
    this.refresh();
  }

  /** Forgets what was bound to buttons that are no longer in the page. */
  prune() {
    this.bound = this.bound.filter(({ button }) => button.isConnected);
  }

  refresh() {
    for (const { button, name, title, also } of this.bound) {
      const reason = this.refusal(name) ?? also();
      // A button that cannot be reached by keyboard could not say why.
      setAll(button, { "aria-disabled": reason === null ? null : "true", title: reason === null ? title : `${title}: ${reason}` });
    }
  }
}
