"""WebGym for other frameworks: one file each, which imports the façade alone."""
