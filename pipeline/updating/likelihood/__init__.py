"""How likely the identified modes are: pairing, errors, density and its peak."""
