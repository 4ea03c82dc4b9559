"""Universal file format, dataset 58 (functions at nodal degrees of freedom) → SEP005 channels.

Every time response is a channel, called "12+Z" after its node and direction; spectra and frequency
responses are left out. Needs pyuff (extra `uff`).

Source: University of Cincinnati SDRL, "Universal File Datasets Summary", dataset 58.
"""

import warnings
from pathlib import Path
from typing import Any

import numpy as np

from sensors.extras import import_extra
from sensors.files.sep005 import Sep005Channel
from sensors.files.table import FileError, readable, require_file

DELIMITER = b"    -1"  # before and behind every dataset
TIME_RESPONSE = 1  # `func_type`
EVEN_SPACING = 1  # `abscissa_spacing`
DIRECTIONS = {
    **{0: "", 1: "+X", 2: "+Y", 3: "+Z", 4: "+RX", 5: "+RY", 6: "+RZ"},
    **{-1: "-X", -2: "-Y", -3: "-Z", -4: "-RX", -5: "-RY", -6: "-RZ"},
}
QUANTITIES = {8: "d", 11: "v", 12: "a"}  # `ordinate_spec_data_type`


def read_uff(path: Path) -> list[Sep005Channel]:
    """Read the time responses of a universal file.

    Parameters
    ----------
    path : Path
        The file; text or binary (58b).

    Returns
    -------
    list of Channel
        One for each dataset 58 that is a time response.

    Raises
    ------
    FileError
        If the file is missing, damaged or holds no time response, or pyuff is not installed.
    """
    pyuff = import_extra("pyuff", "uff", str(path), FileError)
    if (
        not require_file(path).read_bytes().rstrip().endswith(DELIMITER)
    ):  # pyuff drops a part in silence
        raise FileError(f"{path}: no universal file, or cut off: its last line must be -1")
    # pyuff raises bare Exceptions
    with readable(path, "universal file", Exception), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        file = pyuff.UFF(str(path))
        numbers = [i for i, kind in enumerate(file.get_set_types()) if int(kind) == 58]
        sets = [file.read_sets(number) for number in numbers]
        responses = [each for each in sets if each["func_type"] == TIME_RESPONSE]
        channels = [_channel(each) for each in responses]
    if not channels:
        raise FileError(f"{path}: it has no time response (dataset 58, function type 1)")
    return channels


def _channel(dataset: dict[str, Any]) -> Sep005Channel:
    name = f"{dataset['rsp_node']}{DIRECTIONS.get(int(dataset['rsp_dir']), '')}"
    unit = str(dataset["ordinate_axis_units_lab"]).strip()
    channel = Sep005Channel(
        data=np.asarray(dataset["data"]),
        name=name,
        unit_str="" if unit.upper() == "NONE" else unit,
        quantity=QUANTITIES.get(int(dataset["ordinate_spec_data_type"])),
    )
    if int(dataset["abscissa_spacing"]) == EVEN_SPACING and dataset["abscissa_inc"] > 0:
        channel["fs"] = 1.0 / float(dataset["abscissa_inc"])
    else:
        channel["time"] = np.asarray(dataset["x"], dtype=np.float64)
    return channel
