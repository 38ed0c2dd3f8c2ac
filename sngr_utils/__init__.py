"""The library behind the SNGR notebooks: simulate, estimate, trigger, refine, report.

Import the modules by name (``from sngr_utils import world, graph``). Each may import only
what stands above it in this list:

================  =====================================================================
`paths`           where the project keeps things
`style`           colours, column widths, saving a figure
`world`           the simulated scenario: trajectory, landmarks, odometry, ranges
`metrics`         RMSE, NEES, precision and recall, bimodality coefficient
`graph`           GTSAM factors, the iSAM2 run, joint marginals
`windows`         three-pose windows: score, failure, closure, factors
`nested`          likelihood, prior transform, dynesty run and its summary
`refine`          the paper's algorithm and its trigger-only baseline
`plots`           ``draw_*(ax, data)``
`report`          results -> JSON -> LaTeX values and tables
`printed`         the paper's numbers with the digits it prints
`contradictions`  where those numbers contradict each other
`rules`           how a verdict follows from a printed value and ours
`bimodal` ...     one driver per notebook: `bimodal`, `trigger_sweep`, `full_sngr`, `cost`
`parameters`      reads ``params/*.yaml`` and checks every value
`claims`          what the paper claims, from ``paper/claims.yaml``
`verdicts`        a verdict on every claim
`verdict_tables`  the verdicts in LaTeX and in the README
`run`             runs the notebooks headless (used by the Makefile)
`verify`          re-runs everything and compares it with the committed reference
================  =====================================================================
"""

__version__ = "0.1.0"
