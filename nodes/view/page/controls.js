// The forms that call the feeder's services, made from what the server says may be asked, and in which range.

import { byId, el, setAll, setText } from "./dom.js";
import { significant } from "./format.js";

/** The controls in the order in which they are shown; what is not named here belongs to the bar at the top. */
const FORMS = [
  { name: "load_parts", title: "Load parts", button: "Load" },
  { name: "set_feeding", title: "Feeding", button: "Switch" },
  { name: "set_waveform", title: "Waveform", button: "Apply" },
  { name: "deliver", title: "Ask for a delivery", button: "Ask", isMain: true },
  { name: "hand_over", title: "Report the hand-over", button: "Report" },
  { name: "cancel", title: "Cancel the delivery asked for here", button: "Cancel" },
  { name: "reset_fault", title: "End the courier's fault", button: "Reset" },
  { name: "reset_planner", title: "End the planner's fault", button: "Reset" },
];

/** Arguments as people know them: a name, a unit, and by what a value is multiplied to be shown. */
const ARGUMENTS = {
  count: { label: "count" },
  enabled: { label: "on" },
  scale: { label: "acceleration", unit: "× first" },
  period_s: { label: "period", unit: "ms", factor: 1e3 },
  station: { label: "station" },
  pose_class: { label: "pose" },
  tolerance_m: { label: "tolerance", unit: "mm", factor: 1e3 },
  timeout_s: { label: "give up after", unit: "s" },
  taken: { label: "taken" },
};

export class Controls {
  /** @param {import("./permissions.js").Permissions} permissions @param {import("./connection.js").Connection} connection */
  constructor(permissions, connection) {
    this.permissions = permissions;
    this.connection = connection;
    this.focus = null;
    this.waveform = el("p", { class: "quiet" });
  }

  /** Makes the forms anew. @param {any} hello @param {string} focus name of the feeder that is looked at */
  build(hello, focus) {
    this.focus = focus;
    const known = new Map(hello.controls.map((control) => [control.name, control]));
    const forms = FORMS.filter(({ name }) => known.has(name)).map((form) => this.#form(form, known.get(form.name)));
    byId("controls").replaceChildren(...forms);
    const reasons = new Set(hello.controls.map(({ permitted, reason }) => (permitted ? null : reason)));
    const isShut = reasons.size === 1 && !reasons.has(null);
    const why = hello.read_only ? "Read only: this page shows, and changes nothing." : `Nothing can be changed: ${[...reasons][0]}.`;
    setText(byId("controls-note"), hello.read_only || isShut ? why : "");
    this.permissions.prune();
  }

  #form(form, control) {
    const fields = control.arguments.map((argument) => field(argument, control.permitted));
    const answer = el("output", { class: "answer", role: "status" });
    const button = el("button", { type: "button", class: form.isMain ? "main" : false }, form.button);
    const refused = el("p", { class: "refused" }, control.permitted ? "" : (control.reason ?? ""));
    const ask = async () => {
      const wrong = fields.find(({ input }) => !input.checkValidity());
      fields.forEach(({ input }) => setAll(input, { "aria-invalid": input.checkValidity() ? null : "true" }));
      if (wrong) {
        say(answer, false, `${wrong.label}: ${wrong.input.validationMessage}`);
        return;
      }
      const values = Object.fromEntries(fields.map(({ name, read }) => [name, read()]).filter(([, value]) => value !== undefined));
      setText(answer, "…");
      const reply = await this.connection.control(form.name, this.focus, values);
      say(answer, reply.ok, reply.message ?? (reply.ok ? "done" : "refused"));
    };
    const made = el("form", { class: "control", "data-control": form.name },
      el("h3", {}, form.title),
      ...(form.name === "set_waveform" ? [this.waveform] : []),
      el("div", { class: "fields" }, ...fields.map(({ element }) => element), button), refused, answer);
    made.addEventListener("submit", (event) => {
      event.preventDefault();
      button.click();
    });
    this.permissions.bind(button, form.name, ask);
    return made;
  }

  /** @param {any} message the waveform that runs */
  showWaveform(message) {
    const isTurn = message.axis === "yaw";
    const peak = `${significant(message.acceleration_peak)} ${isTurn ? "rad/s²" : "m/s²"}`;
    const speed = `${significant(message.velocity_peak)} ${isTurn ? "rad/s" : "m/s"}`;
    setText(this.waveform, `${message.name.replaceAll("_", " ")}, ${significant(message.period_s * 1e3)} ms, at most ${peak} and ${speed}; ${message.enabled ? "running" : "off"}`);
  }
}

function say(answer, isGood, text) {
  setAll(answer, { class: `answer ${isGood ? "good" : "bad"}` });
  setText(answer, `${isGood ? "✓" : "✕"} ${text}`);
}

/** A field for an argument, with its range beside it. */
function field(argument, isPermitted) {
  const { name: key, type, min, max, choices, optional } = argument;
  const { label = key.replaceAll("_", " "), unit = argument.unit ?? "", factor = 1 } = ARGUMENTS[key] ?? {};
  const shown = (value) => (value === undefined || value === null ? "" : String(Number((value * factor).toPrecision(6))));
  const disabled = !isPermitted;
  if (type === "choice") {
    const input = el("select", { disabled }, ...(optional ? [el("option", { value: "" }, "any")] : []), ...choices.map((choice) => el("option", { value: choice, selected: choice === argument.default }, choice)));
    return made(key, label, input, "", () => input.value || undefined);
  }
  if (type === "boolean") {
    const input = el("input", { type: "checkbox", disabled, checked: argument.default !== false });
    return made(key, label, input, "", () => input.checked);
  }
  const input = el("input", {
    type: "number", inputmode: "decimal", disabled, min: shown(min), max: shown(max), required: !optional,
    step: type === "integer" ? 1 : "any", value: shown(argument.default), placeholder: optional ? "as it is" : false,
  });
  const range = min === undefined && max === undefined ? unit : `${[shown(min), shown(max)].join(" to ")} ${unit}`;
  return made(key, label, input, range.trim(), () => (input.value === "" ? undefined : Number(input.value) / factor));
}

function made(key, label, input, range, read) {
  const element = el("label", { class: "field" }, el("span", {}, label), input, el("small", {}, range));
  return { name: key, label, input, element, read };
}
