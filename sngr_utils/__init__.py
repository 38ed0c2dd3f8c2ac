"""The library behind the SNGR notebooks: simulate, estimate, trigger, refine, report.

Import the modules by name (``from sngr_utils import world, graph``). Each may import only
what stands above it in this list:

================  =====================================================================
`paths`           where the project keeps things
`style`           colours, column widths, saving a figure
`jit`             compiles functions, and keeps the machine code
`world`           the simulated scenario: trajectory, landmarks, odometry, ranges
`variations`      bursts, slips of the odometry, a drawn x0 prior
`metrics`         RMSE, NEES, precision and recall, bimodality coefficient
`graph`           GTSAM factors, the iSAM2 run, joint marginals
`mirror`          would the mirror image of a landmark explain its ranges as well?
`windows`         three-pose windows: score, failure, closure, factors
`information`     GTSAM's linearisation as blocks of the information matrix, compiled
`chain`           all window marginals at once, by a selected inverse
`nested`          likelihood, prior transform, dynesty run and its summary
`compiled`        the same likelihood without GTSAM, compiled
`compiled_nested` a compiled nested sampler
`compiled_walk`   dynesty with its random walk compiled
`importance`      the fast path: many-start optimisation and importance sampling
`laplace`         one window as one Gaussian, with the full Hessian
`window_target`   posterior of a window whose ranges may belong to any landmark
`landmark_target` posterior of a landmark in the plane, its poses integrated out
`many_starts`     their modes by optimisation
`adaptive`        importance sampling about them, the mixture fitted to its own draws
`brute_force`     their references by quadrature and by particle filters
`ancestral`       nested sampling inside a Gaussian, a ring or a spanning tree
`contest`         six methods on one small posterior, against its reference
`posterior`       a window's posterior under all factors, each counted once
`engines`         the four ways to sample a window, behind one call
`refine`          the paper's algorithm and its trigger-only baseline
`baseline`        one world, one iSAM2 run, what the trigger makes of it
`corrected`       the algorithm with its slips mended
`window_audit`    what a window's posterior is: widths, gains, Gaussianity
`sampler_audit`   what the sampler's own numbers say: ESS, evidence, mean log weights
`refined_sweep`   the algorithm, as printed and corrected, over many worlds
`sweeps`          many worlds: tidy tables, means with errors, paired differences, NEES variants
`robust`          batch estimates under robust losses, GNC, and with the true associations
`association`     which landmark a range came from: posterior, mutual exclusion, EM
`switchable`      a switch variable on every range
`mixtures`        max-mixtures: null hypothesis, or all landmarks
`crossings`       where ranges from several places may put a landmark, compiled
`particles`       the loops of FastSLAM, compiled
`fastslam`        Rao-Blackwellised particle filter with associations in doubt
`estimators`      all peers behind one call, and compared on the same worlds
`leverage`        do a window's ranges fit? a chi-square that knows their leverage
`detectors`       scores of windows: what may tell that an estimate has failed
`calibration`     thresholds with a controlled rate of false alarms
`clustered`       how well scores rank or decide, drawing whole worlds
`detection_study` what every detector says of every window, and the truth beside it
`detection_summary` the same summed up: ranking, decisions, false alarms
`place`           the posterior of one place, from ranges any of which may be wrong
`crediting`       to which landmark a range is credited: innovations, gate, posterior
`smoother`        iSAM2 with factors that have names and can be taken out
`belief`          what the online estimator holds
`landmark_start`  landmarks that wait until their place is known
`odometry_doubt`  steps of the odometry that slipped, and where the robot is then
`online`          association-aware SNGR, online
`online_study`    the same over many worlds: variants, slips, a film
`plots`           ``draw_*(ax, data)``
`peer_plots`      those of notebook 07
`online_plots`    those of notebook 08
`report`          results -> JSON -> LaTeX values and tables
`trigger_tables`  the tables of notebook 06
`trigger_plots`   its figures
`multimodal_plots` those of notebook 09
`bench`           the engines side by side, and the growth with the length of the trajectory
`printed`         the paper's numbers with the digits it prints
`contradictions`  where those numbers contradict each other
`rules`           how a verdict follows from a printed value and ours
`parameters`      reads ``params/*.yaml`` and checks every value
`bimodal` ...     one driver per notebook: `bimodal`, `trigger_sweep`, `full_sngr`, `cost`,
                  `audit`, `triggers`, `peers`, `association_aware`, `multimodal`
`audit_tables`    the tables of notebook 05
`peer_tables`     those of notebook 07
`online_tables`   those of notebook 08
`multimodal_tables` those of notebook 09
`claims`          what the paper claims, from ``paper/claims.yaml``
`verdicts`        a verdict on every claim
`verdict_tables`  the verdicts in LaTeX and in the README
`warm_up`         compiles everything once, before notebooks run side by side
`dependencies`    the files of the package that a notebook depends on
`run`             runs the notebooks headless (used by the Makefile)
`verify`          re-runs everything and compares it with the committed reference
================  =====================================================================
"""

__version__ = "0.1.0"
