"""What we believe the machine is: parameters, closed forms, MJCF, and Pinocchio's references."""
