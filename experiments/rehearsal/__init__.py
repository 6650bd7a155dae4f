"""A laboratory's own recordings rehearsed: its rig, runs and noise simulated in MuJoCo with one effect concealed at a time.

Reading order: ``bench`` (one run carried out), ``likeness`` (rig, runs and noise from a campaign), ``rehearse`` (every
effect in turn, diagnosed in processes), ``page`` (table and picture).
"""
