// Keyboard shortcuts. They rest while somebody writes, and while the help is open but for the key that closes it.

import { byId } from "./dom.js";

const WRITING = new Set(["INPUT", "SELECT", "TEXTAREA"]);

/** @param {Record<string, () => void>} actions by key */
export function startKeys(actions) {
  document.addEventListener("keydown", (event) => {
    const isHeld = event.ctrlKey || event.metaKey || event.altKey;
    const action = actions[event.key];
    const isPress = event.target.tagName === "BUTTON" && event.key === " ";
    if (!action || isHeld || isPress || event.repeat || WRITING.has(event.target.tagName) || (byId("help").open && event.key !== "?")) {
      return;
    }
    event.preventDefault();
    action();
  });
}
