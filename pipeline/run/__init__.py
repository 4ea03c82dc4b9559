"""One run from its source to its summary: what `pilewatch run` does, and `pilewatch node`.

run         the run: its graph, its nodes beside it, its workers, its summary; one node by itself
options     what a person may choose
folder      the files of a run, those of an earlier one set aside
endpoints   how the parts find each other over Zenoh
processes   nodes as processes: their command lines, their shares of the turbines
update_recording  the posterior of a recording, in one thread
"""
