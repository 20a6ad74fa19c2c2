// What is wrong, in front of everything else: faults, warnings, and what is shown that cannot be trusted.

import { byId, el, keyed, setAll, setText } from "./dom.js";

/** States of a feeder in the terms of PackML that somebody should know of. */
const REASONS = {
  starved: "No fitting part comes: load parts, or ask for another pose",
  waiting_for_handover: "A part waits under a station to be taken",
  waiting_for_area: "Another agent is in the way on the platen",
  badly_fed: "Parts do not move as the waveform should move them",
  unrecognised: "Much lies on the plateau and nothing of it is recognised",
  fault: "Broken",
};
const PROMINENT = new Set(["starved", "badly_fed", "unrecognised", "fault"]);

/** @param {any} frame @param {any} status @returns {{key: string, isFault: boolean, who: string, text: string}[]} */
function found(frame, status) {
  const all = [];
  for (const [name, feeder] of Object.entries(frame?.feeders ?? {})) {
    const add = (kind, isFault, text) => text && all.push({ key: `${name} ${kind}`, isFault, who: name, text });
    add("courier", true, feeder.courier_state?.fault);
    // The planner says again what it has from the courier.
    add("delivery", true, feeder.courier_state?.fault ? null : feeder.delivery?.fault);
    add("warning", false, feeder.courier_state?.warning);
    add("scenario", false, status?.feeders?.[name]?.mismatch);
    const state = status?.feeders?.[name]?.state;
    if (state && PROMINENT.has(state.reason) && !feeder.courier_state?.fault && !feeder.delivery?.fault) {
      add("state", state.reason === "fault", state.message || REASONS[state.reason]);
    }
    const stranded = status?.feeders?.[name]?.metrics?.stranded;
    add("stranded", false, stranded ? `${stranded} ${stranded === 1 ? "part lies" : "parts lie"} where the waveform cannot move ${stranded === 1 ? "it" : "them"} on` : "");
  }
  for (const node of status?.nodes ?? []) {
    const isSaid = all.some(({ isFault, text }) => isFault && text === node.message);
    if (node.level === "stale" || (node.level === "error" && !isSaid)) {
      const text = node.level === "stale" ? "has said nothing for more than three seconds" : node.message;
      all.push({ key: `node ${node.name}`, isFault: node.level === "error", who: node.name, text });
    }
  }
  return all;
}

/** Shows what is wrong now. */
export function showAlerts(frame, status) {
  const make = () => el("li", {}, el("b"), el("span"));
  keyed(byId("alerts"), found(frame, status), ({ key }) => key, make, (item, { isFault, who, text }) => {
    setAll(item, { class: isFault ? "fault" : "warning" });
    setText(item.children[0], `${isFault ? "✕ Fault" : "⚠ Warning"} · ${who}`);
    setText(item.children[1], text);
  });
}

/** What a feeder's state means, for people. @param {any} state of a status message */
export const reasonOf = (state) => state?.message || REASONS[state?.reason] || "";
