// The overlay behind the question mark.

import { byId } from "./dom.js";

/** Opens and closes the help. */
export function toggleHelp() {
  const dialog = byId("help");
  if (dialog.open) {
    dialog.close();
  } else {
    dialog.showModal();
    dialog.scrollTop = 0;
  }
}

export function startHelp() {
  const dialog = byId("help");
  byId("help-open").addEventListener("click", toggleHelp);
  byId("help-close").addEventListener("click", () => dialog.close());
  // A click beside it closes it too.
  dialog.addEventListener("click", (event) => {
    if (event.target === dialog) {
      dialog.close();
    }
  });
}
