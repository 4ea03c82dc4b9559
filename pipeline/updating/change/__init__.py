"""Has the structure changed, when, and was it the foundation? Decided on sums, without sampling.

    settings               how much may be missed for how much quiet
    sufficient_statistics  what is remembered of the windows: O(1) sums, and the steps they allow
    likelihood_ratios      evidence of a modal drift, and of a change of the springs
    classification         which of the two a change was, once there is an alarm
    random_walk            a stiffness that wanders or rides with the water, beside the change
    level_from_modes       a water level that nothing reports
    detector               both kinds together: the alarm, its kind, the new beginning
    event_message          the detectors' input from the updater; a change's size and message
    revised_size           a change's size by all windows since

Every tracked mode's ln f is a line in the surroundings that SCADA reports (the wind speed, and the
water level after the model's own dependence on it is taken out), with errors of known size; a
change adds a step δ_j from some window k on:

    y_tj = β_jᵀ z_t + δ_j [t ≥ k] + e_tj,   z = (1, water level, wind),   e ~ N(0, s_j² σ_tj²)

β is integrated out, its intercept under a flat prior. With the sums from k on,
n = Σ 1/σ², c = Σ z/σ², r = Σ y/σ², and A, β̂ of all windows, what is left of the step is

    g = r − cᵀ β̂,   h = n − cᵀ A⁻¹ c      (g ~ N(δ h, h))

so that each candidate k costs a few products and the model's constant discrepancy, which sits in
the intercept, cancels. A step of variance τ² makes the windows since k more likely by

    L(g, h; τ²) = (1 + τ²h)^(−½) exp(½ g² τ² / (1 + τ²h))

and both kinds of change are products of such factors (`likelihood_ratios`). Their sum over the
candidates, R = Σ_k LR_k (Shiryaev and Roberts), is what the Bayesian change-point mixture with a
small constant hazard ρ uses: P(changed) = ρR / (1 + ρR). R − t is a martingale while nothing
changes, so an alarm at R ≥ A comes falsely at most once in A windows on average, whatever the
number of modes: the person sets the rate, no threshold is tuned.

Sources: Shiryaev (1963), Theory of Probability and its Applications 8; Pollak (1985), Annals of
Statistics 13; Adams and MacKay (2007), arXiv:0710.3742.
"""
