#!/usr/bin/env bash
# The tile of a material-space bake in a real browser without a screen: `tile_page.mjs` draws it by `kiln shader three` and
# by `kiln shader glsl` in WebGL 2, and compares with kiln's own picture of the same view; ktx-parse reads the KTX2 files,
# whose texels must be those of the PNG strips. Once as a 3D texture, once as a 2D array. Installs what is missing.
# Pictures go to target/tile-page/.
source "$(dirname "$0")/browser.sh"
mkdir -p "$folder/project/recipes" "$target/tile-page"
(cd "$folder" && npm install --silent --no-audit --no-fund --ignore-scripts \
  puppeteer-core@24.15.0 three@0.187.0 ktx-parse@2.0.0 pngjs@7.0.0 >/dev/null)
cp tests/slow/tile_page.mjs tests/slow/tile_page.html "$folder/"

cd "$folder/project"
cp -r "$root"/recipes/assets recipes/
# On a sphere, whose poles are blended from three look-ups.
sed '/^\[atlas\]/,$d; s/vase.obj/carved-sphere.glb/' "$root/recipes/vase-scales.toml" > recipes/tile.toml
cat >> recipes/tile.toml <<'END'
[uv_sets]

[[render]]
camera = { eye = [1.4, 2.6, 1.9], target = [0.0, 0.0, 0.0], fov_deg = 40 }
size = 512
shading = "unlit"
END
sed 's/^layers = 6/layers = 6\ntile = "2d-array"/' recipes/tile.toml > recipes/array.toml
"$kiln" shader glsl > ../kiln.glsl
"$kiln" shader three > ../kiln.js
"$kiln" bake -q
cd "$folder"
# Without mips a texel may be missed between two pixels; kiln's picture is filtered.
node tile_page.mjs "$browser" project/out/tile tile 30 "$target/tile-page"
node tile_page.mjs "$browser" project/out/array array 40 "$target/tile-page"
