#!/usr/bin/env bash
# Make sure that the site can be tested in a browser: install Chromium on a Debian-like system if
# we may, say what to do otherwise. CHROMIUM=/path/to/chromium names one that is there already.
set -euo pipefail
[ $# = 0 ] || { sed -n '2,/^set/s/^# //p' "$0" >&2; exit 2; }

for browser in "${CHROMIUM:-chromium}" chromium chromium-browser google-chrome; do
  command -v "$browser" > /dev/null && exit 0
done

as_root=
if [ "$(id -u)" != 0 ]; then
  as_root="sudo -n"
fi
if command -v apt-get > /dev/null && { [ -z "$as_root" ] || $as_root true 2> /dev/null; }; then
  echo "browser: installing chromium (about 100 MB)"
  export DEBIAN_FRONTEND=noninteractive
  $as_root apt-get update -qq
  $as_root apt-get install -y -qq --no-install-recommends -o DPkg::Lock::Timeout=300 \
    chromium > /dev/null
  command -v chromium > /dev/null && exit 0
fi

cat >&2 << 'MESSAGE'
error: no Chromium was found, and it may not be installed here. Install it, or name one that is
not on the PATH: make test-site CHROMIUM=/path/to/chromium
Without it, 'make site' still makes the site.
MESSAGE
exit 1
