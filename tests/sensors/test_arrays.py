"""Linear algebra in one thread, in processes that have not computed anything yet."""

import os
import subprocess
import sys

import pytest

COUNT = "print(sorted({each['num_threads'] for each in threadpoolctl.threadpool_info()}))"
LIMITED = f"""
import threadpoolctl
from sensors.arrays import one_blas_thread
with one_blas_thread():
    import scipy.linalg
    {COUNT}
"""
COMMAND = f"""
import sys
from pipeline import cli
sys.argv = ["pilewatch", "--version"]
try:
    cli.main()
except SystemExit:
    pass
import numpy, scipy.linalg, threadpoolctl
{COUNT}
"""
VARIABLES = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS", "OMP_NUM_THREADS")


@pytest.mark.parametrize("program", [LIMITED, COMMAND], ids=["limited", "command"])
def test_a_library_that_is_loaded_later_computes_in_one_thread_too(program: str) -> None:
    environment = {name: value for name, value in os.environ.items() if name not in VARIABLES}
    ran = subprocess.run(
        [sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True
    )
    assert ran.stdout.splitlines()[-1] == "[1]"
