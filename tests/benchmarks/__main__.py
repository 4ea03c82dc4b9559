"""python -m tests.benchmarks NAME [ARGUMENTS]: run one benchmark, which prints its table."""

import importlib
import os
import pkgutil
import sys

from pipeline.cli import BLAS_THREADS

ONE_THREAD = (*BLAS_THREADS, "OMP_NUM_THREADS")  # the last: of peers


def main(arguments: list[str]) -> int:
    """Run the benchmark that the first argument names; the rest are its own arguments."""
    # CPU times are of one core; linear algebra reads these when it is imported, further below
    for variable in ONE_THREAD:
        os.environ.setdefault(variable, "1")
    package = __package__ or "tests.benchmarks"
    path = importlib.import_module(package).__path__
    names = sorted(m.name for m in pkgutil.iter_modules(path) if not m.name.startswith("_"))
    if not arguments or arguments[0] not in names:
        given = f"there is no benchmark {arguments[0]!r}; " if arguments else ""
        print(f"{given}python -m tests.benchmarks NAME, with NAME one of {', '.join(names)}")
        return 2
    importlib.import_module(f"{package}.{arguments[0]}").main(arguments[1:])
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
