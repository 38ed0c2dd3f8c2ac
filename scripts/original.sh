#!/usr/bin/env bash
# The original's printed numbers, in the environment that they need: original.sh FILE DRAWS.
# GTSAM 4.2, which .venv does not have, goes below build/ and stays there.
set -euo pipefail
unset CDPATH PIP_USER PIP_TARGET PIP_PREFIX PIP_REQUIRE_VIRTUALENV
cd "$(dirname "$0")/.."
[[ ${2:-} =~ ^[0-9]+$ ]] || { sed -n '2,3s/^# //p' scripts/original.sh >&2; exit 2; }

packages=(gtsam==4.2 dynesty==3.0.0 'numpy<2')
env=build/gtsam42
if [ "$(cat $env/complete 2> /dev/null)" != "${packages[*]}" ]; then
  python=
  for candidate in python3.11 .venv/bin/python; do
    if "$candidate" -c 'import sys; sys.exit(sys.version_info[:2] != (3, 11))' 2> /dev/null; then
      python=$candidate
      break
    fi
  done
  if [ -z "$python" ]; then
    echo 'error: GTSAM 4.2 has wheels up to Python 3.11 only, and no python3.11 was found' >&2
    exit 1
  fi
  echo "original: installing ${packages[*]} into $env, once"
  rm -rf $env
  "$python" -m venv $env
  if ! $env/bin/python -m pip install --quiet --disable-pip-version-check --only-binary :all: \
    "${packages[@]}"; then
    echo 'error: GTSAM 4.2 or what it needs has no wheel here: the printed digits cannot be tried' >&2
    exit 1
  fi
  echo "${packages[*]}" > $env/complete
fi
exec $env/bin/python -m sngr_utils.experiments.authors_digits "$@"
