#!/usr/bin/env bash
# Typeset paper/sngr.tex. The PDF is replaced only if all went well.
set -euo pipefail
cd "$(dirname "$0")/../paper"

build=../build/paper
mkdir -p "$build"
fail() {
  echo "error: the paper was not typeset; the last good PDF is untouched. From build/paper/sngr.log:" >&2
  grep -E -A3 '^(!|.*:[0-9]+:)|undefined' "$build/sngr.log" | head -n 30 >&2 || true
  exit 1
}
command -v latexmk > /dev/null || { echo "error: latexmk is missing; run 'make tex'" >&2; exit 1; }
latexmk -pdf -interaction=nonstopmode -halt-on-error -file-line-error -outdir="$build" sngr.tex \
  > "$build/latexmk.out" 2>&1 || fail
if grep -q -E 'undefined (references|citations)|(Reference|Citation) .* undefined' "$build/sngr.log"; then
  fail
fi
if ! cmp -s "$build/sngr.pdf" sngr.pdf; then
  cp "$build/sngr.pdf" sngr.pdf.partial
  mv sngr.pdf.partial sngr.pdf
fi
echo "paper/sngr.pdf is up to date"
