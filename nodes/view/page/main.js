// Brings everything together: what the server says goes to the views, and thirty and more times a second they draw it.

import { showAlerts } from "./alerts.js";
import { CameraView } from "./camera_view.js";
import { Connection } from "./connection.js";
import { Controls } from "./controls.js";
import { byId, el, setAll, setText } from "./dom.js";
import { FeedView } from "./feed_view.js";
import { startHelp, toggleHelp } from "./help.js";
import { startKeys } from "./keys.js";
import { showNodes } from "./nodes_view.js";
import { PeriodView } from "./period_view.js";
import { Permissions } from "./permissions.js";
import { PlatenView } from "./platen_view.js";
import { Playback } from "./playback.js";
import { RunBar } from "./run_bar.js";
import { startTheme, toggleTheme } from "./theme.js";
import { Timeline } from "./timeline.js";
import { TrayView } from "./tray_view.js";

const CHANNELS = ["frame", "event", "motion", "servo", "picture"];
/** Of a page that is not looked at only these are kept up. */
const HIDDEN_CHANNELS = ["event"];
const SOURCES = { run: "live run", graph: "live graph", bag: "replayed bag" };
/** Plots and lists are drawn anew after this time, ms. */
const SLOW_MS = 80;

startTheme();
startHelp();
const playback = new Playback();
const permissions = new Permissions();
const tray = new TrayView();
const camera = new CameraView();
const feed = new FeedView();
let hello = null;
let focus = null;
let status = null;
let period = null;
let platen = null;
let timeline = null;

const connection = new Connection({
  message: (message) => (RECEIVERS[message.type] ?? (() => undefined))(message),
  picture: (header, bytes) => header.feeder === focus && camera.show(header, bytes),
  condition: showCondition,
});
const controls = new Controls(permissions, connection);
const bar = new RunBar(permissions, async (name, feeder, values) => {
  const reply = await connection.control(name, feeder, values);
  setText(byId("bar-answer"), reply.ok ? "" : `${name.replaceAll("_", " ")}: ${reply.message}`);
  return reply;
});

/** What is done with each message, by its type. */
const RECEIVERS = {
  hello: begin,
  frame: (frame) => {
    if (frame.time_s !== null) {
      playback.push(frame, performance.now());
      feed.addFrame(frame, focus);
      period.measure(frame.feeders[focus]);
    }
  },
  status: (message) => {
    status = message;
    showNodes(message);
    feed.addStatus(message, focus, playback.newest);
    showState(message);
  },
  motion: (message) => {
    if (message.feeder === focus) {
      period.show(message, playback.newest?.feeders[focus]?.feeding !== false);
      feed.addMotion(message);
    }
  },
  waveform: (message) => message.feeder === focus && controls.showWaveform(message),
  servo: (message) => message.feeder === focus && tray.servo.push(message),
  events: (message) => timeline.add(message),
  error: ({ message }) => setText(byId("bar-answer"), message),
};

/** Another run, or another server: everything begins anew. */
function begin(message) {
  hello = message;
  playback.clear();
  status = null;
  timeline = new Timeline(hello);
  platen = new PlatenView(hello, look);
  period ??= new PeriodView(hello);
  period.part = hello.part;
  setText(byId("scenario"), `${hello.scenario} · ${SOURCES[hello.source] ?? hello.source} · seed ${hello.seed}`);
  document.title = `${hello.scenario} – minifactory feeder`;
  setAll(byId("read-only"), { hidden: hello.read_only ? null : true });
  permissions.take(hello);
  const names = hello.feeders.map(({ name }) => name);
  look(names.includes(focus) ? focus : names[0]);
}

/** Looks at a feeder. @param {string} feeder its name */
function look(feeder) {
  focus = feeder;
  bar.focus = feeder;
  const described = hello.feeders.find(({ name }) => name === feeder);
  tray.look(hello, feeder);
  period.look(described);
  feed.clear();
  camera.clear();
  controls.build(hello, feeder);
  showTabs();
  subscribe();
}

function showTabs() {
  const tabs = hello.feeders.map(({ name }) => {
    const button = el("button", { type: "button", "aria-pressed": String(name === focus) }, name);
    button.addEventListener("click", () => look(name));
    return button;
  });
  byId("feeders").replaceChildren(...tabs);
  setAll(byId("feeders"), { hidden: tabs.length < 2 ? true : null });
}

function subscribe() {
  if (focus) {
    connection.subscribe(document.hidden ? HIDDEN_CHANNELS : CHANNELS, focus);
  }
}

function showState(message) {
  const state = message.feeders[focus]?.state;
  setAll(byId("state"), { hidden: state ? null : true, "data-state": state?.state });
  setText(byId("state"), state ? state.state : "");
}

function showCondition(condition, reason) {
  const isLost = condition === "lost";
  permissions.connected(condition === "open");
  setAll(byId("banner"), { hidden: isLost ? null : true });
  setAll(document.body, { "data-condition": condition });
  if (isLost) {
    const isElsewhere = !["localhost", "127.0.0.1", "[::1]"].includes(location.hostname);
    const hint = isElsewhere && !location.search.includes("token=") ? " The address needs the token that was printed with it." : "";
    setText(byId("banner"), `Connection lost${reason ? `: ${reason}` : ""}. What is shown stands still. Trying again…${hint}`);
  }
}

let lastAt = performance.now();
let slowAt = 0;
function draw(now) {
  requestAnimationFrame(draw);
  const seconds = (now - lastAt) / 1000;
  lastAt = now;
  const moment = playback.moment(performance.now());
  if (!moment || document.hidden) {
    return;
  }
  platen.draw(moment, focus);
  tray.draw(moment, playback, seconds);
  if (now - slowAt > SLOW_MS) {
    slowAt = now;
    bar.show(playback.newest, moment.timeS);
    timeline.draw(moment.timeS, playback.newest);
    period.draw();
    feed.draw();
    showAlerts(playback.newest, status);
  }
}

document.addEventListener("visibilitychange", subscribe);
byId("theme").addEventListener("click", toggleTheme);
startKeys({
  " ": () => byId("pause").click(),
  ".": () => byId("step").click(),
  "[": () => bar.shift(-1),
  "]": () => bar.shift(1),
  t: () => tray.toggle("truth"),
  r: () => tray.toggle("trails"),
  m: () => tray.toggle("marks"),
  d: toggleTheme,
  "?": toggleHelp,
  "1": () => byId("tray-views").children[0].click(),
  "2": () => byId("tray-views").children[1].click(),
  "3": () => byId("tray-views").children[2].click(),
});
// For tests, and for whoever looks in the console.
globalThis.feeder = {
  playback,
  tray,
  get status() {
    return status;
  },
};
requestAnimationFrame(draw);
