"""From modal estimates to a posterior of the foundation's coupled springs.

START in `updater`: sightings → evidence (what the windows said, without any model) → pairing
(which model mode is which identified one) → likelihood → sampler → FoundationPosterior. Nothing
here knows the simulator, the transport or the clock.
"""
