"""A campaign drafted from a lab's data files: what they hold, what can be guessed of it, and the commented TOML."""
