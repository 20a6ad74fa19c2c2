// Headless Chromium without a graphics card, for what draws and measures the page.
import { chromium } from "playwright-core";

export const launch = () => chromium.launch({
  executablePath: "/usr/bin/chromium",
  args: ["--headless", "--no-sandbox", "--disable-gpu", "--enable-unsafe-swiftshader", "--disable-background-networking"],
});

/** Asks until an expression is true in the page, whose own policy forbids a script of ours that would wait inside it. */
export async function until(page, js) {
  while (!(await page.evaluate(js))) {
    await new Promise((resolve) => setTimeout(resolve, 20));
  }
}
