"""What pipelines/benchmark.py measures, and on what."""
