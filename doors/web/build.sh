#!/usr/bin/env bash
# Builds the engine as WebAssembly and puts it into one page, that opens from disk. Argument: the page (default
# target/web/sinew.html). Says "skipped", and leaves with 3, where Rust cannot build for WebAssembly or there is no xz.
set -euo pipefail
cd "$(dirname "$0")/../.."
page=$(realpath -m "${1:-${CARGO_TARGET_DIR:-target}/web/sinew.html}")
target=wasm32-unknown-unknown
if [ ! -d "$(rustc --print sysroot)/lib/rustlib/$target" ]; then
    { command -v rustup && timeout 120 rustup target add $target; } >/dev/null 2>&1 || {
        echo "skipped: no Rust for $target here (rustup target add $target)"
        exit 3
    }
fi
command -v xz >/dev/null || { echo "skipped: no xz here, which packs the engine"; exit 3; }
cargo build --profile web --target $target -p sinew-web -p sinew-unpack --locked
built=$(realpath "${CARGO_TARGET_DIR:-target}")/$target/web
engine=$built/sinew_web.wasm unpacker=$built/sinew_unpack.wasm
mkdir -p "${page%/*}"
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
# what repeats is found at any distance within 16 MiB, which is more than the engine has
xz --format=lzma --lzma1=preset=9e,dict=16MiB -c "$engine" >"$work/engine.lzma"
base64 <"$work/engine.lzma" >"$work/packed"
base64 <"$unpacker" >"$work/unpacker"
# files in place of the lines that name them; what is read may name others
fill() {
    awk -v list="$*" '
        BEGIN { for (n = split(list, pairs); n; n--) { i = index(pairs[n], "="); file["@" substr(pairs[n], 1, i - 1) "@"] = substr(pairs[n], i + 1) } }
        { word = $0; gsub(/ /, "", word) }
        word in file { while ((getline line <file[word]) > 0) print line; close(file[word]); next }
        { print }'
}
web=doors/web player=demos/render/player mesh=liver_medium.msh
fill VIEW=$player/view.js <$web/page.js >"$work/script"
fill STYLE=$player/base.css MESH=demos/meshes/$mesh SCENE=$web/liver.toml ENGINE=$web/engine.js WORKER=$web/worker.js \
    UNPACKER="$work/unpacker" PACKED="$work/packed" SCRIPT="$work/script" <$web/page.html | sed "s/@MESH_NAME@/$mesh/" >"$page"
size() { printf '%s.%s%s MB' $(($(wc -c <"$1") / 1000000)) $(($(wc -c <"$1") / 100000 % 10)) $(($(wc -c <"$1") / 10000 % 10)); }
echo "$engine: $(size "$engine"), packed $(size "$work/engine.lzma"); unpacked by $(($(wc -c <"$unpacker") / 1000)) kB; $page: $(size "$page")"
