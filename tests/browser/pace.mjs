// Measures how often the page draws, in headless Chromium without a graphics card.
//
//   node pace.mjs PAGE [SECONDS]
//
// PAGE is the address that `feeder up --view` prints. A line for every 5 s: frames heard and pictures of the tray drawn each
// second, the time between two pictures, what the page's own script takes for one, and how finely it draws.
import { setTimeout as sleep } from "node:timers/promises";
import { launch, until } from "./chromium.mjs";

const [url, seconds = "20"] = process.argv.slice(2);
const SLICE_MS = 5000;
const browser = await launch();
const page = await browser.newPage({ viewport: { width: 1280, height: 900 } });
await page.goto(url);
await until(page, "globalThis.feeder?.playback.newest?.time_s > 0");
await page.evaluate(() => {
  const { playback, tray } = globalThis.feeder;
  globalThis.counted = { heard: 0, gapsMs: [], drawMs: [] };
  let lastAt = performance.now();
  const [push, draw] = [playback.push.bind(playback), tray.scene.draw.bind(tray.scene)];
  playback.push = (...frame) => {
    globalThis.counted.heard += 1;
    push(...frame);
  };
  tray.scene.draw = (...picture) => {
    const begunAt = performance.now();
    draw(...picture);
    globalThis.counted.drawMs.push(performance.now() - begunAt);
    globalThis.counted.gapsMs.push(begunAt - lastAt);
    lastAt = begunAt;
  };
});
const share = (values, of) => values.sort((a, b) => a - b)[Math.floor(of * (values.length - 1))]?.toFixed(1);
for (let slice = 0; slice * SLICE_MS < Number(seconds) * 1000; slice += 1) {
  await page.evaluate(() => {
    globalThis.counted = { heard: 0, gapsMs: [], drawMs: [] };
    globalThis.beganAt = performance.now();
  });
  await sleep(SLICE_MS);
  const { heard, gapsMs, drawMs, tookS, quality, parts } = await page.evaluate(() => {
    const { quality, painter } = globalThis.feeder.tray;
    return { ...globalThis.counted, tookS: (performance.now() - globalThis.beganAt) / 1000, quality, parts: painter.shown.length };
  });
  console.log(
    `${parts} parts: ${(heard / tookS).toFixed(1)} frames heard and ${(gapsMs.length / tookS).toFixed(1)} drawn a second, `
    + `${share(gapsMs, 0.5)} ms apart (95 %: ${share(gapsMs, 0.95)}), script ${share(drawMs, 0.5)} ms (${share(drawMs, 0.95)}), quality ${quality.toFixed(2)}`,
  );
}
await browser.close();
