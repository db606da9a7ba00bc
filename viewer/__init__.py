"""The viewer: pages in a browser that show an archive's dances, search them and correct bodies.

Pages and controls are Python (NiceGUI); what is drawn and played is a few small modules of
JavaScript in `static`, which get a take's frames once and play them by themselves.
"""
