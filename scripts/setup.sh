#!/usr/bin/env bash
# Create .venv from environment.lock and install sngr_utils into it, editable.
# Usage: setup.sh [PYTHON]. Does nothing if .venv is complete and current.
# A set-up that fails or is cut off leaves the environment that was there before.
set -euo pipefail
case "${1:-}" in -*) sed -n '2,/^set/s/^# //p' "$0" >&2; exit 2 ;; esac
unset CDPATH
cd -P "$(dirname "$0")/.." # one name, also if it is reached by a link

fail() {
  echo "error: $1" >&2
  exit 1
}
# Everything is written below this folder: say now if it cannot be.
probe=$({ mkdir -p build/cache && mktemp build/cache/.probe.XXXXXX; } 2> /dev/null) &&
  echo "can be written" 2> /dev/null > "$probe" && rm -f "$probe" ||
  fail "$PWD/build cannot be written (read-only, full, or another's): work in a copy of your own"

# Complete: made from this lock, in this folder (a moved copy starts anew).
current="$(cksum < environment.lock) $PWD"
complete() {
  [ "$(cat "$1/complete" 2> /dev/null)" = "$current" ] && "$1/bin/python" -c '' 2> /dev/null
}
complete .venv && exit 0

supported() {
  command -v "$1" > /dev/null && "$1" -c '
import sys
sys.exit(not ((3, 11) <= sys.version_info[:2] <= (3, 14)))' 2> /dev/null
}
python=
if [ -n "${1:-}" ] && ! supported "$1"; then
  fail "PYTHON=$1 is not a Python 3.11 to 3.14 that runs"
fi
for candidate in "${1:-python3}" python3 python3.13 python3.12 python3.11 python3.14; do
  if supported "$candidate"; then
    python=$candidate
    break
  fi
done
[ -n "$python" ] ||
  fail "no Python 3.11 to 3.14 found; name one with: make setup PYTHON=/path/to/python3"
if [ "$(uname -s) $(uname -m)" = "Darwin x86_64" ]; then
  fail "Intel Macs: numba's compiler has no wheels for them any more; use Linux or an Apple chip"
fi
if [ -z "${SNGR_SETUP_ALONE:-}" ]; then
  SNGR_SETUP_ALONE=yes exec "$python" scripts/alone.py build/.setup.lock bash scripts/setup.sh "$python"
fi

if [ -e .venv ] && { [ ! -w .venv ] || [ ! -w .venv/bin ]; }; then
  fail ".venv is not yours to replace (it belongs to $(ls -ld .venv | awk '{print $3}'))"
fi

. scripts/private_pip.sh

[ -e .venv.before ] || [ ! -e .venv ] || mv .venv .venv.before
give_back() {
  rm -rf .venv
  [ ! -e .venv.before ] || mv .venv.before .venv
}
trap give_back EXIT
trap 'exit 130' INT TERM HUP

quiet=--quiet
[ -t 1 ] && quiet=
echo "setup: installing environment.lock into .venv ($("$python" --version))"
rm -rf .venv
if command -v uv > /dev/null; then
  uv venv --quiet --no-project --python "$(command -v "$python")" .venv
  install=(uv pip install $quiet --python .venv/bin/python)
else
  "$python" -m venv .venv ||
    fail "$python cannot make a virtual environment (Debian: apt install python3-venv)"
  install=(.venv/bin/python -m pip install $quiet)
fi
# The lock is complete. With its resolver on, pip fails as soon as a package that another asks for
# with an extra (coverage[toml]) has a newer release than the locked one.
"${install[@]}" --only-binary :all: --no-deps --require-hashes -r environment.lock ||
  fail "environment.lock was not installed; what .venv held before is left as it was"
"${install[@]}" --no-deps --no-build-isolation --editable .
echo "$current" > .venv/complete
trap - EXIT
rm -rf .venv.before
