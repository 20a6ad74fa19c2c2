// Records the page for the documentation: stills of it, or an animated WebP of tray, camera and one period.
//
//   node record.mjs stills PAGE FOLDER
//   node record.mjs animation PAGE FOLDER FROM_S SECONDS
//
// PAGE is the address that `feeder up --view` or `feeder view` prints: of a run, or of a bag that is played. The animation
// waits for FROM_S, simulated seconds, slows the run down and stops it for every picture: they stand 40 ms of simulated time
// apart, however slow this machine is.
// Needs Debian's packages chromium and webp.
import { execFileSync } from "node:child_process";
import { mkdtempSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { launch, until } from "./chromium.mjs";

const [what, url, folder, fromS, seconds] = process.argv.slice(2);
const FRAME_MS = 40;
/** Where the tray vibrates and there is something on the plateau to be seen. */
const FEEDING = "(({ courier_state: state, candidates }) => state.vibrating && candidates?.parts.length > 4)(feeder.playback.newest.feeders[feeder.tray.feeder])";
const STILLS = [
  { name: "page-dark", theme: "dark", width: 1440, height: 1010 },
  { name: "page-light", theme: "light", width: 1440, height: 1010 },
  { name: "page-whole", theme: "dark", width: 1440, height: 2100 },
  { name: "page-phone", theme: "dark", width: 390, height: 844 },
  { name: "page-help", theme: "light", width: 1200, height: 900, then: "document.getElementById('help-open').click()" },
];

const browser = await launch();
const work = mkdtempSync(join(tmpdir(), "page-"));

async function open(theme, width, height) {
  const page = await browser.newPage({ viewport: { width, height }, colorScheme: theme });
  await page.goto(url);
  await until(page, "feeder.playback.newest?.time_s > 0 && document.getElementById('camera-note').textContent.includes('seen')");
  await until(page, "document.getElementById('period-words').textContent !== ''");
  return page;
}

/** Until the newest frame is drawn, as finely as can be. */
const drawn = (page) => until(page, "feeder.tray.drawn?.timeS === feeder.playback.newest.time_s && feeder.tray.stillSince === Infinity");

/** Presses the button that stops time and lets it go on. */
async function pause(page, isWanted) {
  await page.evaluate("document.getElementById('pause').click()");
  await until(page, `feeder.playback.newest.paused === ${isWanted} && document.getElementById('pause').dataset.paused === '${isWanted}'`);
}

async function stills() {
  for (const { name, theme, width, height, then = "0" } of STILLS) {
    const page = await open(theme, width, height);
    // Plots need some time to have something to show.
    const from = await page.evaluate("feeder.playback.newest.time_s");
    await until(page, `feeder.playback.newest.time_s > ${from} + 6 && ${FEEDING}`);
    await pause(page, true);
    await drawn(page);
    await page.evaluate(then);
    await page.evaluate("new Promise((resolve) => setTimeout(resolve, 300))");
    const png = join(work, `${name}.png`);
    await page.screenshot({ path: png });
    execFileSync("cwebp", ["-quiet", "-q", "84", png, "-o", join(folder, `${name}.webp`)]);
    await pause(page, false);
    await page.close();
  }
}

async function animation() {
  const page = await open("dark", 1180, 740);
  await page.evaluate(() => {
    // Tray, camera and one period alone, side by side.
    for (const gone of document.querySelectorAll("#pace, .bar .group, .bar .choice, #stop, .figures, .at-platen, .at-controls, .at-feed, .at-deliveries, .at-nodes, #tray-options, #tray-views, .words, .bands, #period-surface, .inline")) {
      gone.style.display = "none";
    }
    document.querySelector("main").style.paddingTop = "10px";
    document.getElementById("camera-picture").style.maxHeight = "230px";
    document.querySelectorAll(".pair .plot").forEach((plot) => {
      plot.style.minHeight = "115px";
    });
    document.querySelector(".at-camera").style.order = "-1";
    document.querySelector(".at-tray").style.order = "-2";
    document.querySelector(".at-period").style.gridColumn = "span 5";
  });
  await until(page, `feeder.playback.newest.time_s >= ${fromS} && feeder.playback.newest.time_s < ${fromS} + 1`);
  await page.evaluate("[...document.querySelectorAll('#speeds button')].find(({ textContent }) => textContent === '1/20').click()");
  await until(page, "feeder.playback.newest.speed === 0.05");
  const beginS = await page.evaluate("feeder.playback.newest.time_s");
  const frames = [];
  for (let frame = 0; frame < Number(seconds) * (1000 / FRAME_MS); frame += 1) {
    await until(page, `feeder.playback.newest.time_s >= ${beginS + (frame * FRAME_MS) / 1000}`);
    await pause(page, true);
    await drawn(page);
    const png = join(work, `frame-${String(frame).padStart(4, "0")}.png`);
    await page.screenshot({ path: png });
    frames.push(png);
    await pause(page, false);
  }
  execFileSync("img2webp", ["-loop", "0", "-lossy", "-q", "55", "-m", "4", "-d", String(FRAME_MS), ...frames, "-o", join(folder, "page.webp")]);
}

await { stills, animation }[what]();
await browser.close();
