#!/usr/bin/env bash
# Make sure that the site can be tested in a browser: install Chromium on a Debian-like system if
# we may, say what to do otherwise. NO_APT=1 declines it, CHROMIUM=/path/to/chromium names one.
set -euo pipefail
[ $# = 0 ] || { sed -n '2,/^set/s/^# //p' "$0" >&2; exit 2; }

for browser in "${CHROMIUM:-chromium}" chromium chromium-browser google-chrome; do
  command -v "$browser" > /dev/null && exit 0
done

as_root=
if [ "$(id -u)" != 0 ]; then
  as_root="sudo -n"
fi
if [ -z "${NO_APT:-}" ] && command -v apt-get > /dev/null &&
  { [ -z "$as_root" ] || $as_root true 2> /dev/null; }; then
  cat << MESSAGE
browser: Chromium is missing. As root, on this system and not only in this folder, this runs now
  apt-get update
  apt-get install --no-install-recommends chromium
(about 100 MB to fetch, for the tests of the site alone). To decline, stop it and set NO_APT=1.
MESSAGE
  [ ! -t 0 ] || [ ! -t 1 ] || sleep 5
  export DEBIAN_FRONTEND=noninteractive
  $as_root apt-get update -qq
  $as_root apt-get install -y -qq --no-install-recommends -o DPkg::Lock::Timeout=300 \
    chromium > /dev/null
  command -v chromium > /dev/null && exit 0
fi

cat >&2 << MESSAGE
error: no Chromium was found, and it may not be installed here${NO_APT:+ (NO_APT is set)}.
Install it, or name one that is not on the PATH: make test-site CHROMIUM=/path/to/chromium
Without it, 'make site' still makes the site.
MESSAGE
exit 1
