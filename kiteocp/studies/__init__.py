"""What is asked of a system beyond one cycle: each room answers one question and reports it."""
