"""Loaded by every worker process of this machine before it works, and by nothing else.

A terminal's Ctrl-C goes to all processes of the command. The command itself ends its workers when
it has put away what is finished; they must not die before it, each with a traceback.
"""

import logging
import signal

signal.signal(signal.SIGINT, signal.SIG_IGN)
logging.getLogger("distributed").setLevel(logging.ERROR)
