"""Detect, describe, locate, name and model what physics a base model left out; abstain where the data can't tell."""
