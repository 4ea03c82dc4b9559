"""Responses in time: modal oscillators, damped response, modal response."""
