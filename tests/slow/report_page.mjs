// Clicks through the page of `kiln check --report` and takes screenshots: report_page.mjs PAGE BROWSER FOLDER
import assert from "node:assert/strict";
import fs from "node:fs";
import os from "node:os";
import path from "node:path";
import puppeteer from "puppeteer-core";

const [page_file, browser_file, folder] = process.argv.slice(2);
const profile = fs.mkdtempSync(path.join(os.tmpdir(), "kiln-page-"));
const browser = await puppeteer.launch({
  executablePath: browser_file,
  headless: true,
  userDataDir: profile,
  args: ["--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync", "--window-size=1280,900"],
});
try {
  const page = await browser.newPage();
  await page.setViewport({ width: 1280, height: 900 });
  const wrong = [];
  page.on("pageerror", e => wrong.push(`error: ${e}`));
  page.on("console", m => m.type() === "error" && wrong.push(`console: ${m.text()}`));
  page.on("request", r => /^(file|data|blob):/.test(r.url()) || wrong.push(`request: ${r.url()}`));
  await page.goto(`file://${page_file}`);
  const shot = name => page.screenshot({ path: path.join(folder, `${name}.png`) });
  const text = selector => page.$eval(selector, e => e.textContent);
  const items = () => page.$$eval("nav a", list => list.map(a => a.textContent));
  const view = what => page.$eval("#view", (e, what) => e.dataset[what], what);
  const pause = ms => new Promise(done => setTimeout(done, ms));
  const settled = async () => { await page.waitForFunction(() => document.querySelector("#view")?.dataset.mode); await pause(150); };
  const open = async name => {
    for (const a of await page.$$("nav a")) if ((await a.evaluate(e => e.textContent)) === name) { await a.click(); return settled(); }
    assert.fail(`${name} is not listed: ${await items()}`);
  };

  // Summary and states: what failed is listed, what is as accepted is not, until it is asked for.
  await settled();
  await shot("1-start");
  assert.match(await text("#summary"), /^\d+ outputs, \d+ failed, \d+\.\d s$/);
  const states = await page.$$eval("#states button", b => b.map(e => [e.dataset.state, e.getAttribute("aria-pressed")]));
  for (const state of ["failed", "different", "new", "stale"]) assert.ok(states.some(([s, on]) => s === state && on === "true"), state);
  assert.ok(states.some(([s, on]) => s === "same" && on === "false"));
  const failed = await items();
  await page.click("[data-state=same]");
  assert.ok((await items()).length > failed.length, "the others are listed, too");
  await page.click("[data-state=same]");
  assert.deepEqual(await items(), failed);
  for (const state of ["failed", "new", "stale"]) await page.click(`[data-state=${state}]`);
  assert.ok((await items()).length < failed.length && !(await items()).includes("bake"));
  for (const state of ["failed", "new", "stale"]) await page.click(`[data-state=${state}]`);
  await page.type("#search", "pebbles base_color");
  assert.deepEqual(await items(), ["canvas-pebbles.base_color.png"]);
  await page.$eval("#search", e => { e.value = ""; e.dispatchEvent(new Event("input")); });

  // A changed map: three pictures, figures, what moved, quality before and after, times, the command.
  await open("canvas-pebbles.base_color.png");
  assert.equal(await view("mode"), "side");
  assert.deepEqual(await page.$$eval("#view .pic b", b => b.map(e => e.textContent)), ["expected", "difference", "actual"]);
  assert.ok(await page.$$eval("#view img", i => i.every(e => e.complete && e.naturalWidth > 100)));
  assert.match(await text("#figures"), /greatest.*at \d+, \d+.*FLIP/);
  assert.match(await text("#change"), /walk image.*`seed` changed from 7 to 8/);
  assert.match(await text("#quality"), /swd[\d.]+(better|worse)?/);
  assert.match(await text("#times"), /^Time: [\d.]+ s.*analyse/);
  assert.match(await text("#accept code"), /^kiln accept canvas-pebbles\/canvas-pebbles\.base_color\.png$/);
  await shot("2-side");

  await page.click("button[data-mode=slider]");
  await settled();
  const pic = await (await page.$("#view .pic")).boundingBox();
  await page.mouse.move(pic.x + pic.width * 0.25, pic.y + 20);
  assert.ok(Math.abs(Number(await view("split")) - 0.25) < 0.02, await view("split"));
  await shot("3-slider-quarter");
  await page.mouse.move(pic.x + pic.width * 0.75, pic.y + 20);
  assert.ok(Math.abs(Number(await view("split")) - 0.75) < 0.02);

  await page.click("button[data-mode=flicker]");
  await settled();
  const seen = new Set();
  for (let i = 0; i < 12; i++) { seen.add(await view("side")); await pause(120); }
  assert.deepEqual([...seen].sort(), ["actual", "expected"]);
  await shot("4-flicker");

  await page.keyboard.press("4");
  await settled();
  assert.equal(await view("mode"), "difference");
  await shot("5-difference");

  // Zoom: texels are shown as squares, and what does not fit is scrolled to.
  const before = Number(await view("zoom"));
  for (let i = 0; i < 3; i++) { await page.click("[data-zoom=in]"); await pause(150); }
  assert.equal(Number(await view("zoom")), Math.min(32, before * 8));
  assert.ok(await page.$eval("#view", e => e.scrollWidth > e.clientWidth));
  await shot("6-zoom");
  await page.click("[data-zoom=one]");
  await pause(150);
  assert.equal(Number(await view("zoom")), 1);
  await page.click("[data-zoom=fit]");
  await pause(150);

  // From one to the next by keys.
  await page.keyboard.press("1");
  const at = (await items()).indexOf("canvas-pebbles.base_color.png");
  await page.keyboard.press("j");
  await settled();
  assert.equal(await text("nav a[aria-current]"), (await items())[at + 1]);
  await shot("7-next");

  // A render of another size, a recipe that is new, one that failed, a golden that is stale.
  await open("render/camera.png");
  assert.match(await text("#message"), /expected 256x256.*found 200x200|expected \d+x\d+.*found 200x200/);
  await shot("8-render");
  await open("bake");
  assert.match(await text("#message"), /none\.glb/);
  await shot("9-failed");
  await open("golden/canvas-rust.toml");
  assert.equal(await text("#accept code"), "kiln accept --prune");
  await open("canvas-fresh.base_color.png");
  assert.deepEqual(await page.$$eval("#view .pic b", b => b.map(e => e.textContent)), ["actual"]);
  assert.ok(await page.$eval("button[data-mode=slider]", b => b.disabled));
  await page.setViewport({ width: 480, height: 900 });
  await pause(300);
  await shot("10-narrow");
  await page.setViewport({ width: 1280, height: 900 });
  await page.emulateMediaFeatures([{ name: "prefers-color-scheme", value: "dark" }]);
  await open("canvas-pebbles.normal.png");
  await shot("11-dark");
  assert.deepEqual(wrong, []);
  console.log("the report page does what it should; screenshots in", folder);
} finally {
  await browser.close();
  fs.rmSync(profile, { recursive: true, force: true });
}
