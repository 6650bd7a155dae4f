"""Sensitivity of what users care about to the joint's parameters: local, Morris and Sobol, in closed form or MuJoCo."""
