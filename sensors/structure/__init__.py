"""The structure: its description and its finite elements; beams, rotor-nacelle, foundation."""
