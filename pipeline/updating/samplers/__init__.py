"""The samplers of the posterior behind one interface."""
