#!/usr/bin/env bash
# Typeset paper/sngr.tex. The PDF is replaced only if all went well.
set -euo pipefail
unset CDPATH
cd "$(dirname "$0")/../paper"

build=../build/paper
log=$build/sngr.log
export max_print_line=1000
fail() {
  echo "error: the paper was not typeset; the last good PDF is untouched." >&2
  grep -h -E -A2 '^!|^[^ ]*:[0-9]+: ' "$log" > "$build/errors" 2> /dev/null ||
    grep -h 'undefined' "$log" > "$build/errors" 2> /dev/null ||
    grep -h -i 'error' "$build/sngr.blg" > "$build/errors" 2> /dev/null ||
    tail -n 20 "$build/latexmk.out" > "$build/errors" 2> /dev/null || true
  head -n 20 "$build/errors" >&2 || true
  df -P "$build/.." | awk 'NR == 2 && $4 < 20000 {print "The disk is full: " $6}' >&2 || true
  exit 1
}
# without a user's latexmkrc: it may name another engine, or another place for the log
typeset() {
  mkdir -p "$build"
  latexmk -norc -pdf -interaction=nonstopmode -halt-on-error -file-line-error -outdir="$build" \
    sngr.tex > "$build/latexmk.out" 2>&1 && [ -s "$log" ] && [ -s "$build/sngr.pdf" ]
}
command -v latexmk > /dev/null || { echo "error: latexmk is missing; run 'make tex'" >&2; exit 1; }
# A run that was cut off can leave files that spoil the next one: begin afresh before giving up.
typeset || { rm -rf "$build" && typeset; } || fail
if grep -q -E 'undefined (references|citations)|(Reference|Citation) .* undefined' "$log"; then
  fail
fi
if ! cmp -s "$build/sngr.pdf" sngr.pdf; then
  cp "$build/sngr.pdf" sngr.pdf.partial
  mv sngr.pdf.partial sngr.pdf
fi
echo "paper/sngr.pdf is up to date"
