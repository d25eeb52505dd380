#!/usr/bin/env bash
# Promise 1 across builds: release and release for this very CPU give the golden bytes that the debug build gives in
# `cargo test`, for 1, 2 and 8 threads; with the features given as arguments (for instance: --features xatlas).
set -euo pipefail
cd "$(dirname "$0")/../.."
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cp -r recipes golden "$folder"

check() {
  echo "-- $1, -j $3"
  "$2" -C "$folder" -j "$3" check -q
}

target=${CARGO_TARGET_DIR:-target}
cargo build --release --locked --target-dir "$target" "$@"
for jobs in 1 2 8; do check "release" "$target"/release/kiln "$jobs"; done
RUSTFLAGS="-C target-cpu=native" cargo build --release --locked --target-dir "$target"/native "$@"
check "release for this CPU" "$target"/native/release/kiln 2
