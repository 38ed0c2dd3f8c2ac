"""The library behind the SNGR notebooks: simulate, estimate, trigger, refine, report.

A folder is a section of the paper, a file is a term of it, and a notebook's stem is the same
everywhere: ``notebooks/05_audit.ipynb`` has its parameters in ``params/05_audit.yaml``, what it
runs in ``sngr_utils/audit.py`` and what it shows in ``sngr_utils/show/audit.py``. Each line may
import what stands below it (``make lint`` checks that, see pyproject.toml):

===================  ===========================================================================
`estimate_file`      a log from a file, a map into files: the command of python -m
`show`               what the notebooks show: tables, figures, and what they record
`bimodal` ...        one helper per notebook: `start_here`, `bimodal`, `trigger_sweep`,
                     `full_sngr`, `cost`, `audit`, `triggers`, `peers`, `association_aware`,
                     `multimodal`, `real_data`
`experiments`        studies over many worlds, each named by what it measures
`online`             the online estimator (section "Association-aware refinement,
                     online")
`detection`          which windows have failed (section "Triggers")
`sngr`               the paper's method: windows, trigger, closure, gate, refinement
                     (sections "Trigger" and "Refinement")
`sampling`           nested sampling, importance sampling, modes, priors; `sampling.targets` has
                     what is sampled (section "Refinement")
`robust`             ways of doubting a label: losses, switches, mixtures, EM, particles
                     (section "Ways of doubting")
`slam`               factors, iSAM2, marginals, landmark starts (section "Problem")
`files`              logs from files and into files: `.pyfg`, `.fg`, the Plaza sets, tables
`world`              the simulated scenario (section "Experimental set-up"); what a log and its
                     truth are
`numerics`           compiled functions that several rooms need
`publish`            from results to the PDF: reports, verdicts, LaTeX, the runner, `make verify`
`metrics`            RMSE and NEES, precision and recall, intervals over worlds
`settings` `paths`   parameter sets that check themselves; where the project keeps things
`whole_file`         files that are written whole or not at all
===================  ===========================================================================
"""

__version__ = "0.1.0"
