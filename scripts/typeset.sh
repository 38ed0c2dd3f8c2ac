#!/usr/bin/env bash
# Typeset the paper and its supplement. The PDFs are replaced only if all went well with both.
set -euo pipefail
[ $# = 0 ] || { sed -n '2,/^set/s/^# //p' "$0" >&2; exit 2; }
unset CDPATH
cd "$(dirname "$0")/../paper"

build=../build/paper
documents=
for file in $(grep -l '^\\documentclass' -- *.tex); do documents="$documents ${file%.tex}"; done
document=sngr
export max_print_line=1000
fail() {
  log=$build/$document.log
  echo "error: the paper was not typeset; the last good PDF is untouched." >&2
  grep -h -E -A2 '^!|^[^ ]*:[0-9]+: ' "$log" > "$build/errors" 2> /dev/null ||
    grep -h 'undefined' "$log" > "$build/errors" 2> /dev/null ||
    grep -h -i 'error' "$build/$document.blg" > "$build/errors" 2> /dev/null ||
    tail -n 20 "$build/latexmk.out" > "$build/errors" 2> /dev/null || true
  head -n 20 "$build/errors" >&2 || true
  df -P "$build/.." | awk 'NR == 2 && $4 < 20000 {print "The disk is full: " $6}' >&2 || true
  exit 1
}
# Each names tables and sections of the other: twice, so that both have read what the other says.
# Without a user's latexmkrc: it may name another engine, or another place for the log.
typeset() {
  mkdir -p "$build"
  for document in $documents; do # latexmk watches a file that is there
    [ -e "$build/$document.aux" ] || echo '\relax' > "$build/$document.aux"
  done
  for document in $documents $documents; do
    latexmk -norc -pdf -interaction=nonstopmode -halt-on-error -file-line-error \
      -outdir="$build" "$document.tex" > "$build/latexmk.out" 2>&1 &&
      [ -s "$build/$document.log" ] && [ -s "$build/$document.pdf" ] || return 1
  done
}
command -v latexmk > /dev/null || { echo "error: latexmk is missing; run 'make tex'" >&2; exit 1; }
# A run that was cut off can leave files that spoil the next one: begin afresh before giving up.
typeset || { rm -rf "$build" && typeset; } || fail
for document in $documents; do
  if grep -q -E 'undefined (references|citations)|(Reference|Citation) .* undefined' \
    "$build/$document.log"; then
    fail
  fi
done
for document in $documents; do
  if ! cmp -s "$build/$document.pdf" "$document.pdf"; then
    cp "$build/$document.pdf" "$document.pdf.partial"
    mv "$document.pdf.partial" "$document.pdf"
  fi
done
echo "paper/sngr.pdf and paper/supplement.pdf are up to date"
