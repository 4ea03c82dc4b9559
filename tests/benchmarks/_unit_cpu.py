"""`pilewatch` with its CPU time: python -m tests.benchmarks._unit_cpu SECONDS ARGUMENTS."""

import os
import resource
import signal
import sys
import threading
from contextlib import suppress
from typing import Any

from pipeline.cli import main
from pipeline.sources import publisher


def measured(seconds: float, arguments: list[str]) -> float:
    """CPU from the opening of the session on [ms a second]."""
    began: list[resource.struct_rusage] = []
    opened = publisher.open_session

    def open_session(*given: Any) -> Any:
        began.append(resource.getrusage(resource.RUSAGE_SELF))
        timer = threading.Timer(seconds, os.kill, (os.getpid(), signal.SIGTERM))
        timer.daemon = True
        timer.start()
        return opened(*given)

    publisher.open_session = open_session
    sys.argv = ["pilewatch", *arguments]
    with suppress(SystemExit):
        main()
    now, (then,) = resource.getrusage(resource.RUSAGE_SELF), began
    return 1e3 * (now.ru_utime + now.ru_stime - then.ru_utime - then.ru_stime) / seconds


if __name__ == "__main__":
    print(measured(float(sys.argv[1]), sys.argv[2:]))
