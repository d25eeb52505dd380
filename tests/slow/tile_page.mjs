// Draws a bake with a tile in a browser and compares with kiln: tile_page.mjs BROWSER BAKE NAME LEAST_PSNR FOLDER
import assert from "node:assert/strict";
import fs from "node:fs";
import http from "node:http";
import os from "node:os";
import path from "node:path";
import { PNG } from "pngjs";
import puppeteer from "puppeteer-core";
import { read } from "ktx-parse";

const [browserFile, bake, name, least, folder] = process.argv.slice(2);
const file = what => fs.readFileSync(path.join(bake, what));

// Every texel of the first level is that of the strip.
for (const map of ["base_color", "normal", "roughness", "height"]) {
  const ktx = read(new Uint8Array(file(map === "base_color" ? `${name}.tile.ktx2` : `${name}.tile.${map}.ktx2`)));
  const strip = PNG.sync.read(file(`${name}.tile.${map}.png`));
  const [w, h, layers] = [ktx.pixelWidth, ktx.pixelHeight, ktx.pixelDepth || ktx.layerCount];
  const descriptor = ktx.dataFormatDescriptor[0];
  assert.equal(descriptor.transferFunction, map === "base_color" ? 2 : 1);
  assert.deepEqual(descriptor.samples.map(s => s.bitOffset), [0, 8, 16, 24]);
  assert.deepEqual([ktx.faceCount, w * layers, h], [1, strip.width, strip.height]);
  for (let l = 0; l < layers; l++) for (let y = 0; y < h; y++) {
    const row = Buffer.from(ktx.levels[0].levelData.subarray((l * h + y) * w * 4, (l * h + y + 1) * w * 4));
    const at = (y * strip.width + l * w) * 4;
    assert.ok(row.equals(strip.data.subarray(at, at + w * 4)), `${map}: layer ${l}, row ${y}`);
  }
}

const served = url => url === "/" ? "tile_page.html"
  : url.startsWith("/bake/") ? path.join(bake, `${name}.${url.slice(6)}`) : `.${url}`;
const server = http.createServer((request, response) => {
  const from = served(new URL(request.url, "http://localhost").pathname);
  if (!fs.existsSync(from)) return response.writeHead(404).end();
  const type = from.endsWith(".html") ? "text/html" : /\.m?js$/.test(from) ? "text/javascript" : "application/octet-stream";
  response.writeHead(200, { "content-type": type }).end(fs.readFileSync(from));
}).listen(0);
const profile = fs.mkdtempSync(path.join(os.tmpdir(), "kiln-tile-"));
const browser = await puppeteer.launch({
  executablePath: browserFile,
  headless: true,
  userDataDir: profile,
  args: ["--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"],
});
try {
  const page = await browser.newPage();
  const wrong = [];
  page.on("pageerror", e => wrong.push(String(e)));
  page.on("console", m => m.type() === "error" && !/favicon/.test(m.location().url) && wrong.push(m.text()));
  await page.goto(`http://127.0.0.1:${server.address().port}/`);
  await page.waitForFunction(() => window.done, { timeout: 120000 });
  assert.deepEqual(wrong, []);
  const expected = PNG.sync.read(file("render/camera.png"));
  const pictures = await page.evaluate(() => window.done);
  const picture = by => Buffer.from(pictures[by].split(",")[1], "base64");
  const blended = PNG.sync.read(picture("blended")).data;
  for (const by of ["three", "glsl"]) {
    fs.writeFileSync(path.join(folder, `${name}-${by}.png`), picture(by));
    const { width, height, data } = PNG.sync.read(picture(by));
    // Pixels that nothing but the surface is near: outlines are smoothed in another way.
    const covered = (x, y) => [-2, 0, 2].every(j => [-2, 0, 2].every(i => data[((y + j) * width + x + i) * 4 + 3] === 255));
    // Of all pixels, and of those where three look-ups are blended.
    for (const [where, fewest, counts] of [["", 40000, () => true], [" of three look-ups", 1000, i => blended[i] === 255]]) {
      let [sum, count] = [0, 0];
      for (let y = 2; y < height - 2; y++) for (let x = 2; x < width - 2; x++) {
        const at = (y * width + x) * 4;
        if (!covered(x, y) || !counts(at)) continue;
        count++;
        for (let c = 0; c < 3; c++) sum += (data[at + c] - expected.data[at + c]) ** 2 / 3;
      }
      const psnr = 10 * Math.log10(255 * 255 * count / sum);
      console.log(`${name} by ${by}: PSNR ${psnr.toFixed(1)} dB over ${count} pixels${where}`);
      assert.ok(count > fewest && psnr > Number(least), `at least ${least} dB`);
    }
  }
} finally {
  await browser.close();
  server.close();
  fs.rmSync(profile, { recursive: true, force: true });
}
