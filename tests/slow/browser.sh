# Sourced by the tests that need a browser: kiln built (`$kiln`), Node and Chromium there (`$browser`), and a folder for
# the test that goes when it ends (`$folder`). `$root` is the project, `$target` where builds and pictures go.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
cd "$root"
target=${CARGO_TARGET_DIR:-$root/target}
kiln=${KILN:-$target/release/kiln}
[ -x "$kiln" ] || cargo build --release --locked --target-dir "$target"

command -v node >/dev/null && command -v npm >/dev/null || { apt-get update -qq && apt-get install -y -qq nodejs npm; }
browser=$(command -v chromium || command -v chromium-browser || command -v google-chrome || true)
if [ -z "$browser" ]; then
  apt-get update -qq && apt-get install -y -qq chromium
  browser=$(command -v chromium)
fi

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
