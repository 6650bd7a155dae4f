"""Arms with several elastic joints: a robot's geometry and inertias, a table of its joints, the models made of both.

``library`` finds the robots of example-robot-data, ``table`` holds what is added to one (stiffness, damping, ratio,
rotor inertia, load, posture), ``build`` makes the MJCF, ``holding`` the variant in which each joint is braked, driven,
locked or free, ``forward`` steps it. ``reference`` is Pinocchio's view of the same arm, ``linear`` small motion about a
posture, ``solve`` the search for a load and stiffnesses that give wanted resonances.
"""
