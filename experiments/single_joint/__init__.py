"""Sections 2-3 of the paper without hardware: Figures 8-15, Tables 1-2 and Equation (26) beside its numbers."""

from jointscope.experiments.single_joint.reproduction import reproduce_single_joint

__all__ = ["reproduce_single_joint"]
