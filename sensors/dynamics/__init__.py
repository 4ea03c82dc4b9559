"""Modes and responses of a structure.

Shared by the simulator, which integrates the whole model, and by the updater, which asks
`modal_model.ModalModel` for the modes of many foundation stiffnesses at once.
"""
