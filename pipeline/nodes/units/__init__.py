"""A turbine's acquisition units: their sessions, their restart."""
