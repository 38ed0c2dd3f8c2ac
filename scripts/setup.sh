#!/usr/bin/env bash
# Create .venv from environment.lock and install sngr_utils into it, editable.
# Usage: setup.sh [PYTHON]. Does nothing if .venv is complete and current.
set -euo pipefail
unset CDPATH PIP_USER PIP_TARGET PIP_PREFIX PIP_REQUIRE_VIRTUALENV
cd "$(dirname "$0")/.."

# Complete: made from this lock, in this folder (a moved copy starts anew).
current="$(cksum < environment.lock) $PWD"
if [ "$(cat .venv/complete 2> /dev/null)" = "$current" ] && .venv/bin/python -c '' 2> /dev/null; then
  exit 0
fi

supported() {
  command -v "$1" > /dev/null && "$1" -c '
import sys
sys.exit(not ((3, 11) <= sys.version_info[:2] <= (3, 14)))' 2> /dev/null
}
python=
if [ -n "${1:-}" ] && ! supported "$1"; then
  echo "error: PYTHON=$1 is not a Python 3.11 to 3.14 that runs" >&2
  exit 1
fi
for candidate in "${1:-python3}" python3 python3.13 python3.12 python3.11 python3.14; do
  if supported "$candidate"; then
    python=$candidate
    break
  fi
done
if [ -z "$python" ]; then
  echo "error: no Python 3.11 to 3.14 found; name one with: make setup PYTHON=/path/to/python3" >&2
  exit 1
fi

if [ -e .venv ] && { [ ! -w .venv ] || [ ! -w .venv/bin ]; }; then
  echo "error: .venv is not yours to replace (it belongs to $(ls -ld .venv | awk '{print $3}'))" >&2
  exit 1
fi

quiet=--quiet
[ -t 1 ] && quiet=
echo "setup: installing environment.lock into .venv ($("$python" --version))"
rm -rf .venv
if command -v uv > /dev/null; then
  uv venv --quiet --no-project --python "$(command -v "$python")" .venv
  install=(uv pip install $quiet --python .venv/bin/python)
else
  "$python" -m venv .venv || {
    echo "error: $python cannot make a virtual environment (Debian: apt install python3-venv)" >&2
    exit 1
  }
  install=(.venv/bin/python -m pip install $quiet --disable-pip-version-check)
fi
# The lock is complete. With its resolver on, pip fails as soon as a package that another asks for
# with an extra (coverage[toml]) has a newer release than the locked one.
"${install[@]}" --no-deps --require-hashes -r environment.lock
"${install[@]}" --no-deps --no-build-isolation --editable .
echo "$current" > .venv/complete
