#!/usr/bin/env bash
# Add docs/site/requirements.lock to .venv: what makes the site and tests it in a browser.
# Does nothing if that is done. A new .venv, which setup.sh makes, has none of it.
set -euo pipefail
unset CDPATH PIP_USER PIP_TARGET PIP_PREFIX PIP_REQUIRE_VIRTUALENV
cd "$(dirname "$0")/.."

lock=docs/site/requirements.lock
current="$(cksum < $lock)"
if [ "$(cat .venv/site 2> /dev/null)" = "$current" ]; then
  exit 0
fi
echo "site: adding $lock to .venv (about 0.25 GB)"
if command -v uv > /dev/null; then
  install=(uv pip install --quiet --python .venv/bin/python)
else
  install=(.venv/bin/python -m pip install --quiet --disable-pip-version-check)
fi
"${install[@]}" --no-deps --require-hashes -r $lock
echo "$current" > .venv/site
