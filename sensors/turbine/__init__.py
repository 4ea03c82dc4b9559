"""The structure: description → finite elements → natural frequencies and mode shapes.

Shared by the simulator, which integrates the whole model, and by the updater, which asks
`modal.ModalModel` for the modes of many foundation stiffnesses at once.
"""
