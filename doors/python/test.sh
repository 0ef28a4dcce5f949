#!/usr/bin/env bash
# Builds the wheel, installs it in a clean environment, checks stubs, runs tests and examples. Says "skipped" where there is no
# Python, no way to create environments, or no maturin. Folders: CARGO_TARGET_DIR (default ../../target) holds environments and wheels.
set -euo pipefail
cd "$(dirname "$0")"

python=$(command -v python3 || true)
[ -n "$python" ] && "$python" -c 'import sys, venv; sys.exit(sys.version_info < (3, 10))' 2>/dev/null || {
    echo "skipped: no python3 of version 3.10 or later with venv"
    exit 0
}
export CARGO_TARGET_DIR=${CARGO_TARGET_DIR:-$(cd ../.. && pwd)/target}
place=$CARGO_TARGET_DIR/python
mkdir -p "$place"
tools=$place/tools clean=$place/clean wheels=$place/wheels

[ -x "$tools/bin/python" ] || "$python" -m venv "$tools" 2>/dev/null || {
    echo "skipped: python3 cannot create environments"
    exit 0
}
maturin=$tools/bin/maturin
[ -x "$maturin" ] || "$tools/bin/pip" install -q 'maturin>=1.9,<2' 2>/dev/null || maturin=$(command -v maturin || true)
[ -n "$maturin" ] && [ -x "$maturin" ] || {
    echo "skipped: no maturin, and pip cannot install it"
    exit 0
}

rm -rf "$wheels" "$clean"
"$maturin" build --out "$wheels"
wheel=$(echo "$wheels"/sinew-*.whl)
size=$(wc -c <"$wheel")
echo "$wheel has $((size / 1000000)).$((size / 100000 % 10)) MB"
[ "$size" -le 12000000 ] || { echo "more than 12 MB" >&2; exit 1; }

# nothing but the wheel and what it asks for, then what the tests need
"$python" -m venv "$clean"
pip=("$clean/bin/pip" --disable-pip-version-check install -q)
"${pip[@]}" "$wheel"
(cd / && "$clean/bin/python" -c "import sinew; print('installed', sinew.__version__, sinew.build_info())")
"${pip[@]}" pytest mypy
"${pip[@]}" nbclient ipykernel 2>/dev/null || true # a test says so where they are not to be had
(cd "$place" && "$clean/bin/python" -m mypy --strict -p sinew && "$clean/bin/python" -m mypy.stubtest sinew)
cp -r tests "$clean/tests"
SINEW_REPOSITORY=$(cd ../.. && pwd) "$clean/bin/python" -m pytest -q -s -p no:cacheprovider "$clean/tests" -c pyproject.toml --rootdir "$clean"

for example in examples/*.py; do
    name=$(basename "$example")
    needs=$(sed -n "s/^.*(examples\/$name).*| *\([a-z ]*\) *|$/\1/p" README.md)
    for package in $needs; do
        "$clean/bin/python" -c "import $package" 2>/dev/null || "${pip[@]}" "$package" 2>/dev/null || true
        "$clean/bin/python" -c "import $package" 2>/dev/null || { echo "skipped: $name needs $package"; continue 2; }
    done
    printf '\n== %s\n' "$example"
    (cd "$place" && "$clean/bin/python" "$OLDPWD/$example")
done
echo "the Python package is in order"
