"""A turbine's acquisition units: which blocks are used, their sessions, their restart."""
