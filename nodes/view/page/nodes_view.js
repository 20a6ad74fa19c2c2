// How the nodes fare, by their own diagnostics.

import { byId, el, keyed, setAll, setText } from "./dom.js";

const LEVELS = {
  ok: ["●", "well"],
  warn: ["▲", "warns"],
  error: ["✕", "has failed"],
  stale: ["○", "is silent"],
};
/** Values that are shown without being asked for. */
const FIRST = 3;

function make() {
  const values = el("dl");
  return el("li", {}, el("details", {}, el("summary", {}, el("i", { "aria-hidden": "true" }), el("b"), el("span", { class: "level" }), el("span", { class: "said" })), values));
}

function update(item, node) {
  const details = item.firstElementChild;
  const [mark, name, level, said] = details.firstElementChild.children;
  const [sign, word] = LEVELS[node.level] ?? LEVELS.stale;
  setAll(item, { class: node.level });
  setText(mark, sign);
  setText(name, node.name);
  setText(level, word);
  const values = Object.entries(node.values ?? {});
  const some = values.slice(0, FIRST).map(([key, value]) => `${key} ${value}`).join(" · ");
  setText(said, node.level === "ok" ? some : node.message || some);
  if (details.open) {
    const makeValue = () => el("div", {}, el("dt"), el("dd"));
    keyed(details.lastElementChild, values, ([key]) => key, makeValue, (entry, [key, value]) => {
      setText(entry.children[0], key);
      setText(entry.children[1], value);
    });
  }
}

/** @param {any} status */
export function showNodes(status) {
  const nodes = status.nodes ?? [];
  const bad = nodes.filter(({ level }) => level !== "ok").length;
  setText(byId("nodes-note"), nodes.length === 0 ? "none has reported yet" : `${nodes.length} report, ${bad === 0 ? "all well" : `${bad} not well`}`);
  keyed(byId("nodes"), nodes, ({ name }) => name, make, update);
}
