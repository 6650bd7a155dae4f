"""Accuracy gates: claims with a bound, measured anew, each PASS, FAIL or NOT-TESTED."""
