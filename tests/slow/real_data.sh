#!/usr/bin/env bash
# The large meshes of the development data through a release build; skips itself where the data is not there.
set -euo pipefail
cd "$(dirname "$0")/../.."
KILN_SLOW=1 cargo test --release --locked --test real_data -- --nocapture
