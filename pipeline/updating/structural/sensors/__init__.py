"""Sensors that are turned, swapped, flipped, scaled or displaced."""
