// Drives a page in headless Chromium for tests that are written elsewhere: a command in JSON for each line of standard
// input, an answer in JSON for each on standard output.
//
//   {"do": "open", "url": "…", "width": 1280, "height": 900, "theme": "dark"}   a new page in place of the last
//   {"do": "until", "js": "…"}      waits until an expression is true in the page, and answers its value
//   {"do": "eval", "js": "…"}       answers an expression's value
//   {"do": "click", "selector": "…"} {"do": "press", "key": "…"}
//   {"do": "resize", "width": 390, "height": 844}
//   {"do": "picture", "file": "…"}  a picture of what is on the screen
//   {"do": "complaints"}            what the page has written on its console as warning or error, and what it has thrown
import { createInterface } from "node:readline";
import { chromium } from "playwright-core";

const [executablePath, patienceMs] = process.argv.slice(2);
const browser = await chromium.launch({
  executablePath,
  args: [
    "--headless", "--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync", "--disable-gpu", "--enable-unsafe-swiftshader",
  ],
});
let page = null;
let complaints = [];

/** Asks again and again; the page's own policy forbids a script of ours that would wait inside it. */
async function until(js) {
  for (const giveUp = Date.now() + Number(patienceMs); ; await new Promise((resolve) => setTimeout(resolve, 50))) {
    const value = await page.evaluate(js);
    if (value) {
      return value;
    }
    if (Date.now() > giveUp) {
      throw new Error("waited in vain");
    }
  }
}

const commands = {
  async open({ url, width = 1280, height = 900, theme = "dark" }) {
    await page?.close();
    complaints = [];
    page = await browser.newPage({ viewport: { width, height }, colorScheme: theme });
    page.setDefaultTimeout(Number(patienceMs));
    page.on("console", (message) => {
      // Chromium's own advice: without a graphics card every picture of WebGL is read back.
      const isAdvice = message.text().includes("GL Driver Message (OpenGL, Performance");
      if (["warning", "error"].includes(message.type()) && !isAdvice) {
        complaints.push(message.text());
      }
    });
    page.on("pageerror", (error) => complaints.push(String(error.stack)));
    await page.goto(url);
  },
  until: ({ js }) => until(js),
  eval: ({ js }) => page.evaluate(js),
  click: ({ selector }) => page.click(selector),
  press: ({ key }) => page.keyboard.press(key),
  resize: ({ width, height }) => page.setViewportSize({ width, height }),
  picture: async ({ file }) => void (await page.screenshot({ path: file })),
  complaints: () => complaints,
};

for await (const line of createInterface({ input: process.stdin })) {
  const command = JSON.parse(line);
  let answer;
  try {
    answer = { value: (await commands[command.do](command)) ?? null };
  } catch (error) {
    answer = { error: `${line}: ${error}; the page has complained: ${complaints.join("; ")}` };
  }
  console.log(JSON.stringify(answer));
}
await browser.close();
