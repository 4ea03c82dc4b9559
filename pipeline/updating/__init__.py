"""From modal estimates to a posterior of the foundation's coupled springs.

START in `updater`: observations → evidence (of all windows, without any model) → pairing
(which model mode is which identified one) → likelihood → sampler → FoundationPosterior. Nothing
here knows the simulator, the transport or the clock.
"""
