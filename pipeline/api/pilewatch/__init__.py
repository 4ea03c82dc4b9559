"""pilewatch as a library: measurements in, modes and the foundation's stiffness out.

    import pilewatch as pw

    modes = pw.identify(samples, sampling_rate=40.0)         # an array, (n, n_channels)
    modes.to_dataframe()

    measurement = pw.read("tower.csv", layout="tower.toml")
    posterior = pw.update(pw.identify(measurement, window=600.0), pw.Structure("my-turbine.toml"))
    posterior.plot()

What is exported here is stable: from this version on it changes by semantic versioning only.
"""

from importlib.metadata import version as _version

from ._own_packages import OWN as _OWN  # noqa: F401  # first: checks where the rest comes from
from .errors import InputError
from .measurement import Measurement, read, simulate
from .modes import Modes, identify
from .posterior import Posterior, update
from .session import Session, open_session
from .springs import springs_at
from .structure import Structure, StructureModes

__version__ = _version("pilewatch")
open = open_session  # noqa: A001  # as in other libraries of the field

__all__ = [
    "InputError",
    "Measurement",
    "Modes",
    "Posterior",
    "Session",
    "Structure",
    "StructureModes",
    "__version__",
    "identify",
    "open",
    "read",
    "simulate",
    "springs_at",
    "update",
]
