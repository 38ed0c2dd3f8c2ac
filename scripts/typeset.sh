#!/usr/bin/env bash
# Typeset paper/sngr.tex. The PDF is replaced only if all went well.
set -euo pipefail
unset CDPATH
cd "$(dirname "$0")/../paper"

build=../build/paper
export max_print_line=1000
fail() {
  echo "error: the paper was not typeset; the last good PDF is untouched." >&2
  grep -h -E -A2 '^!|^[^ ]*:[0-9]+: ' "$build/sngr.log" > "$build/errors" 2> /dev/null ||
    grep -h 'undefined' "$build/sngr.log" > "$build/errors" 2> /dev/null ||
    grep -h -i 'error' "$build/sngr.blg" > "$build/errors" 2> /dev/null ||
    tail -n 20 "$build/latexmk.out" > "$build/errors"
  head -n 20 "$build/errors" >&2
  exit 1
}
typeset() {
  mkdir -p "$build"
  latexmk -pdf -interaction=nonstopmode -halt-on-error -file-line-error -outdir="$build" sngr.tex \
    > "$build/latexmk.out" 2>&1
}
command -v latexmk > /dev/null || { echo "error: latexmk is missing; run 'make tex'" >&2; exit 1; }
# A run that was cut off can leave files that spoil the next one: begin afresh before giving up.
typeset || { rm -rf "$build" && typeset; } || fail
if grep -q -E 'undefined (references|citations)|(Reference|Citation) .* undefined' "$build/sngr.log"; then
  fail
fi
if ! cmp -s "$build/sngr.pdf" sngr.pdf; then
  cp "$build/sngr.pdf" sngr.pdf.partial
  mv sngr.pdf.partial sngr.pdf
fi
echo "paper/sngr.pdf is up to date"
