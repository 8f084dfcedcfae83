"""Looking at results: frames through Open3D, inspection layers, the viewer, the report. All that knows Open3D.

Open3D is loaded when it is first needed, never by an import of this package, and only after `probe` has said that it
can draw here.
"""
