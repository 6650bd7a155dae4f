"""The six-axis arm's experiments, simulated: hits on a braked arm, one joint swept or moved by its drive."""
