"""What changed between two results of one kind: every figure against its interval, every statement against its old self."""
