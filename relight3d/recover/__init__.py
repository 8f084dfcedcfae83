"""Recovery: from a capture to what its surfaces are made of. One stage a module; only run.py knows the order."""
