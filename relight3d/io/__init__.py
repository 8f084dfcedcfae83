"""Everything that opens a file: captures, images, meshes, model files, and what other programs wrote."""
