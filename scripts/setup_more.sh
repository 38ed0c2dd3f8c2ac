#!/usr/bin/env bash
# Add what a make target of its own needs to .venv: setup_more.sh NAME LOCK.
# Does nothing if that is done. A new .venv, which setup.sh makes, has none of it.
set -euo pipefail
unset CDPATH
cd "$(dirname "$0")/.."
[ -f "${2:-}" ] || { sed -n '2,/^set/s/^# //p' scripts/setup_more.sh >&2; exit 2; }

name=$1 lock=$2
current="$(cksum < "$lock")"
if [ "$(cat ".venv/$name" 2> /dev/null)" = "$current" ]; then
  exit 0
fi
. scripts/private_pip.sh
echo "$name: adding $lock to .venv"
if command -v uv > /dev/null; then
  install=(uv pip install --quiet --python .venv/bin/python)
else
  install=(.venv/bin/python -m pip install --quiet)
fi
"${install[@]}" --only-binary :all: --no-deps --require-hashes -r "$lock" || {
  echo "error: $lock was not installed; without it 'make paper' and 'make test' work as before" >&2
  exit 1
}
echo "$current" > ".venv/$name"
