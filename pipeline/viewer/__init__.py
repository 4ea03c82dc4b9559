"""Rerun: the session as pictures, into a .rrd file or a viewer. The only package that imports it.

    outputs           where to: RrdFile, SpawnedViewer, ConnectedViewer; needs no rerun
    viewer_process    a viewer's window or a page for browsers, as a process on loopback
    page_server, web/ that page: Rerun's viewer inside, nobody outside this machine asked
    display_signals   accelerations at 20 Hz
    scene, corner, pile, spectrum, stabilisation, mac_matrix
                      what is drawn, as plain figures
    status            what is said, as text
    entities          where everything lies: paths, timeline, styles
    tower_views, track_views, foundation_views, plane_views
                      one function a picture
    blueprint         tabs, views, axes
    screen            one turbine, message by message; with signal_screen, mode_screen, node_screen
    pace, known_layouts
                      how often pictures are handed over; the sensors they are of
    show, stages      one output, and the thread it is drawn in
    late_show         a show on a viewer that comes late, goes and comes back
    sink              the node

Rerun is imported when a viewer is opened, not before: everything else runs without it.
"""
