"""jointscope: a validation testbed for elastic robot joints.

Simulate a joint, identify it from hammer hits, predict its vibration from the motor's torque, and, where a
simulation and a recording differ, say where, what physics was left out, and how much modelling it gains.
"""

__version__ = "0.1.0"
