"""A user's own simulation beside a campaign: its error, what it is made of, and the change of its file that mends it."""
