#!/usr/bin/env bash
# Make sure that the paper can be typeset: install the small set of TeX packages on a
# Debian-like system if we may, say what to do otherwise.
set -euo pipefail

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
if command -v apt-get > /dev/null && { [ -z "$as_root" ] || $as_root true 2> /dev/null; }; then
  echo "tex: installing $packages (about 200 MB)"
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
error: TeX is missing, and 'make paper' may not install it here. Run
  $command
(or your system's equivalent) and then 'make paper' again.
Without TeX, 'make results' still does everything but the PDF.
MESSAGE
exit 1
