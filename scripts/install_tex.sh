#!/usr/bin/env bash
# Make sure that the paper can be typeset: install the small set of TeX packages on a
# Debian-like system if we may, say what to do otherwise. NO_APT=1 declines it.
set -euo pipefail
[ $# = 0 ] || { sed -n '2,/^set/s/^# //p' "$0" >&2; exit 2; }

packages="texlive-latex-extra texlive-publishers texlive-science latexmk"
files="IEEEtran.cls IEEEtran.bst subfig.sty booktabs.sty hyperref.sty microtype.sty algpseudocode.sty"

complete() {
  command -v latexmk > /dev/null && command -v pdflatex > /dev/null || return 1
  for file in $files; do
    kpsewhich "$file" > /dev/null || return 1
  done
}

complete && exit 0

as_root=
if [ "$(id -u)" != 0 ]; then
  as_root="sudo -n"
fi
if [ -z "${NO_APT:-}" ] && command -v apt-get > /dev/null &&
  { [ -z "$as_root" ] || $as_root true 2> /dev/null; }; then
  cat << MESSAGE
tex: TeX is missing. As root, on this system and not only in this folder, this runs now
  apt-get update
  apt-get install --no-install-recommends $packages
(about 200 MB to fetch, 0.6 GB installed). To decline, stop it and set NO_APT=1.
MESSAGE
  [ ! -t 0 ] || [ ! -t 1 ] || sleep 5
  export DEBIAN_FRONTEND=noninteractive
  $as_root apt-get update -qq
  $as_root apt-get install -y -qq --no-install-recommends -o DPkg::Lock::Timeout=300 \
    $packages > /dev/null
  complete && exit 0
fi

case "$(uname -s)" in
  Darwin) command="brew install --cask mactex-no-gui" ;;
  *) command="sudo apt-get update && sudo apt-get install --no-install-recommends $packages" ;;
esac
cat >&2 << MESSAGE
error: TeX is missing, and 'make paper' may not install it here${NO_APT:+ (NO_APT is set)}. Run
  $command
(or your system's equivalent) and then 'make paper' again.
Without TeX, 'make results' still does everything but the PDF.
MESSAGE
exit 1
