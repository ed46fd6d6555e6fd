"""Episodes in zarr, HDF5 and npz, read by maps of their names (`docs/data.md`)."""
