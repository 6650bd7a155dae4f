"""Recordings whose missing physics is concealed: the other side of the diagnosis, written from the effect names alone.

Nothing here is shared with the explainer but the rig's parameters and its base MJCF: the laws, the engine's loop, the
drive and the measurement chain are this package's own.

Reading order: ``law`` (what an effect is), one file per family of effects, ``engine`` (MuJoCo stepped in a compiled
loop), ``rehearsal`` (a case's runs), ``measurement`` (what the devices make of them), ``strength`` (how hard a case
is), ``draw`` (which cases), ``seal`` (how the truth is kept).
"""
