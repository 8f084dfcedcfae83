"""The demo capture: a desk modelled here, path-traced with Mitsuba 3, written as a capture folder.

In the order of the flow: `settings` (what the scenes are), `shapes` and `patterns` (geometry, relief, texture),
`lights` (where the lamps stand), `scene` (all of it for Mitsuba), `lamp_paths` (the integrator), `passes` (resumable
renders), `truth`, `folder` (files), `checks` (what was measured on the written files), `run` (the whole).
"""
