"""Diagnosis of arms with several joints: a reduced model of all joints at once, and effects that are named with their joint."""
