#!/usr/bin/env bash
# Builds the page, then tests the engine in Node and the page in headless Chromium. What needs something that is not there says
# "skipped". SINEW_COMMAND names the command whose results are compared; an argument a folder for pictures of the page.
set -euo pipefail
cd "$(dirname "$0")/../.."
page=$(realpath -m "${CARGO_TARGET_DIR:-target}/web/sinew.html")
code=0
doors/web/build.sh "$page" || code=$?
case $code in 0) ;; 3) exit 0 ;; *) exit "$code" ;; esac
engine=$(realpath "${CARGO_TARGET_DIR:-target}")/wasm32-unknown-unknown/web/sinew_web.wasm
# all of the engine is in it; what makes it grow makes every page slower to open
[ "$(wc -c <"$engine")" -le 8600000 ] || { echo "$engine has more than 8.6 MB" >&2; exit 1; }
# all of it is read before anything is seen
[ "$(wc -c <"$page")" -le 3000000 ] || { echo "$page has more than 3 MB" >&2; exit 1; }
node=$(command -v node || true)
[ -n "$node" ] && "$node" -e 'process.exit(parseInt(process.versions.node) < 18 ? 1 : 0)' || { echo "skipped: no node of version 18 or later"; exit 0; }
"$node" doors/web/tests/unpack.mjs "$page" "$engine"
"$node" doors/web/tests/engine.mjs "$engine" ${SINEW_COMMAND:+"$SINEW_COMMAND"}
for name in chromium chromium-browser google-chrome; do
    browser=$(command -v $name || true)
    [ -z "$browser" ] || break
done
[ -n "$browser" ] || { echo "skipped: no Chromium"; exit 0; }
"$node" doors/web/tests/page.mjs "$page" "$browser" "$@"
