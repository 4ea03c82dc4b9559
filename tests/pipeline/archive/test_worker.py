"""A worker process leaves Ctrl-C to the command, and says nothing of its own below an error."""

import logging
import runpy
import signal


def test_a_worker_ignores_ctrl_c_and_logs_errors_only() -> None:
    logger, before = logging.getLogger("distributed"), signal.getsignal(signal.SIGINT)
    level = logger.level
    logger.setLevel(logging.INFO)
    signal.signal(signal.SIGINT, signal.default_int_handler)  # in a shell's background none stands
    try:
        runpy.run_module("pipeline.archive.worker")
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
        assert logger.level == logging.ERROR
    finally:
        signal.signal(signal.SIGINT, before)
        logger.setLevel(level)
