"""Loads → response → what instruments with faults measure: the simulated source."""
