"""How well a model does: metrics, baselines, captures whose truth is known, and the faults of real ones."""
