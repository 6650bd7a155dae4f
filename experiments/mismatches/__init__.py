"""The paper's own stated mismatches: a candidate cause of each, concealed, diagnosed blind, and the figure before and after.

Reading order: ``causes`` (what the paper states and what is concealed), ``telling`` (record, diagnose, predict, compare),
``figures`` and ``reproduction`` (pictures and page).
"""

from jointscope.experiments.mismatches.reproduction import reproduce_mismatches

__all__ = ["reproduce_mismatches"]
