"""From results to the PDF: reports, verdicts, LaTeX, the headless runner, `make verify`."""
