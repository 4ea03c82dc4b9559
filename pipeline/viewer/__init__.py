"""Draw a session with Rerun, into a .rrd file or a viewer. The only package that imports Rerun.

    viewer_node       the node
    rerun_stream      one recording stream, with a view of every turbine
    turbine_view      one turbine, message by message; with signal_view, mode_view
    blueprint, view_parameters
                      tabs, views, axes, and what they depend on
    update_rates      how often drawings are sent
    pictures/         what is drawn, computed without Rerun
    drawing/          what is drawn, as Rerun entities; one function a picture
    outputs/          files, viewers, a page for browsers, and the thread that draws

Rerun is imported when a viewer is opened: everything else runs without it.
"""
