#!/usr/bin/env bash
# The page of `kiln check --report` in a real browser without a screen: bakes a small project, spoils it, and has
# `report_page.mjs` click through what the check found. Installs Chromium and puppeteer-core where they are missing.
# Screenshots go to target/report-page/.
source "$(dirname "$0")/browser.sh"
mkdir -p "$folder/project/recipes" "$folder/node"
(cd "$folder/node" && npm install --silent --no-audit --no-fund --ignore-scripts puppeteer-core@24.15.0 >/dev/null)
cp tests/slow/report_page.mjs "$folder/node/"

cd "$folder/project"
cp -r "$root"/recipes/assets recipes/
for name in canvas-pebbles canvas-rust canvas-bark block-bricks; do cp "$root/recipes/$name.toml" recipes/; done
env -u CI "$kiln" accept -q
# Another parameter, another sample, a recipe that is gone, one that is new, one that cannot be baked.
sed -i 's/^seed = 7$/seed = 8/' recipes/canvas-pebbles.toml
sed -i '/^\[\[render\]\]/,$ s/^size = .*/size = 200/' recipes/block-bricks.toml
mv recipes/canvas-rust.toml recipes/canvas-fresh.toml
printf '[mesh]\npath = "assets/none.glb"\n\n[exemplar]\nbase_color = "assets/pebbles/base_color.png"\n\n[atlas]\n' > recipes/broken.toml
if "$kiln" check -q --report report.html --junit report.xml > said.txt; then echo "the check should fail"; exit 1; fi
mkdir -p "$target/report-page"
cp report.html "$target/report-page/"
node "$folder/node/report_page.mjs" "$folder/project/report.html" "$browser" "$target/report-page"
