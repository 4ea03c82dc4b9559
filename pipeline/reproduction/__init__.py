"""Run the publication's numerical example end to end: `pilewatch reproduce`.

    example         one seed: simulate, identify, update deterministically and by TMCMC
    listed_modes    the publication's modes among the identified ones, paired blind
    deterministic   the stiffness that brings the model's modes nearest to the identified
    paper           the publication's own figures
    study           seeds and sign conventions, in two processes
    findings        what agrees, what differs and why, in sentences computed from the run
    page            report.md, report.html, table1.csv, table2.csv, Figure 3 as a corner plot

Source: "Estimating the foundation parameters of offshore wind turbines through Bayesian model
updating", [foundation-updating].
"""
