"""What accuracy.py is made of: rows to measure, faults, what is measured of a model, pictures and the page."""
