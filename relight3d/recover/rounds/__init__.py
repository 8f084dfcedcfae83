"""What recovery goes through more than once: albedo and indirect light in turn, then lobes, detail and mirrors.

Each step takes what is fitted so far and returns a new Fitted; nothing is edited in place. What one step explains is
taken out of the photographs before the next: the diffuse fits see radiance less lobes, the lobes see it less diffuse.
"""
