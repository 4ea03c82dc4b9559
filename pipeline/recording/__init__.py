"""Recordings: the only door to MCAP files.

Recorder            a node that writes every message it is given    (writer)
SessionRecorder     the same in parts, for a session that may run for a year    (session_recorder)
read_messages       a recording as messages again                   (reader)
recording_info      what it holds, in one look                      (info)
salvage             what is left of a cut or damaged file           (salvage)
"""
