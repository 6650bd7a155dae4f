"""From the motor's torque or currents to the arm's acceleration, spectrum and time history, and the scores."""
