"""What answers leave probable of a wish: one to three habits, each with a curve.

`hypotheses` holds the particles, `sampler` what answers make of them, `fit_posterior`
and `curve_scorer` what is learned and paid, `group_raters` who wants the same.
"""
