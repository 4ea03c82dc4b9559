"""One session from its source to its summary: what `pilewatch run` does, and `pilewatch node`.

running     the session: its graph, its desks, its workers, its summary
one_node    one node of the graph by itself, in a process or on a machine of its own
options     what a person may choose
folder      the files of a session, those of an earlier one set aside
meeting     how the parts find each other over Zenoh
processes   nodes as processes: their command lines, their shares of the turbines
"""
